"""Tiles of the repair network: they cover all edges exactly once and respect the maximum size."""

import numpy as np
import pytest

from bokehnet.depth_repair.config import BLOCK_PX
from bokehnet.depth_repair.stages.network import HALO_PX, MAX_TILE_PIXELS, repair_tiles


@pytest.mark.parametrize("size", [(1352, 1080), (1080, 1352), (2048, 2048), (2048, 8), (8, 8), (1536, 2048)])
@pytest.mark.parametrize("max_pixels", [MAX_TILE_PIXELS // 2, MAX_TILE_PIXELS])
def test_tiles_cover_all_blocks_once_and_respect_the_maximum(size, max_pixels):
    covered = np.zeros(size, int)
    for rows, columns in repair_tiles(np.ones((size[0] // BLOCK_PX, size[1] // BLOCK_PX), bool), max_pixels):
        covered[rows, columns] += 1
        sides_with_halo = [
            min(part.stop + HALO_PX, side) - max(part.start - HALO_PX, 0)
            for part, side in zip((rows, columns), size, strict=True)
        ]
        assert sides_with_halo[0] * sides_with_halo[1] <= max_pixels
    assert (covered == 1).all()


def test_a_tile_is_the_bounding_box_of_its_edges():
    busy = np.zeros((40, 50), bool)
    busy[3, 7] = busy[11, 20] = True
    assert [*repair_tiles(busy, MAX_TILE_PIXELS)] == [(slice(24, 96), slice(56, 168))]
    assert [*repair_tiles(np.zeros((40, 50), bool), MAX_TILE_PIXELS)] == []
