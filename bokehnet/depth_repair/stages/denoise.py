"""Noise and wrong single pixels of a map, as from sensors, stereo and renders with few samples: removal.

Noise makes blur radii uneven and, if it is as high as depth edges, creates false edges.

Method: joint bilateral filter (Tomasi and Manduchi, "Bilateral filtering for gray and color images", ICCV
1998) in two passes, the first with distant samples: errors of stereo matching are shared by the pixels of a
window, so that near samples do not average them. It smooths no colour edges, so that faint depth edges stay.
The second pass averages over colours: in fine texture the first one finds too few similar pixels.

In: the picture, scene-linear (H, W, 3), and the map (H, W), any unit. Out: the map in the same unit.
"""

import math
from itertools import product

import numpy as np

from bokehnet.arrays.row_blocks import make_in_row_blocks
from bokehnet.depth_repair.config import (
    COLOR_SIGMA,
    MAX_WRONG_FRACTION,
    MIN_WRONG_FRACTION,
    NEAR_PX,
    NOISE_RADIUS,
    NOISE_SIGMAS,
)
from bokehnet.depth_repair.filters import extend_rows, joint_bilateral
from bokehnet.optics.encoding import encode

__all__ = ["denoise_map", "without_outliers"]


def denoise_map(image: np.ndarray, disparity: np.ndarray, deviation: float) -> np.ndarray:
    """Return the map without noise, (H, W) float32.

    Args:
        image: All-in-focus picture, scene-linear, not negative, (H, W, 3).
        disparity: Map, (H, W), float32, any unit.
        deviation: Standard deviation of the noise, in the unit of the map.
    """
    colors = np.asarray(encode(image), np.float32)
    for spacing, color_sigma in ((NOISE_RADIUS, COLOR_SIGMA), (1, math.inf)):
        disparity = joint_bilateral(
            colors, disparity, NOISE_RADIUS, color_sigma, NOISE_SIGMAS * deviation, spacing=spacing
        )
    return disparity


def without_outliers(
    image: np.ndarray, disparity: np.ndarray, min_error: float, fraction: float | None = None
) -> tuple[np.ndarray, float]:
    """Return the map without wrong single pixels, and the fraction of pixels that were corrected.

    A pixel is wrong if it differs from an otherwise even window of 5x5 pixels, but its colour does not differ
    from that of all its neighbours. It gets the value of the neighbour of the nearest colour.

    Args:
        image: All-in-focus picture, scene-linear, not negative, (H, W, 3).
        disparity: Map, (H, W), float32, any unit.
        min_error: Minimum error of a wrong pixel, in the unit of the map.
        fraction: Fraction of wrong pixels that decides on the correction; default: that of this map.

    Returns:
        Map, (H, W) float32, which is the argument itself if nothing is corrected; and the fraction.
    """

    def make(rows: slice) -> np.ndarray:
        window, inner = extend_rows(rows, NEAR_PX)
        values = disparity[window].copy()
        y, x, corrected = _wrong_pixels(image[window], values, min_error)
        values[y, x] = corrected
        return values[inner]

    corrected = make_in_row_blocks(make, disparity.shape, np.float32)
    measured = np.count_nonzero(corrected != disparity) / disparity.size
    decisive = measured if fraction is None else fraction
    if measured and MIN_WRONG_FRACTION <= decisive <= MAX_WRONG_FRACTION:
        return corrected, measured
    return disparity, 0.0


def _wrong_pixels(
    image: np.ndarray, disparity: np.ndarray, min_error: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return rows, columns and correct values of wrong pixels; see :func:`without_outliers`."""
    size = NEAR_PX
    differs = np.zeros(disparity.shape, bool)
    inner = slice(size, -size), slice(size, -size)
    differs[inner] = True
    for axis in (0, 1):
        step = np.abs(np.diff(disparity, axis=axis)) > min_error
        lines = list(inner)
        for first in (size - 1, size):
            lines[axis] = slice(first, first + disparity.shape[axis] - 2 * size)
            differs[inner] &= step[tuple(lines)]
    y, x = np.nonzero(differs)
    low, high = np.full(len(y), np.inf), np.full(len(y), -np.inf)
    for down, right in _offsets(size):
        neighbours = disparity[y + down, x + right]
        low, high = np.minimum(low, neighbours), np.maximum(high, neighbours)
    is_even = high - low < min_error
    y, x = y[is_even, None], x[is_even, None]
    down, right = np.transpose(_offsets(1))
    rows, columns = y + down, x + right
    distance = np.linalg.norm(encode(image[rows, columns]) - encode(image[y, x]), axis=-1)
    alike = np.flatnonzero(distance.min(1) < COLOR_SIGMA)
    nearest = distance[alike].argmin(1)
    return y[alike, 0], x[alike, 0], disparity[rows[alike, nearest], columns[alike, nearest]]


def _offsets(radius: int) -> list[tuple[int, int]]:
    """Return the offsets, down and right, of all other pixels in a square window."""
    around = range(-radius, radius + 1)
    return [offset for offset in product(around, around) if offset != (0, 0)]
