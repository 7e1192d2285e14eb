"""Minimum, maximum, dilation and erosion over square windows."""

from typing import TypeVar

import numpy as np
import numpy.typing as npt

__all__ = ["dilated", "eroded", "reduce_windows"]

Mask = npt.NDArray[np.bool_]
Grid = TypeVar("Grid", npt.NDArray[np.float32], Mask)


def reduce_windows(values: Grid, radius: int, reduce: np.ufunc) -> Grid:
    """Reduce the square window around each pixel, one axis after the other; windows grow by doubling.

    Args:
        values: Map or mask, (H, W); its border is repeated.
        radius: Half width of the window, pixels; the window has ``2 * radius + 1`` pixels a side.
        reduce: Function for which repeated values do not count, such as ``np.minimum``, or
            ``np.logical_and`` for masks.
    """
    result = values
    for axis in (0, 1):
        padding = [(radius, radius) if a == axis else (0, 0) for a in (0, 1)]
        lines = np.moveaxis(np.pad(result, padding, "edge"), axis, 0)
        size, full_size = 1, 2 * radius + 1
        while size < full_size:
            step = min(size, full_size - size)
            lines = reduce(lines[: len(lines) - step], lines[step:])
            size += step
        result = np.moveaxis(lines, 0, axis)
    return result


def dilated(mask: Mask, radius: int) -> Mask:
    """Return the pixels whose square of ``radius`` pixels meets the mask, (H, W)."""
    return reduce_windows(mask, radius, np.logical_or)


def eroded(mask: Mask, radius: int) -> Mask:
    """Return the pixels whose square of ``radius`` pixels lies in the mask, (H, W)."""
    return reduce_windows(mask, radius, np.logical_and)
