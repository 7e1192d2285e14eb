"""Maps that were enlarged by repeating their pixels."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

__all__ = ["unrepeated"]

# Fewer blocks than these, or changes at less than this share of their borders, may be a drawn scene.
_BLOCKS = 8
_CHANGING = 0.5


def unrepeated(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the small map of one that was enlarged by repeating its pixels, and any other map as it is.

    Each of its pixels is then a block, as wide as all others up to rounding: rows and columns change at their
    borders alone.

    Args:
        values: (H, W).

    Returns:
        One value of every block, or ``values``.

    Examples:
        >>> small = np.random.default_rng(0).random((12, 16), np.float32)
        >>> np.array_equal(unrepeated(small.repeat(3, axis=0).repeat(2, axis=1)), small)
        True
        >>> unrepeated(small) is small
        True
    """
    rows, columns = (_blocks(values, axis) for axis in (0, 1))
    if rows is None or columns is None:
        return values
    return values[np.ix_(rows, columns)]


def _blocks(values: NDArray[np.float32], axis: int) -> NDArray[np.intp] | None:
    """Return where the blocks along an axis start; none if there are no such blocks."""
    lines = np.moveaxis(values, axis, 0)
    length = len(lines)
    changes = 1 + np.flatnonzero(np.any(lines[1:] != lines[:-1], axis=1))
    if len(changes) < _BLOCKS or (shortest := int(np.diff(changes).min())) < 2:
        return None
    for count in range(-(-length // (shortest + 1)), length // max(1, shortest - 1) + 1):
        if len(changes) < _CHANGING * (count - 1):
            return None
        for block in _numbered(length, count):
            starts = np.searchsorted(block, np.arange(count))
            if np.isin(changes, starts).all():
                return starts
    return None


def _numbered(length: int, count: int) -> Iterator[NDArray[np.intp]]:
    """Number of the block that each pixel lies in, by the two roundings that are in use."""
    pixels = np.arange(length)
    yield (2 * pixels + 1) * count // (2 * length)
    yield pixels * count // length
