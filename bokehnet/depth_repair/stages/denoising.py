"""Noise of a map, as from sensors and renders with few samples: estimate and removal.

Noise makes blur radii uneven and, if it is as high as depth edges, creates false edges.

Method: the noise level is the median absolute deviation of the finest diagonal Haar details (Donoho and
Johnstone, "Ideal spatial adaptation by wavelet shrinkage", Biometrika 1994). A joint bilateral filter removes
the noise: each pixel becomes the mean of its window, weighted by the similarity of colour and of disparity
(Tomasi and Manduchi, "Bilateral filtering for gray and color images", ICCV 1998). A second pass assumes half
the noise. Depth edges and colour edges are not smoothed.

In: the picture, scene-linear (H, W, 3), and the map (H, W), any unit. Out: the map in the same unit.
"""

import math

import numpy as np
from numba import prange

from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit
from bokehnet.optics.encoding import encode

__all__ = ["denoise_map", "is_noisy", "noise_level"]

# Lower and upper bound of the noise that is removed: standard deviation as a fraction of the range of the
# map. Above the upper bound, edges and noise cannot be separated. Maps without noise have up to 0.0014,
# degraded or not.
_MIN_NOISE, _MAX_NOISE = 0.003, 0.1

# Minimum side of a map whose noise is estimated, pixels, and approximate maximum number of details used.
_MIN_SIDE_PX, _MAX_DETAILS = 32, 2**18

# Median of the absolute value of standard normal deviates.
_NORMAL_MEDIAN = 0.6745

# Bilateral filter: half width of the window, pixels; standard deviation of encoded colours, Euclidean
# distance of three channels; standard deviations of disparities in each pass, in standard deviations of the
# noise.
_RADIUS_PX, _COLOR_SIGMA, _DISPARITY_SIGMAS = 3, 0.06, (2.5, 1.25)


def noise_level(disparity: np.ndarray) -> float:
    """Return the standard deviation of the noise of a map, as a fraction of its range.

    Args:
        disparity: Map, (H, W), any unit.

    Returns:
        Noise level; 0 if the map is constant or a side is shorter than 32 pixels.

    Examples:
        >>> slope = np.tile(np.linspace(0, 1, 256), (256, 1))
        >>> noise_level(slope) < 1e-6
        True
        >>> round(noise_level(slope + 0.02 * np.random.default_rng(0).standard_normal(slope.shape)), 3)
        0.018
    """
    span = float(np.ptp(disparity))
    if span == 0 or min(disparity.shape) < _MIN_SIDE_PX:
        return 0.0
    height, width = (side // 2 for side in disparity.shape)
    stride = 2 * math.ceil(math.sqrt(height * width / _MAX_DETAILS))
    top_left, top_right, c, bottom_right = (
        disparity[y : 2 * height : stride, x : 2 * width : stride] for y in (0, 1) for x in (0, 1)
    )
    return float(np.median(np.abs(top_left - top_right - c + bottom_right))) / (2 * _NORMAL_MEDIAN * span)


def is_noisy(level: float) -> bool:
    """Return whether noise of this level, as a fraction of the range of the map, is removed."""
    return _MIN_NOISE < level < _MAX_NOISE


@njit(cache=True, parallel=True)
def _smooth(colors, disparity, deviation, result):  # type: ignore[no-untyped-def]
    """Fill ``result`` with bilateral means; ``deviation`` is the standard deviation of disparities."""
    height, width = disparity.shape
    color_factor, disparity_factor = -0.5 / _COLOR_SIGMA**2, -0.5 / deviation**2
    for y in prange(height):
        for x in range(width):
            centre, total, weights = disparity[y, x], 0.0, 0.0
            for v in range(max(0, y - _RADIUS_PX), min(height, y + _RADIUS_PX + 1)):
                for u in range(max(0, x - _RADIUS_PX), min(width, x + _RADIUS_PX + 1)):
                    distance_squared = 0.0
                    for c in range(3):
                        distance_squared += (colors[v, u, c] - colors[y, x, c]) ** 2
                    offset = disparity[v, u] - centre
                    weight = math.exp(color_factor * distance_squared + disparity_factor * offset * offset)
                    total += weight * offset
                    weights += weight
            result[y, x] = centre + total / weights


def denoise_map(image: np.ndarray, disparity: np.ndarray, deviation: float) -> np.ndarray:
    """Return the map without noise, (H, W) float32.

    Args:
        image: All-in-focus picture, scene-linear, not negative, (H, W, 3).
        disparity: Map, (H, W), float32, any unit.
        deviation: Standard deviation of the noise, in the unit of the map.
    """
    colors = np.asarray(encode(image), np.float32)
    with parallel_region:
        for sigma in _DISPARITY_SIGMAS:
            result = np.empty_like(disparity)
            _smooth(colors, disparity, sigma * deviation, result)
            disparity = result
    return disparity
