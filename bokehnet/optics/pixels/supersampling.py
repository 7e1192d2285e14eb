"""Downsampling of supersampled pictures through a pixel filter."""

import numpy as np
import numpy.typing as npt

from bokehnet.optics.pixels.pixel_filter import DEFAULT_FILTER, PixelFilter

__all__ = ["downsample"]

Array = npt.NDArray[np.float32]


def downsample(values: Array, factor: int, pixel_filter: PixelFilter = DEFAULT_FILTER) -> Array:
    """Filter an array (factor H, factor W, ...) down to (H, W, ...).

    At the border the weights inside the picture are normalized to sum 1.

    Examples:
        >>> downsample(np.ones((4, 6), np.float32), 2).tolist()
        [[1.0, 1.0, 1.0], [1.0, 1.0, 1.0]]
    """
    weights = pixel_filter.fine_weights(factor).astype(np.float32)
    rows = _along_rows(values, factor, weights)
    return np.ascontiguousarray(_along_rows(rows.swapaxes(0, 1), factor, weights).swapaxes(0, 1))


def _along_rows(values: Array, factor: int, weights: Array) -> Array:
    size, beyond = len(values) // factor, (len(weights) - factor) // 2
    result = np.zeros((size, *values.shape[1:]), np.float32)
    total = np.zeros(size, np.float32)
    for i, weight in enumerate(weights):
        offset = i - beyond  # from the first fine row of a pixel
        first = max(0, -(offset // factor))
        last = min(size, (len(values) - 1 - offset) // factor + 1)
        rows = slice(first * factor + offset, (last - 1) * factor + offset + 1, factor)
        if first < last:
            result[first:last] += weight * values[rows]
            total[first:last] += weight
    result /= total.reshape(-1, *(1,) * (values.ndim - 1))
    return result
