"""Means over square windows by running sums."""

import numpy as np
import numpy.typing as npt

__all__ = ["box_mean"]

Array = npt.NDArray[np.float32]


def box_mean(values: Array, radius: int) -> Array:
    """Return the mean over the square window around each pixel, with repeated border.

    Args:
        values: (H, W).
        radius: Half width of the window, pixels; the window has ``2 * radius + 1`` pixels a side.

    Returns:
        (H, W) float32, from sums in float64.
    """
    size = 2 * radius + 1
    for axis in (0, 1):
        around = [(radius + 1, radius) if a == axis else (0, 0) for a in (0, 1)]
        padded = np.pad(values, around, "edge").astype(np.float64)
        padded[(slice(0, 1), slice(None)) if axis == 0 else (slice(None), slice(0, 1))] = 0
        sums = np.moveaxis(padded.cumsum(axis), axis, 0)
        values = np.moveaxis((sums[size:] - sums[:-size]) / size, 0, axis).astype(np.float32)
    return values
