"""Maps that lie beside their picture are moved back, and no others."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy.ndimage import shift as scipy_shift

from bokehnet.depth_repair.edge_bias import shift_edges
from bokehnet.depth_repair.map_offset import find_map_offset, move_map
from bokehnet.depth_repair.repair import DisparityRepair
from tests.unit.depth_repair.test_edge_bias import Oracle, blobs, busy_blocks

OFFSETS = [(0, 1), (0, -2), (3, 0), (-4, 4), (5, -6), (-1, -7)]


@pytest.mark.parametrize("offset", OFFSETS)
def test_moving_repeats_the_border(offset):
    """Oracle: scipy's shift."""
    disparity = np.random.default_rng(0).random((31, 43), dtype=np.float32)
    assert_array_equal(move_map(disparity, offset), scipy_shift(disparity, offset, order=0, mode="nearest"))


@pytest.mark.parametrize("offset", OFFSETS)
def test_a_map_that_lies_beside_its_picture_is_moved_back(offset):
    truth = blobs()
    given = move_map(truth, offset)
    for shift in (0, -2):  # which it may seem to need
        down, right = find_map_offset(given, shift, busy_blocks(given), Oracle(truth))
        assert (down, right) == (-offset[0], -offset[1])


@pytest.mark.parametrize("pixels", [-4, -1, 0, 1, 4])
def test_maps_that_are_wrong_otherwise_stay_where_they_are(pixels):
    """Near things that are all too large or too small object on all sides."""
    truth = blobs()
    given = shift_edges(truth, pixels)
    oracle = Oracle(truth)
    assert find_map_offset(given, -pixels, busy_blocks(given), oracle) == (0, 0)
    assert oracle.asked <= (13 + 8 if pixels == 0 else 100)


@pytest.mark.parametrize(("back", "wanted"), [(8, (-1, 0)), (10, (0, 0))])
def test_both_sides_of_steps_have_to_agree(back, wanted):
    """One pixel up, fewer far sides ask to become near; but more near sides ask to become far, or not."""
    disparity = np.zeros((64, 96), np.float32)
    disparity[32, 48] = 1

    def votes(_: object, moved: np.ndarray) -> np.ndarray:
        row, column = np.unravel_index(moved.argmax(), moved.shape)
        up_one = (row, column) == (31, 48)
        return np.array([5, 100, back, 100] if up_one else [30, 100, 9, 100])

    assert find_map_offset(disparity, 0, np.ones((8, 12), bool), votes) == wanted


def test_maps_without_steps_are_not_asked_at_all():
    oracle = Oracle(np.zeros((64, 64)))
    assert find_map_offset(np.zeros((64, 64), np.float32), 0, np.zeros((8, 8), bool), oracle) == (0, 0)
    assert oracle.asked == 0


def textured(truth: np.ndarray) -> np.ndarray:
    """A picture whose colours tell near from far, with some texture."""
    rng = np.random.default_rng(1)
    near = np.where(truth[..., None] > 0.5, (0.6, 0.3, 0.1), (0.1, 0.3, 0.5))
    return (near * rng.uniform(0.8, 1.2, truth.shape)[..., None]).astype(np.float32)


@pytest.mark.slow
@pytest.mark.parametrize("offset", [(0, 2), (-2, 3), (0, 0)])
@pytest.mark.parametrize("factor", [1, 4])
def test_the_repair_moves_a_map_and_says_so(offset, factor):
    """With the shipped network; a large picture is looked at when it is small."""
    truth = blobs()
    given, image = move_map(truth, offset), textured(truth)
    if factor > 1:
        given, truth = (x.repeat(factor, 0).repeat(factor, 1) for x in (given, truth))
        image = image.repeat(factor, 0).repeat(factor, 1)
    found = DisparityRepair().repair(image, given, "auto")
    inner = np.s_[8 * factor : -8 * factor, 8 * factor : -8 * factor]
    assert (np.abs(found.disparity - truth) > 0.1)[inner].mean() <= 2e-4
    assert found.plan.offset == (-factor * offset[0], -factor * offset[1])
    words = {
        (0, 2): f"{2 * factor} px to the left",
        (-2, 3): f"{3 * factor} px to the left and {2 * factor} px down",
    }
    assert found.reason.partition(", all moved ")[2] == words.get(offset, "")
    if offset != (0, 0):
        follows = DisparityRepair().repair(image, given, "auto", plan=found.plan)
        assert (np.abs(follows.disparity - truth) > 0.1)[inner].mean() <= 2e-4


@pytest.mark.parametrize("name", ["discs", "slope"])
def test_a_picture_that_shows_nothing_moves_no_map(name):
    disparity = blobs() if name == "discs" else np.tile(np.linspace(0, 1, 320, dtype=np.float32), (200, 1))
    found = DisparityRepair().repair(np.ones((200, 320, 3), np.float32), disparity, "auto")
    assert found.plan.offset == (0, 0)
