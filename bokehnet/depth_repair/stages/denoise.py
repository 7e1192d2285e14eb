"""Noise and wrong single pixels of a map, as from sensors, stereo and renders with few samples: removal.

Noise makes blur radii uneven and, if it is as high as depth edges, creates false edges.

Method: joint bilateral filter (Tomasi and Manduchi, "Bilateral filtering for gray and color images", ICCV
1998) in two passes, the first with distant samples: errors of stereo matching are shared by the pixels of a
window, so that near samples do not average them. It smooths no colour edges, so that faint depth edges stay.
The second pass averages over colours: in fine texture the first one finds too few similar pixels.

In: the picture, scene-linear (H, W, 3), and the map (H, W), any unit. Out: the map in the same unit.
"""

import math

import numpy as np

from bokehnet.depth_repair.config import COLOR_SIGMA
from bokehnet.depth_repair.filters import joint_bilateral
from bokehnet.optics.encoding import encode

__all__ = ["denoise_map", "without_outliers"]

# Half width of the window in samples, also the distance of the samples in the first pass, pixels; and
# standard deviation of disparities, in those of the noise.
_RADIUS, _SIGMAS = 3, 2.0

# Half width of the window around a wrong pixel, and bounds of the fraction of such pixels: exact maps have up
# to 0.0003, and above the upper bound they are the content.
_WINDOW_PX, _MIN_OUTLIERS, _MAX_OUTLIERS = 2, 0.0005, 0.01


def denoise_map(image: np.ndarray, disparity: np.ndarray, deviation: float) -> np.ndarray:
    """Return the map without noise, (H, W) float32.

    Args:
        image: All-in-focus picture, scene-linear, not negative, (H, W, 3).
        disparity: Map, (H, W), float32, any unit.
        deviation: Standard deviation of the noise, in the unit of the map.
    """
    colors = np.asarray(encode(image), np.float32)
    for spacing, color_sigma in ((_RADIUS, COLOR_SIGMA), (1, math.inf)):
        disparity = joint_bilateral(
            colors, disparity, _RADIUS, color_sigma, _SIGMAS * deviation, spacing=spacing
        )
    return disparity


def without_outliers(image: np.ndarray, disparity: np.ndarray, min_error: float) -> np.ndarray:
    """Return the map without wrong single pixels, (H, W) float32: the argument itself if there are none.

    A pixel is wrong if it differs from an otherwise even window of 5x5 pixels, but its colour does not differ
    from that of all its neighbours. It gets the value of the neighbour of the nearest colour.

    Args:
        image: All-in-focus picture, scene-linear, not negative, (H, W, 3).
        disparity: Map, (H, W), float32, any unit.
        min_error: Minimum error of a wrong pixel, in the unit of the map.
    """
    size = _WINDOW_PX
    if min(disparity.shape) <= 2 * size:
        return disparity
    inner = disparity[size:-size, size:-size]
    differs = np.ones(inner.shape, bool)
    for axis in (0, 1):
        step = np.abs(np.diff(disparity, axis=axis)) > min_error
        lines = [slice(size, -size)] * 2
        for first in (size - 1, size):
            lines[axis] = slice(first, first + inner.shape[axis])
            differs &= step[tuple(lines)]
    y, x = (places[:, None] + size for places in np.nonzero(differs))
    down, right = (part.ravel() - size for part in np.indices((2 * size + 1, 2 * size + 1)))
    others = (down != 0) | (right != 0)
    is_even = np.ptp(disparity[y + down[others], x + right[others]], axis=1) < min_error
    y, x = y[is_even], x[is_even]
    near = others & (np.maximum(abs(down), abs(right)) == 1)
    rows, columns = y + down[near], x + right[near]
    distance = np.linalg.norm(encode(image[rows, columns]) - encode(image[y, x]), axis=-1)
    alike = np.flatnonzero(distance.min(1) < COLOR_SIGMA)
    if not _MIN_OUTLIERS <= len(alike) / disparity.size <= _MAX_OUTLIERS:
        return disparity
    result = disparity.copy()
    nearest = distance[alike].argmin(1)
    result[y[alike, 0], x[alike, 0]] = disparity[rows[alike, nearest], columns[alike, nearest]]
    return result
