"""Maps that lie beside their picture are moved back, and no others."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy.ndimage import shift as scipy_shift

from bokehnet.depth_repair.edge_bias import shift_edges
from bokehnet.depth_repair.map_offset import find_map_offset, translate_map
from bokehnet.depth_repair.repair import DisparityRepair
from tests.unit.depth_repair.test_edge_bias import Oracle, blobs, busy_blocks

OFFSETS = [(0, 1), (0, -2), (3, 0), (-4, 4), (5, -6), (-1, -7)]


@pytest.mark.parametrize("offset", OFFSETS)
def test_moving_repeats_the_border(offset):
    """Oracle: scipy's shift."""
    disparity = np.random.default_rng(0).random((31, 43), dtype=np.float32)
    assert_array_equal(
        translate_map(disparity, offset), scipy_shift(disparity, offset, order=0, mode="nearest")
    )


@pytest.mark.parametrize("offset", OFFSETS)
def test_a_translated_map_is_moved_back(offset):
    truth = blobs()
    translated = translate_map(truth, offset)
    for shift in (0, -2):  # estimates of the edge bias that can occur
        down, right = find_map_offset(translated, shift, busy_blocks(translated), Oracle(truth))
        assert (down, right) == (-offset[0], -offset[1])


@pytest.mark.parametrize("pixels", [-4, -1, 0, 1, 4])
def test_maps_with_an_edge_bias_are_not_translated(pixels):
    """Foreground regions that are too large or too small have votes on all sides."""
    truth = blobs()
    translated = shift_edges(truth, pixels)
    oracle = Oracle(truth)
    assert find_map_offset(translated, -pixels, busy_blocks(translated), oracle) == (0, 0)
    assert oracle.calls <= (13 + 8 if pixels == 0 else 100)


@pytest.mark.parametrize(("back", "expected"), [(8, (-1, 0)), (10, (0, 0))])
def test_both_sides_of_edges_must_agree(back, expected):
    """One pixel up, fewer far sides vote for a change, but the near sides decide."""
    disparity = np.zeros((64, 96), np.float32)
    disparity[32, 48] = 1

    def votes(_: object, candidate: np.ndarray) -> np.ndarray:
        row, column = np.unravel_index(candidate.argmax(), candidate.shape)
        up_one = (row, column) == (31, 48)
        return np.array([5, 100, back, 100] if up_one else [30, 100, 9, 100])

    assert find_map_offset(disparity, 0, np.ones((8, 12), bool), votes) == expected


def test_maps_without_edges_need_no_votes():
    oracle = Oracle(np.zeros((64, 64)))
    assert find_map_offset(np.zeros((64, 64), np.float32), 0, np.zeros((8, 8), bool), oracle) == (0, 0)
    assert oracle.calls == 0


def textured(truth: np.ndarray) -> np.ndarray:
    """Return a textured picture with different colours near and far, scene-linear (H, W, 3)."""
    rng = np.random.default_rng(1)
    near = np.where(truth[..., None] > 0.5, (0.6, 0.3, 0.1), (0.1, 0.3, 0.5))
    return (near * rng.uniform(0.8, 1.2, truth.shape)[..., None]).astype(np.float32)


@pytest.mark.slow
@pytest.mark.parametrize("offset", [(0, 2), (-2, 3), (0, 0)])
@pytest.mark.parametrize("factor", [1, 4])
def test_the_repair_translates_a_map_and_reports_it(offset, factor):
    """Use the shipped network; large pictures are aligned at a smaller size."""
    truth = blobs()
    translated, image = translate_map(truth, offset), textured(truth)
    if factor > 1:
        translated, truth = (x.repeat(factor, 0).repeat(factor, 1) for x in (translated, truth))
        image = image.repeat(factor, 0).repeat(factor, 1)
    result = DisparityRepair().repair(image, translated, "auto")
    inner = np.s_[8 * factor : -8 * factor, 8 * factor : -8 * factor]
    assert (np.abs(result.disparity - truth) > 0.1)[inner].mean() <= 2e-4
    assert result.plan.offset == (-factor * offset[0], -factor * offset[1])
    descriptions = {
        (0, 2): f"{2 * factor} px to the left",
        (-2, 3): f"{3 * factor} px to the left and {2 * factor} px down",
    }
    assert result.reason.partition(", all moved ")[2] == descriptions.get(offset, "")
    if offset != (0, 0):
        planned = DisparityRepair().repair(image, translated, "auto", plan=result.plan)
        assert (np.abs(planned.disparity - truth) > 0.1)[inner].mean() <= 2e-4


@pytest.mark.parametrize("name", ["discs", "slope"])
def test_a_constant_picture_translates_no_map(name):
    disparity = blobs() if name == "discs" else np.tile(np.linspace(0, 1, 320, dtype=np.float32), (200, 1))
    result = DisparityRepair().repair(np.ones((200, 320, 3), np.float32), disparity, "auto")
    assert result.plan.offset == (0, 0)
