"""Repair network in overlapping tiles.

The network (:mod:`bokehnet.models.repair`) predicts each pixel's position between the farthest and the
nearest surface around it; the output stays within that range.

Method: overlap-tile strategy (Ronneberger, Fischer and Brox, "U-Net", MICCAI 2015): each tile is extended by
a halo of the receptive field, so that its result equals that of the whole map. Tiles shrink to the bounding
box of their depth edges, and tiles without edges are skipped.

In: the picture, scene-linear (3, H, W), and the map (H, W), any unit. Out: the repaired map in that unit.
"""

from collections.abc import Iterator
from itertools import pairwise, product
from pathlib import Path

import numpy as np

from bokehnet.arrays.pyramid import crop_to, pad_to_multiple
from bokehnet.depth_repair.config import BLOCK_PX, MIN_EDGE_HEIGHT
from bokehnet.inference.process_memory import keeps_freed_memory, release_freed_memory
from bokehnet.inference.session import load_network
from bokehnet.progress import Progress

__all__ = ["HALO_PX", "MAX_TILE_PIXELS", "RepairNetwork", "block_ranges", "network_memory", "repair_tiles"]

# Width of the halo, pixels: the receptive field of windows of 7 and 23 pixels, seven 3x3 convolutions at half
# size, seven at a quarter and five at an eighth.
HALO_PX = 112

# Maximum number of pixels of a tile including its halo; overlapping halos are computed twice. Tiles of 1.6
# million pixels need 0.3 GB more and are not faster, tiles of 0.6 million need a sixth more time.
MAX_TILE_PIXELS = 1000 * 1000

# Maximum number of tiles along a side: tiles of 256 pixels in the largest map that the network processes.
_MAX_TILES = 8


# Memory of the network per pixel of a tile, bytes.
_NETWORK_BYTES_PER_PIXEL = 480


def network_memory(height: int, width: int) -> int:
    """Return the peak memory of the repair network, bytes.

    Args:
        height: Height of the picture, pixels.
        width: Width of the picture, pixels.
    """
    return _NETWORK_BYTES_PER_PIXEL * min(height * width, MAX_TILE_PIXELS)


class RepairNetwork:
    """Network that moves depth edges, with its session.

    Args:
        folder: Folder with the network and its manifest.
        threads: Number of threads; 0 uses all cores.

    Raises:
        ModelFileError: The network is missing or damaged.
    """

    def __init__(self, folder: Path, threads: int = 0) -> None:
        self._network = load_network(folder, "repair", ("image", "disparity", "span"), threads)

    def __call__(
        self, image: np.ndarray, disparity: np.ndarray, span: float, progress: Progress
    ) -> np.ndarray:
        """Return the map repaired in all tiles that contain depth edges, (H, W).

        Args:
            image: Picture, scene-linear, (3, H, W).
            disparity: Map, (H, W), any unit.
            span: Range of the whole map, in its unit.
            progress: Callback with (tiles done, number of tiles).
        """
        height, width = disparity.shape
        disparity = pad_to_multiple(disparity, BLOCK_PX)
        result, scale = disparity.copy(), np.full((1, 1, 1, 1), span, np.float32)
        tiles = [*repair_tiles(block_ranges(disparity) > MIN_EDGE_HEIGHT * span, MAX_TILE_PIXELS)]
        for done, tile in enumerate(tiles):
            progress(done, len(tiles))
            rows, columns = tile
            top, left = max(0, rows.start - HALO_PX), max(0, columns.start - HALO_PX)
            window = (slice(top, rows.stop + HALO_PX), slice(left, columns.stop + HALO_PX))
            # The picture may end inside the last block of the map.
            colors = pad_to_multiple(image[None, :, *window], BLOCK_PX)
            repaired, _ = self._network(colors, disparity[None, None, *window], scale)
            result[tile] = repaired[
                0, 0, rows.start - top : rows.stop - top, columns.start - left : columns.stop - left
            ]
        return np.ascontiguousarray(crop_to(result, height, width))

    def release_memory(self) -> None:
        """Return the memory of the network to the system, unless the process keeps freed memory."""
        if keeps_freed_memory():
            return
        block = np.zeros((1, 3, BLOCK_PX, BLOCK_PX), np.float32)
        self._network(block, block[:, :1], np.ones((1, 1, 1, 1), np.float32), release=True)
        release_freed_memory()


def block_ranges(disparity: np.ndarray) -> np.ndarray:
    """Return the range of values in the 3x3 blocks of 8x8 pixels around each block, (H / 8, W / 8).

    Args:
        disparity: Map with sides that are multiples of 8, (H, W), any unit.
    """
    height, width = disparity.shape
    blocks = disparity.reshape(height // BLOCK_PX, BLOCK_PX, width // BLOCK_PX, BLOCK_PX)
    low, high = np.pad(blocks.min(1).min(2), 1, "edge"), np.pad(blocks.max(1).max(2), 1, "edge")
    rows, columns = blocks.shape[0], blocks.shape[2]
    windows = [(slice(y, y + rows), slice(x, x + columns)) for y in range(3) for x in range(3)]
    ranges: np.ndarray = np.max([high[w] for w in windows], 0) - np.min([low[w] for w in windows], 0)
    return ranges


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
