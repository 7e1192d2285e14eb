"""Filters that several stages of the repair share: local extremes, morphology, bilateral and weighted median.

In: maps (H, W), any unit; the joint filters need the encoded picture, (H, W, 3). Out: maps of the same size.
"""

import math

import numpy as np
from numba import prange

from bokehnet.arrays.row_blocks import make_in_row_blocks
from bokehnet.arrays.square_windows import reduce_windows
from bokehnet.classical.parallel import parallel_region
from bokehnet.depth_repair.config import MEDIAN_BINS
from bokehnet.kernels import njit

__all__ = [
    "extend_rows",
    "joint_bilateral",
    "local_extremes",
    "shift_edges",
    "translate_map",
    "weighted_median",
]


def local_extremes(values: np.ndarray, radius: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the smallest and the largest value of the square window around each pixel.

    Args:
        values: Array, (H, W); its border is repeated.
        radius: Half width of the window, pixels.
    """
    return reduce_windows(values, radius, np.minimum), reduce_windows(values, radius, np.maximum)


def extend_rows(rows: slice, halo: int) -> tuple[slice, slice]:
    """Return rows extended by ``halo`` rows on both sides, clipped at the top, and the rows inside these."""
    top = max(0, rows.start - halo)
    return slice(top, rows.stop + halo), slice(rows.start - top, rows.stop - top)


def shift_edges(disparity: np.ndarray, pixels: int) -> np.ndarray:
    """Return the map with foreground regions grown by some pixels (dilation), or shrunk (erosion).

    Args:
        disparity: Map, (H, W), any unit, rising towards the camera.
        pixels: Half width of the square window, pixels; negative to shrink.

    Source:
        Serra, "Image Analysis and Mathematical Morphology", 1982.
    """
    if pixels == 0:
        return disparity
    radius, reduce = abs(pixels), np.maximum if pixels > 0 else np.minimum

    def make(rows: slice) -> np.ndarray:
        window, inner = extend_rows(rows, radius)
        return reduce_windows(disparity[window], radius, reduce)[inner]

    return make_in_row_blocks(make, disparity.shape, np.float32)


def translate_map(disparity: np.ndarray, offset: tuple[int, int]) -> np.ndarray:
    """Return the map translated by whole pixels, with its border repeated.

    Args:
        disparity: Map, (H, W), any unit.
        offset: Translation down and to the right, pixels.
    """
    if offset == (0, 0):
        return disparity
    rows, columns = (
        np.clip(np.arange(side) - pixels, 0, side - 1)
        for side, pixels in zip(disparity.shape, offset, strict=True)
    )
    return disparity[np.ix_(rows, columns)]


@njit(cache=True, parallel=True)
def _bilateral(colors, disparity, radius, spacing, color_sigma, deviation, result):  # type: ignore[no-untyped-def]
    """Fill ``result`` with bilateral means; arguments as for :func:`joint_bilateral`."""
    height, width = disparity.shape
    color_factor, disparity_factor = -0.5 / color_sigma**2, -0.5 / deviation**2
    for y in prange(height):
        for x in range(width):
            centre, total, weights = disparity[y, x], 0.0, 0.0
            top, left = y - spacing * min(radius, y // spacing), x - spacing * min(radius, x // spacing)
            for v in range(top, min(height, y + spacing * radius + 1), spacing):
                for u in range(left, min(width, x + spacing * radius + 1), spacing):
                    distance_squared = 0.0
                    for c in range(3):
                        distance_squared += (colors[v, u, c] - colors[y, x, c]) ** 2
                    offset = disparity[v, u] - centre
                    weight = math.exp(color_factor * distance_squared + disparity_factor * offset * offset)
                    total += weight * offset
                    weights += weight
            result[y, x] = centre + total / weights


def joint_bilateral(
    colors: np.ndarray,
    disparity: np.ndarray,
    radius: int,
    color_sigma: float,
    deviation: float,
    spacing: int = 1,
) -> np.ndarray:
    """Return the mean of each window, weighted by the similarity of colour and disparity, (H, W) float32.

    Args:
        colors: Encoded picture, (H, W, 3).
        disparity: Map, (H, W), float32, any unit.
        radius: Half width of the window, in samples.
        color_sigma: Standard deviation of encoded colours, Euclidean distance of three channels.
        deviation: Standard deviation of disparities, in the unit of the map.
        spacing: Distance of samples of the window, pixels.

    Source:
        Tomasi and Manduchi, "Bilateral filtering for gray and color images", ICCV 1998. Windows with spacing:
        Dammertz, Sewtz, Hanika and Lensch, "Edge-avoiding à-trous wavelet transform for fast global
        illumination filtering", HPG 2010.
    """
    result = np.empty_like(disparity)
    with parallel_region:
        _bilateral(colors, disparity, radius, spacing, color_sigma, deviation, result)
    return result


@njit(cache=True, parallel=True)
def _weighted_medians(colors, disparity, mask, min_height, radius, color_sigma, result):  # type: ignore[no-untyped-def]
    """Fill ``result`` with weighted medians at masked pixels and with the map elsewhere."""
    height, width = disparity.shape
    color_factor = -0.5 / (color_sigma * color_sigma)
    for y in prange(height):
        weights, sums = np.empty(MEDIAN_BINS), np.empty(MEDIAN_BINS)
        for x in range(width):
            result[y, x] = disparity[y, x]
            if not mask[y, x]:
                continue
            top, bottom = max(0, y - radius), min(height, y + radius + 1)
            left, right = max(0, x - radius), min(width, x + radius + 1)
            low = high = disparity[y, x]
            for v in range(top, bottom):
                for u in range(left, right):
                    low, high = min(low, disparity[v, u]), max(high, disparity[v, u])
            if high - low <= min_height:
                continue
            weights[:], sums[:] = 0.0, 0.0
            scale, total = (MEDIAN_BINS - 1e-3) / (high - low), 0.0
            for v in range(top, bottom):
                for u in range(left, right):
                    distance_squared = 0.0
                    for c in range(3):
                        distance_squared += (colors[v, u, c] - colors[y, x, c]) ** 2
                    weight = math.exp(color_factor * distance_squared)
                    index = int((disparity[v, u] - low) * scale)
                    weights[index] += weight
                    sums[index] += weight * disparity[v, u]
                    total += weight
            cumulative = 0.0
            for index in range(MEDIAN_BINS):
                cumulative += weights[index]
                if cumulative >= 0.5 * total:
                    result[y, x] = sums[index] / weights[index]
                    break


def weighted_median(
    colors: np.ndarray,
    disparity: np.ndarray,
    mask: np.ndarray,
    radius: int,
    color_sigma: float,
    min_height: float,
) -> np.ndarray:
    """Return the map with the median of each masked pixel's window, weighted by the similarity of colours.

    Args:
        colors: Encoded picture, (H, W, 3).
        disparity: Map, (H, W), float32, any unit.
        mask: Pixels to filter, (H, W), bool.
        radius: Half width of the window, pixels.
        color_sigma: Standard deviation of encoded colours, Euclidean distance of three channels.
        min_height: Minimum range of a window, in the unit of the map; others do not change.

    Source:
        Ma, He, Wei, Sun and Wu, "Constant time weighted median filtering for stereo matching and beyond",
        ICCV 2013.
    """
    result = np.empty_like(disparity)
    with parallel_region:
        _weighted_medians(colors, disparity, mask, min_height, radius, color_sigma, result)
    return result
