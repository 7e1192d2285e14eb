"""Reduction of a supersampled picture and its defocus to pixels of one or two surfaces.

A renderer filters the fine picture too, so fine pixels at edges are mixtures themselves. They are unmixed
first, like those of any picture (:mod:`bokehnet.classical.layered.boundaries.unmixing`). Where the samples of
a coarse pixel have a gap in defocus, those in front of and behind the widest gap are two surfaces: coverage
is their fraction, colors are their means. The two therefore add up to the light of the pixel.
"""

import numpy as np
from numba import prange

from bokehnet.classical.highlight_detection import are_lights, light_limit
from bokehnet.classical.known_surfaces import KnownSurfaces
from bokehnet.classical.layered.boundaries.mixed_pixels import find_mixed_pixels
from bokehnet.classical.layered.depth_discontinuities import DISCONTINUITY_THRESHOLD
from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit
from bokehnet.optics.pixels.pixel_filter import PixelFilter

__all__ = ["reduce_supersampled"]


@njit(cache=True)
def _insert(depths, weights, colors, count, depth, weight, color):
    """Insert a sample into the ``count`` samples that are sorted front to back."""
    place = count
    while place > 0 and depths[place - 1] < depth:
        depths[place], weights[place] = depths[place - 1], weights[place - 1]
        for c in range(3):
            colors[place, c] = colors[place - 1, c]
        place -= 1
    depths[place], weights[place] = depth, weight
    for c in range(3):
        colors[place, c] = color[c]


@njit(cache=True)
def _widest_gap(depths, count, widest):
    """Return the number of samples in front of the widest gap, 0 if none is wider than ``widest``."""
    before = 0
    for i in range(1, count):
        if depths[i - 1] - depths[i] > widest:
            widest, before = depths[i - 1] - depths[i], i
    return before


@njit(cache=True)
def _mean(depths, weights, colors, first, last, color):
    """Write the mean color of samples; return their mean depth and their total weight."""
    depth = total = 0.0
    color[:] = 0.0
    for i in range(first, last):
        total += weights[i]
        depth += weights[i] * depths[i]
        for c in range(3):
            color[c] += weights[i] * colors[i, c]
    color /= total
    return depth / total, total


@njit(cache=True, parallel=True)
def _reduce(
    image, defocus, index, unmixed, surfaces, factor, min_gap, reduced, values, colors, pixel_surfaces
):
    """Fill picture, defocus, colors (H, W, 2, 3) and near, far, coverage (H, W, 3); -1 for one surface."""
    height, width = values.shape
    sample_weight = 1.0 / (factor * factor)
    for y in prange(height):
        depths, weights = np.empty(2 * factor * factor), np.empty(2 * factor * factor)
        sample_colors, color = np.empty((2 * factor * factor, 3)), np.empty(3)
        for x in range(width):
            count = 0
            for number in range(factor * factor):
                v, u = y * factor + number // factor, x * factor + number % factor
                i = index[v, u]
                if i < 0:
                    _insert(depths, weights, sample_colors, count, defocus[v, u], sample_weight, image[v, u])
                    count += 1
                    continue
                for side in range(2):
                    covered = surfaces[i, 2] if side == 0 else 1.0 - surfaces[i, 2]
                    if covered > 0.0:
                        weight = sample_weight * covered
                        _insert(
                            depths, weights, sample_colors, count, surfaces[i, side], weight, unmixed[i, side]
                        )
                        count += 1
            depth, _ = _mean(depths, weights, sample_colors, 0, count, color)
            reduced[y, x], values[y, x], pixel_surfaces[y, x, 2] = color, depth, -1.0
            front_count = _widest_gap(depths, count, min_gap)
            if front_count > 0:
                near, coverage = _mean(depths, weights, sample_colors, 0, front_count, color)
                colors[y, x, 0] = color
                far, rest = _mean(depths, weights, sample_colors, front_count, count, color)
                colors[y, x, 1] = color
                coverage /= coverage + rest
                pixel_surfaces[y, x, 0], pixel_surfaces[y, x, 1], pixel_surfaces[y, x, 2] = (
                    near,
                    far,
                    coverage,
                )
                values[y, x] = near if coverage >= 0.5 else far


def reduce_supersampled(
    image: np.ndarray, defocus: np.ndarray, factor: int, pixel_filter: PixelFilter | None
) -> tuple[np.ndarray, np.ndarray, KnownSurfaces]:
    """Reduce a picture and its defocus to pixels of one or two surfaces.

    Args:
        image: Scene-linear picture, (factor H, factor W, 3), float32.
        defocus: Signed blur radius of these pixels, in fine pixels, + in front of focus, float32.
        factor: Fine pixels per pixel along each side.
        pixel_filter: Pixel filter of the fine picture; None if each of its pixels shows one surface.

    Returns:
        Picture (H, W, 3), each pixel the mean of its samples; defocus (H, W) in pixels, of the surface with
        more coverage where there are two; and both surfaces of those pixels.
    """
    height, width = defocus.shape[0] // factor, defocus.shape[1] // factor
    index = np.full(defocus.shape, -1, np.int32)
    unmixed, surfaces = np.empty((0, 2, 3), np.float32), np.empty((0, 3), np.float32)
    if pixel_filter is not None:
        reach = int(np.ceil(np.abs(defocus).max()))
        lights = are_lights(image, light_limit(image, reach))
        defocus, mixed = find_mixed_pixels(image, defocus, lights, pixel_filter)
        index[mixed.rows, mixed.columns] = np.arange(len(mixed.rows), dtype=np.int32)
        unmixed = np.stack([mixed.front, mixed.back], 1)
        surfaces = np.stack([mixed.near, mixed.far, mixed.coverage], 1)
    reduced, values = np.empty((height, width, 3), np.float32), np.empty((height, width), np.float32)
    colors, pixel_surfaces = (
        np.empty((height, width, 2, 3), np.float32),
        np.empty((height, width, 3), np.float32),
    )
    arrays = (image, defocus, index, unmixed, surfaces, factor, factor * DISCONTINUITY_THRESHOLD)
    with parallel_region:
        _reduce(*arrays, reduced, values, colors, pixel_surfaces)
    y, x = np.nonzero(pixel_surfaces[..., 2] >= 0)
    near, far, coverage = pixel_surfaces[y, x].T
    known = KnownSurfaces(
        rows=y,
        columns=x,
        near=near / factor,
        far=np.minimum(near, far) / factor,
        coverage=np.clip(coverage, 0, 1),
        front=colors[y, x, 0],
        back=colors[y, x, 1],
        complete=True,
    )
    return reduced, values / np.float32(factor), known
