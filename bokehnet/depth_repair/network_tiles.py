"""The parts of a map at which the network of the disparity repair looks, one after the other."""

from collections.abc import Iterator
from itertools import pairwise, product

import numpy as np

__all__ = ["BLOCK", "HALO", "TILE", "repair_tiles"]

# The network halves its input three times.
BLOCK = 8

# Pixels around a tile that its result depends on: windows of 7 and of 23, seven 3x3 convolutions at half
# size, seven at a quarter, five at an eighth.
HALO = 112

# Most pixels that the network sees at once, halos and all; what halos share is seen twice. Tiles of 1.6
# million pixels take 0.3 GB more and are no quicker, those of 0.6 million cost a sixth more time.
TILE = 1000 * 1000

# Tiles along a side at most: parts of 256 pixels of the largest maps that the network sees.
_MOST = 8


def repair_tiles(busy: np.ndarray, most: int) -> Iterator[tuple[slice, slice]]:
    """Cut a map into tiles around the blocks that are ``busy``.

    Args:
        busy: Which blocks of ``BLOCK`` pixels hold steps, (H / 8, W / 8) bool; at most 256 along a side.
        most: Pixels of a tile with its halos.

    Yields:
        Rows and columns, pixels, of the rectangle that holds what is busy in a tile, without halos.
    """
    height, width = busy.shape
    for down, across in product(*_cut(height, width, most)):
        part = busy[down, across]
        rows, columns = np.flatnonzero(part.any(1)), np.flatnonzero(part.any(0))
        if len(rows):
            yield (
                slice(BLOCK * (down.start + int(rows[0])), BLOCK * (down.start + int(rows[-1]) + 1)),
                slice(
                    BLOCK * (across.start + int(columns[0])), BLOCK * (across.start + int(columns[-1]) + 1)
                ),
            )


def _cut(rows: int, columns: int, most: int) -> tuple[list[slice], list[slice]]:
    """Tiles of like size that fit with halos, in blocks; of all ways the one in which they see least."""
    ways = []
    for count_down, count_across in product(range(1, _MOST + 1), repeat=2):
        down, across = _parts(rows, count_down), _parts(columns, count_across)
        heights, widths = _seen(down, rows), _seen(across, columns)
        if max(heights) * max(widths) * BLOCK**2 <= most:
            ways.append((sum(heights) * sum(widths), down, across))
    _, down, across = min(ways, key=lambda way: way[0])
    return down, across


def _parts(blocks: int, count: int) -> list[slice]:
    """Equal parts of a side."""
    ends = [blocks * i // count for i in range(count + 1)]
    return [slice(first, last) for first, last in pairwise(ends)]


def _seen(parts: list[slice], blocks: int) -> list[int]:
    """Blocks of each part with its halos."""
    halo = HALO // BLOCK
    return [min(part.stop + halo, blocks) - max(part.start - halo, 0) for part in parts]
