"""Maps with noise in every pixel, as sensors and few samples give them: how strong it is, and taken out.

Noise makes blur radii uneven and, where it is as high as steps, edges of what is none. Each pixel takes the
mean of those around it, weighted by how much their colours, and their disparities within the noise, are like
its own; so neither steps nor what the picture tells apart is smoothed. A second pass expects half the noise.

Sources: Donoho and Johnstone, "Ideal spatial adaptation by wavelet shrinkage", Biometrika 1994, for the level
by the median of the finest diagonal details. Tomasi and Manduchi, "Bilateral filtering for gray and color
images", ICCV 1998, for the weights.
"""

import math

import numpy as np
from numba import prange

from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit
from bokehnet.optics.encoding import encode

__all__ = ["is_noisy", "noise_level", "without_noise"]

# Deviation of a map's noise, as a share of its range, from which on it is taken out, and from which on nobody
# knows steps from noise. Without noise maps have up to 0.0014, spoilt or not.
_LEAST, _MOST = 0.003, 0.1

# Smallest side of a map whose noise is told, pixels, and how many details of larger ones are looked at.
_SMALLEST, _DETAILS = 32, 2**18

# Median of the size of normal deviates.
_MEDIAN = 0.6745

# Half width of the window, pixels; deviation of colours that look alike, of encoded values, all three
# together; and that of disparities in deviations of the noise, in one pass after the other.
_REACH, _ALIKE, _PASSES = 3, 0.06, (2.5, 1.25)


def noise_level(disparity: np.ndarray) -> float:
    """Deviation of the noise of a map's pixels, as a share of its range.

    Args:
        disparity: (H, W), any unit.

    Returns:
        0 where the map is constant, or smaller than 32 pixels.

    Examples:
        >>> slope = np.tile(np.linspace(0, 1, 256), (256, 1))
        >>> noise_level(slope) < 1e-6
        True
        >>> round(noise_level(slope + 0.02 * np.random.default_rng(0).standard_normal(slope.shape)), 3)
        0.018
    """
    span = float(np.ptp(disparity))
    if span == 0 or min(disparity.shape) < _SMALLEST:
        return 0.0
    height, width = (side // 2 for side in disparity.shape)
    every = 2 * math.ceil(math.sqrt(height * width / _DETAILS))
    a, b, c, d = (disparity[y : 2 * height : every, x : 2 * width : every] for y in (0, 1) for x in (0, 1))
    return float(np.median(np.abs(a - b - c + d))) / (2 * _MEDIAN * span)


def is_noisy(level: float) -> bool:
    """Whether noise of that level is taken out."""
    return _LEAST < level < _MOST


@njit(cache=True, parallel=True)
def _smooth(colors, disparity, deviation, result):  # type: ignore[no-untyped-def]
    """Fill ``result`` with the means of pixels alike, of disparities within that deviation."""
    height, width = disparity.shape
    of_color, of_disparity = -0.5 / _ALIKE**2, -0.5 / deviation**2
    for y in prange(height):
        for x in range(width):
            here, total, weights = disparity[y, x], 0.0, 0.0
            for v in range(max(0, y - _REACH), min(height, y + _REACH + 1)):
                for u in range(max(0, x - _REACH), min(width, x + _REACH + 1)):
                    away = 0.0
                    for c in range(3):
                        away += (colors[v, u, c] - colors[y, x, c]) ** 2
                    above = disparity[v, u] - here
                    weight = math.exp(of_color * away + of_disparity * above * above)
                    total += weight * above
                    weights += weight
            result[y, x] = here + total / weights


def without_noise(image: np.ndarray, disparity: np.ndarray, deviation: float) -> np.ndarray:
    """Return the map (H, W), float32, without noise.

    Args:
        image: All-in-focus picture, scene-linear, not negative, (H, W, 3).
        disparity: (H, W), float32.
        deviation: Of the noise, in the unit of the map.
    """
    colors = np.asarray(encode(image), np.float32)
    with parallel_region:
        for times in _PASSES:
            result = np.empty_like(disparity)
            _smooth(colors, disparity, times * deviation, result)
            disparity = result
    return disparity
