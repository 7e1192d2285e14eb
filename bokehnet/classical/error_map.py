"""Geometric error map: pixels within the blur's reach of a depth discontinuity."""

import math

import numpy as np
from numba import prange

from bokehnet.checks import check_map
from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit

__all__ = ["boundary_threshold", "geometric_error_map"]


@njit(cache=True, parallel=True)
def _boundary_reach(nearest, farthest, radii, threshold, softness):
    """Return the largest of ``radii`` in the 3x3 window of boundary pixels plus ``softness``, 0 elsewhere."""
    height, width = nearest.shape
    reach = np.zeros((height, width), np.float32)
    for y in prange(height):
        for x in range(width):
            low, high = farthest[y, x], nearest[y, x]
            for v in range(max(0, y - 1), min(height, y + 2)):
                for u in range(max(0, x - 1), min(width, x + 2)):
                    low = min(low, farthest[v, u])
                    high = max(high, nearest[v, u])
            if high - low <= threshold:
                continue
            radius = np.float32(1.0)
            for v in range(max(0, y - 1), min(height, y + 2)):
                for u in range(max(0, x - 1), min(width, x + 2)):
                    radius = max(radius, radii[v, u])
            reach[y, x] = radius + softness
    return reach


@njit(cache=True)
def _cover_discs(reach):
    """Return the number of discs over each pixel minus those over the pixel to its left, (H, W + 1)."""
    height, width = reach.shape
    counts = np.zeros((height, width + 1), np.int32)
    for y in range(height):
        for x in range(width):
            radius = float(reach[y, x])
            if radius <= 0.0:
                continue
            rows = int(math.floor(min(radius, height)))
            for row in range(max(0, y - rows), min(height, y + rows + 1)):
                half = int(math.floor(min(math.sqrt(radius * radius - (row - y) ** 2), width)))
                counts[row, max(0, x - half)] += 1
                counts[row, min(width, x + half + 1)] -= 1
    return counts


@njit(cache=True, parallel=True)
def _sum_rows(differences):
    """Integrate differences along the rows, in place."""
    for y in prange(differences.shape[0]):
        for x in range(1, differences.shape[1]):
            differences[y, x] += differences[y, x - 1]


@njit(cache=True, parallel=True)
def _soften(counts, reach):
    """Return the fraction of covered pixels in the (2 reach + 1)^2 window around each; borders repeat."""
    height, width = counts.shape
    result = np.empty((height, width), np.float32)
    for y in prange(height):
        columns = np.zeros(width, np.int64)
        for v in range(y - reach, y + reach + 1):
            row = min(max(v, 0), height - 1)
            for x in range(width):
                columns[x] += counts[row, x] > 0
        for x in range(width):
            total = 0
            for u in range(x - reach, x + reach + 1):
                total += columns[min(max(u, 0), width - 1)]
            result[y, x] = total / (2 * reach + 1) ** 2
    return result


def boundary_threshold(size: tuple[int, ...]) -> float:
    """Return the defocus span in pixels above which a 3x3 window of a picture of this size is a boundary."""
    return max(0.5, min(size) / 1000)


def geometric_error_map(
    defocus: np.ndarray,
    threshold: float | None = None,
    softness: int = 2,
    farthest: np.ndarray | None = None,
    radii: np.ndarray | None = None,
) -> np.ndarray:
    """Return the map of pixels that a depth discontinuity can reach.

    A pixel is on a boundary if the defocus in its 3x3 window spans more than ``threshold``; each boundary
    pixel marks a disc of the larger radius in its window; the edge of the mask is softened.

    Args:
        defocus: Signed blur radius in pixels, (H, W); of the nearer surface where pixels show two.
        threshold: Span in pixels; default :func:`boundary_threshold`.
        softness: Half-width in pixels of the soft edge, which is outside the mask.
        farthest: Defocus of the farther surface, (H, W); default: pixels show one surface.
        radii: Distance in pixels that the light of each pixel reaches, (H, W); default: the larger blur
            radius of its surfaces.

    Returns:
        Map (H, W) float32 in [0, 1]; 1 within reach of a boundary, 0 where the scatter is right.

    Raises:
        ShapeError, ParameterError: ``defocus`` is not (H, W) or not finite.

    Source:
        Peng et al., "BokehMe: When neural rendering meets classical rendering", CVPR 2022.
    """
    check_map("defocus", defocus)
    if threshold is None:
        threshold = boundary_threshold(defocus.shape)
    defocus = np.ascontiguousarray(defocus, np.float32)
    farthest = defocus if farthest is None else np.ascontiguousarray(farthest, np.float32)
    if radii is None:
        radii = np.maximum(np.abs(defocus), np.abs(farthest))
    with parallel_region:
        counts = _cover_discs(_boundary_reach(defocus, farthest, radii, threshold, softness))
        _sum_rows(counts)
        softened: np.ndarray = _soften(counts[:, :-1], softness)
    return softened
