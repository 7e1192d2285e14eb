"""Maps that were enlarged by repeating their pixels (nearest-neighbour interpolation).

Method: rows and columns of such a map change only at the borders of equal blocks. The block grid is found by
exact comparison with both common roundings of nearest-neighbour interpolation, and one value per block is
kept.

In: a map (H, W), any unit. Out: the small map, or the input.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from bokehnet.depth_repair.config import MIN_CHANGES, MIN_CHANGING_FRACTION

__all__ = ["undo_pixel_repetition"]


def undo_pixel_repetition(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the small map from which a map was enlarged by pixel repetition; any other map unchanged.

    Each pixel of the small map is a block; all blocks have the same size up to rounding.

    Args:
        values: Map, (H, W), any unit.

    Returns:
        One value per block, or ``values`` itself.

    Examples:
        >>> small = np.random.default_rng(0).random((12, 16), np.float32)
        >>> np.array_equal(undo_pixel_repetition(small.repeat(3, axis=0).repeat(2, axis=1)), small)
        True
        >>> undo_pixel_repetition(small) is small
        True
    """
    rows, columns = (_block_starts(values, axis) for axis in (0, 1))
    if rows is None or columns is None:
        return values
    return values[np.ix_(rows, columns)]


def _block_starts(values: NDArray[np.float32], axis: int) -> NDArray[np.intp] | None:
    """Return the starts of the blocks along an axis, or None if there are no blocks."""
    lines = np.moveaxis(values, axis, 0)
    length = len(lines)
    changes = 1 + np.flatnonzero(np.any(lines[1:] != lines[:-1], axis=1))
    if len(changes) < MIN_CHANGES or (shortest := int(np.diff(changes).min())) < 2:
        return None
    for count in range(-(-length // (shortest + 1)), length // max(1, shortest - 1) + 1):
        if len(changes) < MIN_CHANGING_FRACTION * (count - 1):
            return None
        for block in _block_numbers(length, count):
            starts = np.searchsorted(block, np.arange(count))
            if np.isin(changes, starts).all():
                return starts
    return None


def _block_numbers(length: int, count: int) -> Iterator[NDArray[np.intp]]:
    """Yield the block number of each pixel, for both roundings in use."""
    pixels = np.arange(length)
    yield (2 * pixels + 1) * count // (2 * length)
    yield pixels * count // length
