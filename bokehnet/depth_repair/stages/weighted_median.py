"""Weighted median: move the soft edges of a map to the colour edges of its picture.

The position of an edge inside a ramp is unknown, and the middle is only a guess; the picture has more
information.

Method: weighted median filter (Ma, He, Wei, Sun and Wu, "Constant time weighted median filtering for stereo
matching and beyond", ICCV 2013). Each pixel on a ramp becomes the median of the disparities in its window,
weighted by the similarity of colours. A second pass in a smaller window smooths the edges; a third pass, with
a larger colour tolerance, removes isolated pixels. The restriction to ramps is ours.

In: the picture, scene-linear (H, W, 3), and the map (H, W), any unit. Out: the map in the same unit.
"""

import math

import numpy as np
from numba import prange

from bokehnet.arrays.row_blocks import make_in_row_blocks
from bokehnet.classical.parallel import parallel_region
from bokehnet.depth_repair.stages.edge_sharpening import (
    MIN_EDGE_HEIGHT,
    SLOPE_HALO_PX,
    extend_rows,
    local_extremes,
    slope_mask,
)
from bokehnet.kernels import njit
from bokehnet.optics.encoding import encode

__all__ = ["blurred_edge_mask", "snap_blurred_edges"]

# Passes: half width of the window, pixels, and standard deviation of encoded colours, Euclidean distance of
# three channels.
_PASSES = ((7, 0.03), (4, 0.03), (2, 0.12))

# Number of histogram bins between the lowest and the highest disparity in a window, for the median.
_BINS = 24

# Ramps: minimum distance from both extremes, as a fraction of the edge height; half width of the window for
# the extremes, pixels; dilation of ramps, pixels.
_MIN_DISTANCE_FROM_EXTREMES, _RAMP_RADIUS_PX, _DILATION_PX = 0.15, 3, 2


def blurred_edge_mask(disparity: np.ndarray) -> np.ndarray:
    """Return the pixels on and near ramps of a map, (H, W), bool.

    Args:
        disparity: Map, (H, W), any unit.
    """
    min_height = MIN_EDGE_HEIGHT * float(np.ptp(disparity))

    def make(rows: slice) -> np.ndarray:
        window, inner = extend_rows(rows, SLOPE_HALO_PX + _DILATION_PX)
        values = disparity[window]
        low, high = local_extremes(values, _RAMP_RADIUS_PX)
        between = np.minimum(high - values, values - low) > _MIN_DISTANCE_FROM_EXTREMES * (high - low)
        ramps = between & (high - low > min_height)
        ramps &= ~slope_mask(values, ramps)
        dilated: np.ndarray = local_extremes(ramps.astype(np.uint8), _DILATION_PX)[1][inner] > 0
        return dilated

    return make_in_row_blocks(make, disparity.shape, np.bool_)


@njit(cache=True, parallel=True)
def _weighted_medians(colors, disparity, soft, min_height, radius, color_sigma, result):  # type: ignore[no-untyped-def]
    """Fill ``result`` with weighted medians at soft pixels and with the map elsewhere."""
    height, width = disparity.shape
    color_factor = -0.5 / (color_sigma * color_sigma)
    for y in prange(height):
        weights, sums = np.empty(_BINS), np.empty(_BINS)
        for x in range(width):
            result[y, x] = disparity[y, x]
            if not soft[y, x]:
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
            scale, total = (_BINS - 1e-3) / (high - low), 0.0
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
            for index in range(_BINS):
                cumulative += weights[index]
                if cumulative >= 0.5 * total:
                    result[y, x] = sums[index] / weights[index]
                    break


def snap_blurred_edges(image: np.ndarray, disparity: np.ndarray, soft: np.ndarray, span: float) -> np.ndarray:
    """Return the map with weighted medians at soft edges.

    Args:
        image: All-in-focus picture, scene-linear, (H, W, 3).
        disparity: Map with sharpened edges, (H, W), float32, any unit.
        soft: Pixels on ramps of the input, (H, W), bool.
        span: Range of the whole map, in its unit.

    Returns:
        Map, (H, W), float32; each value lies within the range of its window.
    """
    colors = np.asarray(encode(image), np.float32)
    with parallel_region:
        for radius, color_sigma in _PASSES:
            result = np.empty_like(disparity)
            _weighted_medians(colors, disparity, soft, MIN_EDGE_HEIGHT * span, radius, color_sigma, result)
            disparity = result
    return disparity
