"""A picture and its defocus at a multiple of their size, reduced to pixels of one or two surfaces.

A renderer filters the fine picture too, so fine pixels at edges are mixtures themselves. They are parted
first, as pixels of any picture are (:mod:`bokehnet.classical.layered.boundaries.unmixing`). Where the parts
that a coarse pixel is made of leave a gap in defocus, those before and behind the widest one are two
surfaces: coverage is their share, colours are their means. So both add up to the light of the pixel.
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
def _insert(depths, weights, colors, count, depth, weight, color):  # type: ignore[no-untyped-def]
    """Insert a part into the ``count`` ones that are sorted front to back."""
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
def _widest_gap(depths, count, least):  # type: ignore[no-untyped-def]
    """Number of parts before the widest gap, 0 where none is wider than ``least``."""
    before = 0
    for i in range(1, count):
        if depths[i - 1] - depths[i] > least:
            least, before = depths[i - 1] - depths[i], i
    return before


@njit(cache=True)
def _mean(depths, weights, colors, first, last, color):  # type: ignore[no-untyped-def]
    """Write the mean colour of parts; return their mean depth and their weight."""
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
def _reduce(image, defocus, index, parted, surfaces, factor, least, small, values, colors, found):  # type: ignore[no-untyped-def]
    """Fill picture, defocus, colours (H, W, 2, 3) and near, far, coverage (H, W, 3), -1 where it is one."""
    height, width = values.shape
    share = 1.0 / (factor * factor)
    for y in prange(height):
        depths, weights = np.empty(2 * factor * factor), np.empty(2 * factor * factor)
        parts, color = np.empty((2 * factor * factor, 3)), np.empty(3)
        for x in range(width):
            count = 0
            for number in range(factor * factor):
                v, u = y * factor + number // factor, x * factor + number % factor
                i = index[v, u]
                if i < 0:
                    _insert(depths, weights, parts, count, defocus[v, u], share, image[v, u])
                    count += 1
                    continue
                for side in range(2):
                    covered = surfaces[i, 2] if side == 0 else 1.0 - surfaces[i, 2]
                    if covered > 0.0:
                        weight = share * covered
                        _insert(depths, weights, parts, count, surfaces[i, side], weight, parted[i, side])
                        count += 1
            depth, _ = _mean(depths, weights, parts, 0, count, color)
            small[y, x], values[y, x], found[y, x, 2] = color, depth, -1.0
            before = _widest_gap(depths, count, least)
            if before > 0:
                near, coverage = _mean(depths, weights, parts, 0, before, color)
                colors[y, x, 0] = color
                far, rest = _mean(depths, weights, parts, before, count, color)
                colors[y, x, 1] = color
                coverage /= coverage + rest
                found[y, x, 0], found[y, x, 1], found[y, x, 2] = near, far, coverage
                values[y, x] = near if coverage >= 0.5 else far


def reduce_supersampled(
    image: np.ndarray, defocus: np.ndarray, factor: int, pixel_filter: PixelFilter | None
) -> tuple[np.ndarray, np.ndarray, KnownSurfaces]:
    """Reduce a picture and its defocus to pixels of one or two surfaces.

    Args:
        image: Scene-linear, (factor H, factor W, 3), float32.
        defocus: Signed blur radius of the same pixels, in such pixels, + in front of focus, float32.
        factor: Fine pixels of a pixel along each side.
        pixel_filter: Of the fine picture; None where each of its pixels shows one surface.

    Returns:
        Picture (H, W, 3), each pixel the mean of its samples; defocus (H, W) in its pixels, where there are
        two surfaces that of the one which covers more; and both surfaces of those pixels.
    """
    height, width = defocus.shape[0] // factor, defocus.shape[1] // factor
    index = np.full(defocus.shape, -1, np.int32)
    parted, surfaces = np.empty((0, 2, 3), np.float32), np.empty((0, 3), np.float32)
    if pixel_filter is not None:
        reach = int(np.ceil(np.abs(defocus).max()))
        lights = are_lights(image, light_limit(image, reach))
        defocus, mixed = find_mixed_pixels(image, defocus, lights, pixel_filter)
        index[mixed.rows, mixed.columns] = np.arange(len(mixed.rows), dtype=np.int32)
        parted = np.stack([mixed.front, mixed.back], 1)
        surfaces = np.stack([mixed.near, mixed.far, mixed.coverage], 1)
    small, values = np.empty((height, width, 3), np.float32), np.empty((height, width), np.float32)
    colors, found = np.empty((height, width, 2, 3), np.float32), np.empty((height, width, 3), np.float32)
    arrays = (image, defocus, index, parted, surfaces, factor, factor * DISCONTINUITY_THRESHOLD)
    with parallel_region:
        _reduce(*arrays, small, values, colors, found)
    y, x = np.nonzero(found[..., 2] >= 0)
    near, far, coverage = found[y, x].T
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
    return small, values / np.float32(factor), known
