"""Which pixels stand far above their surroundings: lamps, sparkles, the sun."""

import numpy as np
from numba import prange

from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit

__all__ = ["are_lights", "light_limit"]

# A light is this many times as bright as its surroundings.
_CONTRAST = 4.0

# Smallest half-width of the surroundings, pixels.
_SMALLEST_REACH = 8


@njit(cache=True)
def _brightness(image, y, x):  # type: ignore[no-untyped-def]
    """Largest of the three channels."""
    return max(image[y, x, 0], image[y, x, 1], image[y, x, 2])


@njit(cache=True, parallel=True)
def _sum_cells(image, cell, most, sums):  # type: ignore[no-untyped-def]
    """Sum the brightness of each cell, no pixel above what is ``most`` there."""
    height, width, _ = image.shape
    for row in prange(sums.shape[0]):
        for y in range(row * cell, min(height, (row + 1) * cell)):
            for column in range(sums.shape[1]):
                limit, total = most[row, column], 0.0
                for x in range(column * cell, min(width, (column + 1) * cell)):
                    total += min(limit, _brightness(image, y, x))
                sums[row, column] += total


@njit(cache=True, parallel=True)
def _spread(means, cell, result):  # type: ignore[no-untyped-def]
    for y in prange(result.shape[0]):
        for x in range(result.shape[1]):
            result[y, x] = means[y // cell, x // cell]


@njit(cache=True, parallel=True)
def _above(image, limit, result):  # type: ignore[no-untyped-def]
    for y in prange(result.shape[0]):
        for x in range(result.shape[1]):
            result[y, x] = _brightness(image, y, x) > limit[y, x]


def _means_around(image: np.ndarray, cell: int, most: np.ndarray) -> np.ndarray:
    """Mean brightness over nine cells by nine around each; no pixel counts above its cell's ``most``."""
    sums = np.zeros(most.shape)
    with parallel_region:
        _sum_cells(image, cell, most, sums)
    sides = (
        np.minimum(np.arange(1, count + 1) * cell, size) - np.arange(count) * cell
        for count, size in zip(most.shape, image.shape[:2], strict=True)
    )
    counts = np.outer(*sides)
    means: np.ndarray = _box_sum(_box_sum(sums, 4, 0), 4, 1) / _box_sum(_box_sum(counts, 4, 0), 4, 1)
    return means


def _box_sum(values: np.ndarray, reach: int, axis: int) -> np.ndarray:
    """Sum over 2 reach + 1 neighbours along an axis, as far as there are any."""
    size = values.shape[axis]
    sums = np.insert(np.cumsum(values, axis=axis, dtype=np.float64), 0, 0.0, axis=axis)
    high, low = np.minimum(np.arange(size) + reach + 1, size), np.maximum(np.arange(size) - reach, 0)
    return np.take(sums, high, axis) - np.take(sums, low, axis)


def light_limit(image: np.ndarray, reach: int) -> np.ndarray:
    """Brightness above which a pixel is a light: four times its surroundings.

    Args:
        image: Scene-linear, (H, W, 3), float32.
        reach: Half-width in pixels of the surroundings, at least 8. Their mean is taken twice, the second
            time with every pixel held at four times the first, so that lights hardly raise it.

    Returns:
        (H, W) float32, for :func:`are_lights`.
    """
    cell = max(_SMALLEST_REACH, reach) // 4
    cells = tuple(-(-size // cell) for size in image.shape[:2])
    means = _means_around(image, cell, np.full(cells, np.inf))
    means = _means_around(image, cell, _CONTRAST * means)
    limit = np.empty(image.shape[:2], np.float32)
    with parallel_region:
        _spread((_CONTRAST * means).astype(np.float32), cell, limit)
    return limit


def are_lights(image: np.ndarray, limit: np.ndarray) -> np.ndarray:
    """Which pixels of (H, W, 3) are brighter than ``limit``, (H, W); (H, W) bool."""
    found = np.empty(limit.shape, np.bool_)
    with parallel_region:
        _above(image, limit, found)
    return found
