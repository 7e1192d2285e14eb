"""Which pixels stand far above their surroundings: lamps, sparkles, the sun."""

import numpy as np
from numba import prange

from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit

__all__ = ["brightest", "light_limit"]

# A light is this many times as bright as its surroundings.
_CONTRAST = 4.0

# Smallest half-width of the surroundings, pixels.
_SMALLEST_REACH = 8


@njit(cache=True, parallel=True)
def _brightest(image, result):  # type: ignore[no-untyped-def]
    for y in prange(result.shape[0]):
        for x in range(result.shape[1]):
            result[y, x] = max(image[y, x, 0], image[y, x, 1], image[y, x, 2])


def brightest(image: np.ndarray) -> np.ndarray:
    """Largest of the three channels of (H, W, 3), on all cores."""
    result = np.empty(image.shape[:2], image.dtype)
    with parallel_region:
        _brightest(image, result)
    return result


def _around(values: np.ndarray, reach: int) -> np.ndarray:
    """Mean over a window of about (2 reach + 1)^2 pixels, (H, W); taken from cells a quarter as wide."""
    cell = max(1, reach // 4)
    edges = [np.arange(0, size, cell) for size in values.shape]
    sums = np.add.reduceat(np.add.reduceat(values, edges[0], axis=0), edges[1], axis=1)
    counts = np.outer(
        *(np.diff(np.append(edge, size)) for edge, size in zip(edges, values.shape, strict=True))
    )
    means = _box_sum(_box_sum(sums, 4, 0), 4, 1) / _box_sum(_box_sum(counts, 4, 0), 4, 1)
    spread = np.repeat(np.repeat(means.astype(np.float32), cell, 0), cell, 1)
    return spread[: values.shape[0], : values.shape[1]]


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
        (H, W) float32, to be compared with :func:`brightest`.
    """
    light, reach = brightest(image), max(_SMALLEST_REACH, reach)
    mean = _around(light, reach)
    return _CONTRAST * _around(np.minimum(light, _CONTRAST * mean), reach)
