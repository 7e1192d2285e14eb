"""Downsampling to half size and upsampling, as in real-time renderers."""

import numpy as np

__all__ = ["doubled", "extreme_of_four", "halved"]


def _even(values: np.ndarray) -> np.ndarray:
    """Return values with an even number of rows and columns, by repetition of the last ones."""
    height, width = values.shape[:2]
    edges = [(0, height % 2), (0, width % 2)] + [(0, 0)] * (values.ndim - 2)
    return np.pad(values, edges, mode="edge")


def halved(values: np.ndarray) -> np.ndarray:
    """Return means of 2x2 pixels, (H, W) or (H, W, C), float32."""
    even = _even(values)
    return np.asarray((even[::2, ::2] + even[1::2, ::2] + even[::2, 1::2] + even[1::2, 1::2]) / 4, np.float32)


def extreme_of_four(values: np.ndarray, largest: bool) -> np.ndarray:
    """Return the maximum or minimum of 2x2 pixels, (H, W)."""
    even = _even(values)
    pick = np.maximum if largest else np.minimum
    return np.asarray(pick(pick(even[::2, ::2], even[1::2, ::2]), pick(even[::2, 1::2], even[1::2, 1::2])))


def doubled(values: np.ndarray, height: int, width: int) -> np.ndarray:
    """Return the linear interpolation of half-size pixels at (height, width)."""
    for axis, size in ((0, height), (1, width)):
        position = np.clip((np.arange(size) + 0.5) / 2 - 0.5, 0, values.shape[axis] - 1)
        low = position.astype(int)
        high = np.minimum(low + 1, values.shape[axis] - 1)
        shape = [1] * values.ndim
        shape[axis] = size
        fraction = (position - low).astype(np.float32).reshape(shape)
        values = np.take(values, low, axis) * (1 - fraction) + np.take(values, high, axis) * fraction
    return values
