"""Steps of a map put where the picture's colours part: pixels take the disparity of those that look alike.

A step that the map shows as a ramp was placed by nobody: halfway up is a guess. Around such pixels the
picture tells more. Each takes the median of the disparities around it, weighted by how much their colours
are like its own; a second pass over fewer pixels smooths what the first left rough, and a third, which cares
less for colours, takes out what stands alone.

Source: Ma, He, Wei, Sun and Wu, "Constant time weighted median filtering for stereo matching and beyond",
ICCV 2013, for the median guided by a picture. Where it is used is ours.
"""

import math

import numpy as np
from numba import prange

from bokehnet.arrays.row_blocks import make_in_row_blocks
from bokehnet.classical.parallel import parallel_region
from bokehnet.depth_repair.stages.edge_sharpening import SLOPE_HALO, STEP, extremes, on_slopes, with_halo
from bokehnet.kernels import njit
from bokehnet.optics.encoding import encode

__all__ = ["settle_soft_steps", "soft_steps"]

# Passes: half width of the window, pixels, and deviation of colours that look alike, of encoded values, all
# three together. The last takes out what stands alone.
_PASSES = ((7, 0.03), (4, 0.03), (2, 0.12))

# Levels between the lowest and the highest disparity around, in which the median is found.
_LEVELS = 24

# Between the extremes, in shares of the step, from which on a pixel stands on a ramp; half the width of the
# window for those, and by how much ramps are made wider.
_BETWEEN, _RAMP, _AROUND = 0.15, 3, 2


def soft_steps(disparity: np.ndarray) -> np.ndarray:
    """Where the steps of a map (H, W) are ramps, (H, W) bool."""
    least = STEP * float(np.ptp(disparity))

    def make(rows: slice) -> np.ndarray:
        window, inner = with_halo(rows, SLOPE_HALO + _AROUND)
        values = disparity[window]
        low, high = extremes(values, _RAMP)
        between = np.minimum(high - values, values - low) > _BETWEEN * (high - low)
        ramps = between & (high - low > least)
        ramps &= ~on_slopes(values, ramps)
        found: np.ndarray = extremes(ramps.astype(np.uint8), _AROUND)[1][inner] > 0
        return found

    return make_in_row_blocks(make, disparity.shape, np.bool_)


@njit(cache=True, parallel=True)
def _settle(colors, disparity, soft, least, reach, alike, result):  # type: ignore[no-untyped-def]
    """Fill ``result`` with the weighted medians at soft pixels, and with the map elsewhere."""
    height, width = disparity.shape
    sharpness = -0.5 / (alike * alike)
    for y in prange(height):
        weights, sums = np.empty(_LEVELS), np.empty(_LEVELS)
        for x in range(width):
            result[y, x] = disparity[y, x]
            if not soft[y, x]:
                continue
            top, bottom = max(0, y - reach), min(height, y + reach + 1)
            left, right = max(0, x - reach), min(width, x + reach + 1)
            low = high = disparity[y, x]
            for v in range(top, bottom):
                for u in range(left, right):
                    low, high = min(low, disparity[v, u]), max(high, disparity[v, u])
            if high - low <= least:
                continue
            weights[:], sums[:] = 0.0, 0.0
            scale, total = (_LEVELS - 1e-3) / (high - low), 0.0
            for v in range(top, bottom):
                for u in range(left, right):
                    away = 0.0
                    for c in range(3):
                        away += (colors[v, u, c] - colors[y, x, c]) ** 2
                    weight = math.exp(sharpness * away)
                    level = int((disparity[v, u] - low) * scale)
                    weights[level] += weight
                    sums[level] += weight * disparity[v, u]
                    total += weight
            passed = 0.0
            for level in range(_LEVELS):
                passed += weights[level]
                if passed >= 0.5 * total:
                    result[y, x] = sums[level] / weights[level]
                    break


def settle_soft_steps(image: np.ndarray, disparity: np.ndarray, soft: np.ndarray, span: float) -> np.ndarray:
    """Give the pixels of soft steps the disparity of what looks like them.

    Args:
        image: All-in-focus picture, scene-linear, (H, W, 3).
        disparity: With steps made sharp, (H, W), float32.
        soft: Where steps were ramps, (H, W) bool.
        span: Of the whole map.

    Returns:
        (H, W), float32; within what the map holds around each pixel.
    """
    colors = np.asarray(encode(image), np.float32)
    with parallel_region:
        for reach, alike in _PASSES:
            result = np.empty_like(disparity)
            _settle(colors, disparity, soft, STEP * span, reach, alike, result)
            disparity = result
    return disparity
