"""Bright lights, separated from the rest of the picture and splatted as whole aperture shapes.

A small light fills a wide disc evenly, but only a few of a pixel's rays would hit it. Lights that are far
brighter than their surroundings are therefore removed from the layers of the rays, and each is added to every
pixel of its disc that sees it: its PSF image (:mod:`bokehnet.classical.highlights.psf_images`, or
behind an aberrated lens :mod:`bokehnet.classical.highlights.aberrated_psf`) is splatted
(:mod:`bokehnet.classical.highlights.psf_splatting`).

Source: "Efficient and expressive rendering for real-time defocus blur and bokeh" (dissertation), chapter 5,
for separate lights, their merging, and visibility of their own; rectangles are ours.
"""

import math
from collections.abc import Callable

import numpy as np
from numba import prange

from bokehnet.arrays.viewport import Viewport
from bokehnet.classical.highlight_detection import light_limit
from bokehnet.classical.highlights.aberrated_psf import AberratedPsf
from bokehnet.classical.highlights.psf_images import PerfectPsf, place_psf_images
from bokehnet.classical.highlights.psf_splatting import splat_psf_images
from bokehnet.classical.layered.depth_discontinuities import DISCONTINUITY_THRESHOLD
from bokehnet.classical.layered.layers import Layers
from bokehnet.classical.layered.march.defocus_bins import DefocusBins
from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.aperture import Aperture

__all__ = ["add_lights", "separate_lights"]

# Sharper lights stay in the picture; over one pixel of radius from here they fade out of it.
_MIN_RADIUS_PX = 3.0

# Maximum fraction of the pixels that are lights, the brightest ones, which bounds the cost of their discs.
_MAX_LIGHT_FRACTION = 1 / 20

# Lights are merged in cells of this fraction of their radius. Cells of less than ``_MIN_FREE_CELL_PX`` pixels
# are powers of two, into which rows of few pixels divide evenly.
_CELL_FRACTION, _MIN_FREE_CELL_PX = 1 / 16, 6.0

# Lights are merged if their radii differ by at most this fraction, or by a depth discontinuity.
_RADIUS_FRACTION = 1 / 32

# Cells full of similar light are merged in squares of these numbers of cells. Light
# counts as similar if the brightest is at most ``_MAX_LIGHT_RATIO`` times the darkest.
_EVEN_CELLS, _MAX_LIGHT_RATIO = (2, 4), 3.0

# Floats of PSF images in memory at the same time.
_FLOATS = 16_000_000


@njit(cache=True, parallel=True)
def _find_lights(colors, depths, coverage, limit, mask):
    """Mark visible, blurred pixels brighter than ``limit``, (layers, H, W)."""
    for y in prange(limit.shape[0]):
        for x in range(limit.shape[1]):
            transmittance = np.float32(1.0)
            for layer in range(len(mask)):
                visibility = transmittance * coverage[y, x, layer]
                red, green, blue = colors[y, x, layer]
                bright = max(red, green, blue) > limit[y, x]
                blurred = abs(depths[y, x, layer]) > _MIN_RADIUS_PX
                mask[layer, y, x] = visibility > 0.0 and bright and blurred
                transmittance *= np.float32(1.0) - coverage[y, x, layer]


def separate_lights(
    layers: Layers,
    max_coc_radius: int | None = None,
    faintest: float = 0.0,
    *,
    limit: np.ndarray | None = None,
    overwrite: bool = False,
) -> tuple[Layers, np.ndarray]:
    """Separate layers into lights and the rest.

    A light is the excess of a pixel over the limit of its window; light up to the limit stays in the picture.
    A light that fades therefore blends into the picture without a step, whichever way the limit moves. Where
    nearer layers cover a part of its pixel, only the fraction that they transmit is its light; where they
    cover all of it, it stays in its layer.

    Args:
        layers: Estimated or true layers.
        max_coc_radius: Half-width in pixels of the window that a light must exceed; default: the largest
            radius.
        faintest: Energy, per pixel of blur radius, of each merged light that stays in the picture. The noise
            that rays add when they hit a light by chance grows with that ratio.
        limit: Brightness above which a pixel is a light, (H, W); default: from the first layer and
            ``max_coc_radius``.
        overwrite: True if the lights may be subtracted from the colors of ``layers`` itself.

    Returns:
        Layers without lights, and the lights as rows (x, y, defocus, red, green, blue, width, height).
        Lights of similar defocus in one small cell are merged into one, a rectangle of even brightness with
        their energy, their centre and their variance along either axis; for one pixel it is 1 wide and high.
        If more than a twentieth of the pixels are lights, the limit is raised until they are not.
    """
    if limit is None:
        if max_coc_radius is None:
            max_coc_radius = math.ceil(float(np.abs(layers.defocus).max()))
        limit = light_limit(layers.colors[:, :, 0], max_coc_radius)
    masks = np.empty((layers.defocus.shape[2], *limit.shape), np.bool_)
    with parallel_region:
        _find_lights(layers.colors, layers.defocus, layers.coverage, limit, masks)
    positions, lights = [], []
    for layer in range(len(masks)):
        y, x = np.nonzero(masks[layer])
        amount = (1.0 - layers.coverage[y, x, :layer]).prod(-1) * layers.coverage[y, x, layer]
        brightness = layers.colors[y, x, layer].max(-1)
        excess = 1.0 - limit[y, x] / brightness
        bound = int(_MAX_LIGHT_FRACTION * limit.size)
        if len(y) > bound:
            value = amount * excess * brightness
            ranked = np.argsort(-value, kind="stable")
            kept = ranked[:bound]
            excess *= 1.0 - value[ranked[bound]] / value
            y, x, amount, excess = y[kept], x[kept], amount[kept], excess[kept]
        excess *= _fade(np.abs(layers.defocus[y, x, layer]) - _MIN_RADIUS_PX)
        color = layers.colors[y, x, layer] * excess[:, None]
        positions.append(np.column_stack([y, x, np.full_like(y, layer)]))
        lights.append(np.column_stack([x, y, layers.defocus[y, x, layer], amount[:, None] * color, excess]))
    position, light = np.concatenate(positions), np.concatenate(lights).astype(np.float64)
    if faintest > 0:
        light[:, 3:] *= _retained_fraction(light, faintest)[:, None]
    colors = layers.colors if overwrite else layers.colors.copy()
    y, x, layer = position.T
    colors[y, x, layer] -= colors[y, x, layer] * light[:, 6:].astype(np.float32)
    rest = Layers(colors=colors, defocus=layers.defocus, coverage=layers.coverage)
    return rest, _merge(light[:, :6])


def _retained_fraction(lights: np.ndarray, faintest: float) -> np.ndarray:
    """Return the fraction of each light above the minimum energy of its group's radius, (N,)."""
    group = _group_lights(lights)
    energy = np.bincount(group, lights[:, 3:6].max(axis=1))[group]
    fraction: np.ndarray = np.maximum(1.0 - faintest * np.abs(lights[:, 2]) / np.maximum(energy, 1e-30), 0.0)
    return fraction


def _fade(t: np.ndarray) -> np.ndarray:
    """Return a smooth step from 0 at t = 0 to 1 at t = 1."""
    t = np.minimum(t, 1.0)
    return t * t * (3.0 - 2.0 * t)


def _group_lights(lights: np.ndarray) -> np.ndarray:
    """Return a group index for the lights of similar defocus in one cell, (N,).

    A cell is a square of whole pixels, at most ``_CELL_FRACTION`` of the radius wide, or several cells where
    they are full of similar light.
    """
    x, y, radius = lights[:, 0], lights[:, 1], np.abs(lights[:, 2])
    limit = DISCONTINUITY_THRESHOLD / _RADIUS_FRACTION  # up to this radius intervals have the same length
    scaled = np.where(radius < limit, radius / limit, 1 + np.log(np.maximum(radius, limit) / limit))
    interval = np.round(scaled / _RADIUS_FRACTION)
    depth = np.sign(lights[:, 2]) * interval
    scaled = interval * _RADIUS_FRACTION
    cell = np.maximum(limit * np.where(scaled < 1, scaled, np.exp(scaled - 1)) * _CELL_FRACTION, 1.0)
    cell = np.where(cell < _MIN_FREE_CELL_PX, 2.0 ** np.floor(np.log2(cell)), np.floor(cell))
    group = _cell_index(depth, x // cell, y // cell)
    brightness = lights[:, 3:6].max(axis=1)
    for side in _EVEN_CELLS:
        wide = _cell_index(depth, x // (side * cell), y // (side * cell))
        darkest, brightest = np.full(len(lights), np.inf), np.zeros(len(lights))
        np.minimum.at(darkest, wide, brightness)
        np.maximum.at(brightest, wide, brightness)
        even = np.bincount(wide, minlength=len(lights))[wide] == (side * cell) ** 2
        even &= brightest[wide] <= _MAX_LIGHT_RATIO * darkest[wide]
        group = np.where(even, side * len(lights) + wide, group)
    return np.asarray(np.unique(group, return_inverse=True)[1])


def _cell_index(depth: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the index of the cell of each light, equal for equal depth, x and y, (N,)."""
    index = np.zeros(len(depth), np.int64)
    for values in (depth, x, y):
        low = values.min(initial=0)
        index = index * int(values.max(initial=0) - low + 1) + (values - low).astype(np.int64)
    return np.asarray(np.unique(index, return_inverse=True)[1])


def _merge(lights: np.ndarray) -> np.ndarray:
    """Merge the lights of each group.

    An even row of n pixels has the variance (n^2 - 1) / 12, so the rectangle is sqrt(12 variance + 1) long.
    """
    lights = lights[lights[:, 3:].max(axis=1) > 0]
    x, y, depth = lights[:, 0], lights[:, 1], lights[:, 2]
    group = _group_lights(lights)
    weight = lights[:, 3:].max(axis=1)
    total = np.bincount(group, weight)
    mean = [np.bincount(group, weight * value) / total for value in (x, y, depth)]
    size = [
        np.sqrt(1 + 12 * np.bincount(group, weight * (value - centre[group]) ** 2) / total)
        for value, centre in ((x, mean[0]), (y, mean[1]))
    ]
    return np.stack(mean + [np.bincount(group, lights[:, c]) for c in (3, 4, 5)] + size, axis=1)


def _batches(boxes: np.ndarray, planes: int) -> list[np.ndarray]:
    """Return the indices of lights whose PSF images are in memory together, at least one per batch."""
    pixels = (boxes[:, 1] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 2])
    order = np.flatnonzero(pixels)
    batch = np.cumsum(pixels[order]) * planes // _FLOATS
    return [order[batch == number] for number in np.unique(batch)]


def _intersect_mask(boxes: np.ndarray, rays_mask: np.ndarray) -> np.ndarray:
    """Return which boxes contain a pixel of the mask, (N,)."""
    sums = np.pad(rays_mask.cumsum(0, dtype=np.int64).cumsum(1), ((1, 0), (1, 0)))
    top, bottom, left, right = boxes.T
    inside = sums[bottom, right] - sums[top, right] - sums[bottom, left] + sums[top, left]
    return np.asarray(inside > 0)


def add_lights(
    lights: np.ndarray,
    cells: np.ndarray,
    rays_mask: np.ndarray,
    bins: DefocusBins,
    aperture: Aperture,
    result: np.ndarray,
    *,
    lens_response: LensResponse | None = None,
    viewport: Viewport | None = None,
    progress: Callable[[float], None] | None = None,
) -> None:
    """Add every light's disc to the pixels of ``rays_mask`` that see it past nearer surfaces.

    Args:
        lights: From :func:`separate_lights`, (N, 8).
        cells: Surfaces that can occlude them, from
            :func:`bokehnet.classical.layered.march.intersection.layer_cells`.
        rays_mask: Pixels to add to, (H, W) bool.
        bins: From :func:`bokehnet.classical.layered.march.defocus_bins.occupied_bins`.
        aperture: Shape of the discs.
        result: Changed in place, (H, W, 3), float32.
        lens_response: Response of the lens; default: a perfect lens.
        viewport: Position of the arrays in the shown picture; default: they are all of it.
        progress: Callback that receives the completed fraction of the lights, 0 to 1.
    """
    if not len(lights):
        return
    frame = (viewport or Viewport.whole(*rays_mask.shape)).frame
    if lens_response is None or lens_response.is_ideal:
        psf: PerfectPsf | AberratedPsf = PerfectPsf(aperture, lights, frame)
    else:
        psf = AberratedPsf(aperture, lens_response, lights, frame)
    boxes = place_psf_images(lights, psf.margins, rays_mask.shape)
    boxes[~_intersect_mask(boxes, rays_mask)] = 0
    batches = _batches(boxes, psf.planes)
    for number, batch in enumerate(batches, 1):
        size = (boxes[batch, 1] - boxes[batch, 0]) * (boxes[batch, 3] - boxes[batch, 2])
        starts = np.cumsum(size) - size
        psf_images = np.zeros((size.sum(), psf.planes), np.float32)
        with parallel_region:
            psf.fill(batch, boxes[batch], starts, psf_images)
            splat_psf_images(lights[batch], boxes[batch], starts, psf_images, cells, rays_mask, bins, result)
        if progress is not None:
            progress(number / len(batches))
