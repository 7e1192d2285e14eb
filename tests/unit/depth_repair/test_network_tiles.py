"""Tiles of the disparity repair: they cover what is busy once, and none is larger than may be."""

import numpy as np
import pytest

from bokehnet.depth_repair.network_tiles import BLOCK_PX, HALO_PX, MAX_TILE_PIXELS, repair_tiles


@pytest.mark.parametrize("size", [(1352, 1080), (1080, 1352), (2048, 2048), (2048, 8), (8, 8), (1536, 2048)])
@pytest.mark.parametrize("most", [MAX_TILE_PIXELS // 2, MAX_TILE_PIXELS])
def test_all_is_covered_once_by_tiles_that_fit(size, most):
    covered = np.zeros(size, int)
    for rows, columns in repair_tiles(np.ones((size[0] // BLOCK_PX, size[1] // BLOCK_PX), bool), most):
        covered[rows, columns] += 1
        seen = [
            min(part.stop + HALO_PX, side) - max(part.start - HALO_PX, 0)
            for part, side in zip((rows, columns), size, strict=True)
        ]
        assert seen[0] * seen[1] <= most
    assert (covered == 1).all()


def test_a_tile_is_the_rectangle_of_what_is_busy():
    busy = np.zeros((40, 50), bool)
    busy[3, 7] = busy[11, 20] = True
    assert [*repair_tiles(busy, MAX_TILE_PIXELS)] == [(slice(24, 96), slice(56, 168))]
    assert [*repair_tiles(np.zeros((40, 50), bool), MAX_TILE_PIXELS)] == []
