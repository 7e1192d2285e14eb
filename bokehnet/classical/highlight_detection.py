"""Detection of highlights, pixels far brighter than their surroundings: lamps, sparkles, the sun."""

import numpy as np
from numba import prange

from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit

__all__ = ["are_lights", "light_limit"]

# Brightness of a light over the mean of its surroundings.
_CONTRAST = 4.0

# Minimum half-width of the surroundings, pixels.
_MIN_REACH_PX = 8


@njit(cache=True)
def _brightness(image, y, x):
    """Return the largest of the three channels."""
    return max(image[y, x, 0], image[y, x, 1], image[y, x, 2])


@njit(cache=True, parallel=True)
def _sum_cells(image, cell, limits, sums):
    """Sum the brightness of each cell, with every pixel clipped to the cell's ``limits``."""
    height, width, _ = image.shape
    for row in prange(sums.shape[0]):
        for y in range(row * cell, min(height, (row + 1) * cell)):
            for column in range(sums.shape[1]):
                limit, total = limits[row, column], 0.0
                for x in range(column * cell, min(width, (column + 1) * cell)):
                    total += min(limit, _brightness(image, y, x))
                sums[row, column] += total


@njit(cache=True, parallel=True)
def _spread(means, cell, result):
    for y in prange(result.shape[0]):
        for x in range(result.shape[1]):
            result[y, x] = means[y // cell, x // cell]


@njit(cache=True, parallel=True)
def _above(image, limit, result):
    for y in prange(result.shape[0]):
        for x in range(result.shape[1]):
            result[y, x] = _brightness(image, y, x) > limit[y, x]


def _means_around(image: np.ndarray, cell: int, limits: np.ndarray) -> np.ndarray:
    """Return the mean brightness over 9x9 cells around each, with pixels clipped to their cell's limit."""
    sums = np.zeros(limits.shape)
    with parallel_region:
        _sum_cells(image, cell, limits, sums)
    sides = (
        np.minimum(np.arange(1, count + 1) * cell, size) - np.arange(count) * cell
        for count, size in zip(limits.shape, image.shape[:2], strict=True)
    )
    counts = np.outer(*sides)
    means: np.ndarray = _box_sum(_box_sum(sums, 4, 0), 4, 1) / _box_sum(_box_sum(counts, 4, 0), 4, 1)
    return means


def _box_sum(values: np.ndarray, reach: int, axis: int) -> np.ndarray:
    """Sum over 2 reach + 1 neighbours along an axis, clipped at the border."""
    size = values.shape[axis]
    sums = np.insert(np.cumsum(values, axis=axis, dtype=np.float64), 0, 0.0, axis=axis)
    high, low = np.minimum(np.arange(size) + reach + 1, size), np.maximum(np.arange(size) - reach, 0)
    return np.take(sums, high, axis) - np.take(sums, low, axis)


def light_limit(image: np.ndarray, reach: int) -> np.ndarray:
    """Return the brightness above which a pixel is a light: four times that of its surroundings.

    Args:
        image: Scene-linear picture, (H, W, 3), float32.
        reach: Half-width in pixels of the surroundings, at least 8. Their mean is computed twice, the second
            time with every pixel clipped to four times the first mean, so that lights hardly raise it.

    Returns:
        (H, W) float32, for :func:`are_lights`.
    """
    cell = max(_MIN_REACH_PX, reach) // 4
    cells = tuple(-(-size // cell) for size in image.shape[:2])
    means = _means_around(image, cell, np.full(cells, np.inf))
    means = _means_around(image, cell, _CONTRAST * means)
    limit = np.empty(image.shape[:2], np.float32)
    with parallel_region:
        _spread((_CONTRAST * means).astype(np.float32), cell, limit)
    return limit


def are_lights(image: np.ndarray, limit: np.ndarray) -> np.ndarray:
    """Return the mask of pixels of (H, W, 3) that are brighter than ``limit``, (H, W); (H, W) bool."""
    mask = np.empty(limit.shape, np.bool_)
    with parallel_region:
        _above(image, limit, mask)
    return mask
