"""Overlapping tiles in which the repair network processes a map.

Method: overlap-tile strategy (Ronneberger, Fischer and Brox, "U-Net", MICCAI 2015): each tile is extended by
    a
halo of the receptive field, so that its result equals that of the whole map. Tiles shrink to the bounding box
of their depth edges, and tiles without edges are skipped.

In: the blocks of 8x8 pixels that contain depth edges, (H / 8, W / 8) bool. Out: rows and columns of tiles,
pixels.
"""

from collections.abc import Iterator
from itertools import pairwise, product

import numpy as np

__all__ = ["BLOCK_PX", "HALO_PX", "MAX_TILE_PIXELS", "repair_tiles"]

# Side of a block, pixels: the network halves its input three times.
BLOCK_PX = 8

# Width of the halo, pixels: the receptive field of windows of 7 and 23 pixels, seven 3x3 convolutions at half
# size, seven at a quarter and five at an eighth.
HALO_PX = 112

# Maximum number of pixels of a tile including its halo; overlapping halos are computed twice. Tiles of 1.6
# million pixels need 0.3 GB more and are not faster, tiles of 0.6 million need a sixth more time.
MAX_TILE_PIXELS = 1000 * 1000

# Maximum number of tiles along a side: tiles of 256 pixels in the largest map that the network processes.
_MAX_TILES = 8


def repair_tiles(busy: np.ndarray, max_pixels: int) -> Iterator[tuple[slice, slice]]:
    """Yield tiles that cover all blocks with depth edges.

    Args:
        busy: Blocks of 8x8 pixels that contain depth edges, (H / 8, W / 8) bool; at most 256 along a side.
        max_pixels: Maximum number of pixels of a tile including its halo.

    Yields:
        Rows and columns, pixels, of the bounding box of the edges in a tile, without the halo.
    """
    height, width = busy.shape
    for down, across in product(*_cut(height, width, max_pixels)):
        blocks_of_tile = busy[down, across]
        rows, columns = np.flatnonzero(blocks_of_tile.any(1)), np.flatnonzero(blocks_of_tile.any(0))
        if len(rows):
            yield (
                slice(BLOCK_PX * (down.start + int(rows[0])), BLOCK_PX * (down.start + int(rows[-1]) + 1)),
                slice(
                    BLOCK_PX * (across.start + int(columns[0])),
                    BLOCK_PX * (across.start + int(columns[-1]) + 1),
                ),
            )


def _cut(rows: int, columns: int, max_pixels: int) -> tuple[list[slice], list[slice]]:
    """Return rows and columns of equal tiles, in blocks, with the fewest pixels including halos."""
    layouts = []
    for count_down, count_across in product(range(1, _MAX_TILES + 1), repeat=2):
        down, across = _parts(rows, count_down), _parts(columns, count_across)
        heights, widths = _with_halos(down, rows), _with_halos(across, columns)
        if max(heights) * max(widths) * BLOCK_PX**2 <= max_pixels:
            layouts.append((sum(heights) * sum(widths), down, across))
    _, down, across = min(layouts, key=lambda layout: layout[0])
    return down, across


def _parts(blocks: int, count: int) -> list[slice]:
    """Return a side cut into equal parts, in blocks."""
    ends = [blocks * i // count for i in range(count + 1)]
    return [slice(first, last) for first, last in pairwise(ends)]


def _with_halos(parts: list[slice], blocks: int) -> list[int]:
    """Return the number of blocks of each part with its halo, clipped to the side."""
    halo = HALO_PX // BLOCK_PX
    return [
        min(blocks_of_tile.stop + halo, blocks) - max(blocks_of_tile.start - halo, 0)
        for blocks_of_tile in parts
    ]
