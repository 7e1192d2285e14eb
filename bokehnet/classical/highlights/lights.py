"""Bright lights apart from the rest: found in the picture, and laid out as whole aperture shapes.

A small light fills a wide disc evenly, but only a few of a pixel's rays would find it. So lights that
stand far above their surroundings are taken out of what the rays gather, and each is added to every pixel
of its disc from which it can be seen: its PSF image (:mod:`bokehnet.classical.highlights.psf_images`, or
behind an aberrated lens :mod:`bokehnet.classical.highlights.aberrated_psf`) is splatted
(:mod:`bokehnet.classical.highlights.psf_splatting`).

Source: "Efficient and expressive rendering for real-time defocus blur and bokeh" (dissertation), chapter 5,
for lights apart from the rest, their merging, and visibility of their own; rectangles are ours.
"""

import math
from collections.abc import Callable

import numpy as np
from numba import prange

from bokehnet.classical.base import Place
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

# Sharper lights stay in the picture; from this radius to one pixel more they leave it by and by.
_SMALLEST_RADIUS = 3.0

# At most this share of the pixels are lights, the brightest ones, so that their discs stay affordable.
_MOST = 1 / 20

# Lights are gathered in cells of this share of their radius. Those of less than ``_SMALL`` pixels are powers
# of two, in which rows of few pixels lie evenly.
_CELL, _SMALL = 1 / 16, 6.0

# Numbers of PSF images in memory together.
_FLOATS = 16_000_000


@njit(cache=True, parallel=True)
def _find_lights(colors, depths, coverage, limit, found):  # type: ignore[no-untyped-def]
    """Mark what is blurred, brighter than ``limit`` and not covered by nearer layers, (layers, H, W)."""
    for y in prange(limit.shape[0]):
        for x in range(limit.shape[1]):
            left = np.float32(1.0)
            for layer in range(len(found)):
                share = left * coverage[y, x, layer]
                red, green, blue = colors[y, x, layer]
                bright = max(red, green, blue) > limit[y, x]
                blurred = abs(depths[y, x, layer]) > _SMALLEST_RADIUS
                found[layer, y, x] = share > 0.0 and bright and blurred
                left *= np.float32(1.0) - coverage[y, x, layer]


def separate_lights(
    layers: Layers, max_coc_radius: int | None = None, faintest: float = 0.0, *, overwrite: bool = False
) -> tuple[Layers, np.ndarray]:
    """Part layers into lights and the rest.

    A light is what a pixel has above the limit of its window; the limit's worth stays in the picture. So a
    light that fades goes over into the picture without a step, whichever way the limit moves. Where nearer
    layers cover a part of its pixel, only the share that they leave is its light; where they cover all, it
    stays in its layer.

    Args:
        layers: As split from a picture, or true ones.
        max_coc_radius: Half-width in pixels of the window that a light outshines; default: the largest
            radius.
        faintest: Energy, over the blur radius in pixels, that is left in the picture of each light as it will
            be gathered. What rays that find a light by chance add in noise grows with that ratio.
        overwrite: Whether the lights may be taken out of the colours of ``layers`` itself.

    Returns:
        Layers without lights, and the lights as rows (x, y, defocus, red, green, blue, width, height).
        Lights of like defocus in one small cell are gathered into one, a rectangle of even brightness with
        their energy, their centre and their variance along either axis; of one pixel it is 1 wide and high.
        If more than a twentieth of the pixels are lights, the limit is raised until they are not.
    """
    if max_coc_radius is None:
        max_coc_radius = math.ceil(float(np.abs(layers.defocus).max()))
    limit = light_limit(layers.colors[:, :, 0], max_coc_radius)
    found = np.empty((layers.defocus.shape[2], *limit.shape), np.bool_)
    with parallel_region:
        _find_lights(layers.colors, layers.defocus, layers.coverage, limit, found)
    places, lights = [], []
    for layer in range(len(found)):
        y, x = np.nonzero(found[layer])
        amount = (1.0 - layers.coverage[y, x, :layer]).prod(-1) * layers.coverage[y, x, layer]
        brightness = layers.colors[y, x, layer].max(-1)
        excess = 1.0 - limit[y, x] / brightness
        bound = int(_MOST * limit.size)
        if len(y) > bound:
            value = amount * excess * brightness
            ranked = np.argsort(-value, kind="stable")
            kept = ranked[:bound]
            excess *= 1.0 - value[ranked[bound]] / value
            y, x, amount, excess = y[kept], x[kept], amount[kept], excess[kept]
        excess *= _fade(np.abs(layers.defocus[y, x, layer]) - _SMALLEST_RADIUS)
        color = layers.colors[y, x, layer] * excess[:, None]
        places.append(np.column_stack([y, x, np.full_like(y, layer)]))
        lights.append(np.column_stack([x, y, layers.defocus[y, x, layer], amount[:, None] * color, excess]))
    place, light = np.concatenate(places), np.concatenate(lights).astype(np.float64)
    if faintest > 0:
        light[:, 3:] *= _beyond(light, faintest)[:, None]
    colors = layers.colors if overwrite else layers.colors.copy()
    y, x, layer = place.T
    colors[y, x, layer] -= colors[y, x, layer] * light[:, 6:].astype(np.float32)
    rest = Layers(colors=colors, defocus=layers.defocus, coverage=layers.coverage)
    return rest, _gather(light[:, :6])


def _beyond(lights: np.ndarray, faintest: float) -> np.ndarray:
    """Share of each light that is more than the faintest of its group's radius, (N,)."""
    group = _groups(lights)
    energy = np.bincount(group, lights[:, 3:6].max(axis=1))[group]
    share: np.ndarray = np.maximum(1.0 - faintest * np.abs(lights[:, 2]) / np.maximum(energy, 1e-30), 0.0)
    return share


def _fade(t: np.ndarray) -> np.ndarray:
    """Smooth step from 0 at t = 0 to 1 at t = 1."""
    t = np.minimum(t, 1.0)
    return t * t * (3.0 - 2.0 * t)


def _groups(lights: np.ndarray) -> np.ndarray:
    """Number the lights of like defocus in one cell alike, (N,).

    A cell is a square of whole pixels, at most ``_CELL`` of the radius wide.
    """
    x, y, depth = lights[:, 0], lights[:, 1], np.round(lights[:, 2] / DISCONTINUITY_THRESHOLD)
    cell = np.maximum(np.abs(depth) * DISCONTINUITY_THRESHOLD * _CELL, 1.0)
    cell = np.where(cell < _SMALL, 2.0 ** np.floor(np.log2(cell)), np.floor(cell))
    keys = np.stack([depth, x // cell, y // cell], axis=1)
    _, group = np.unique(keys, axis=0, return_inverse=True)
    return group.reshape(-1)


def _gather(lights: np.ndarray) -> np.ndarray:
    """Make one light of those of one group.

    An even row of n pixels has the variance (n^2 - 1) / 12, so the rectangle is sqrt(12 variance + 1) long.
    """
    lights = lights[lights[:, 3:].max(axis=1) > 0]
    x, y, depth = lights[:, 0], lights[:, 1], lights[:, 2]
    group = _groups(lights)
    weight = lights[:, 3:].max(axis=1)
    total = np.bincount(group, weight)
    mean = [np.bincount(group, weight * value) / total for value in (x, y, depth)]
    size = [
        np.sqrt(1 + 12 * np.bincount(group, weight * (value - centre[group]) ** 2) / total)
        for value, centre in ((x, mean[0]), (y, mean[1]))
    ]
    return np.stack(mean + [np.bincount(group, lights[:, c]) for c in (3, 4, 5)] + size, axis=1)


def _batches(boxes: np.ndarray, planes: int) -> list[np.ndarray]:
    """Numbers of the lights whose PSF images are in memory together, at least one at a time."""
    pixels = (boxes[:, 1] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 2])
    order = np.flatnonzero(pixels)
    batch = np.cumsum(pixels[order]) * planes // _FLOATS
    return [order[batch == number] for number in np.unique(batch)]


def _touched(boxes: np.ndarray, rays_mask: np.ndarray) -> np.ndarray:
    """Which boxes hold a pixel of the mask, (N,)."""
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
    place: Place | None = None,
    progress: Callable[[float], None] | None = None,
) -> None:
    """Add every light's disc to the pixels of ``rays_mask`` that see it past what stands in front.

    Args:
        lights: From :func:`separate_lights`, (N, 8).
        cells: What can stand in front of them, from
            :func:`bokehnet.classical.layered.march.intersection.layer_cells`.
        rays_mask: Pixels to add to, (H, W) bool.
        bins: From :func:`bokehnet.classical.layered.march.defocus_bins.occupied_bins`.
        aperture: Shape of the discs.
        result: Changed in place, (H, W, 3), float32.
        lens_response: Of the lens; default: a perfect one.
        place: Where the arrays lie in the shown picture; default: they are all of it.
        progress: Called with the share of the lights that is done, 0 to 1.
    """
    if not len(lights):
        return
    frame = (place or Place.whole(*rays_mask.shape)).frame
    if lens_response is None or lens_response.is_ideal:
        draw: PerfectPsf | AberratedPsf = PerfectPsf(aperture, lights, frame)
    else:
        draw = AberratedPsf(aperture, lens_response, lights, frame)
    boxes = place_psf_images(lights, draw.margins, rays_mask.shape)
    boxes[~_touched(boxes, rays_mask)] = 0
    batches = _batches(boxes, draw.planes)
    for number, batch in enumerate(batches, 1):
        size = (boxes[batch, 1] - boxes[batch, 0]) * (boxes[batch, 3] - boxes[batch, 2])
        starts = np.cumsum(size) - size
        psf_images = np.zeros((size.sum(), draw.planes), np.float32)
        with parallel_region:
            draw.fill(batch, boxes[batch], starts, psf_images)
            splat_psf_images(lights[batch], boxes[batch], starts, psf_images, cells, rays_mask, bins, result)
        if progress is not None:
            progress(number / len(batches))
