"""Edge bias of maps that were grown or shrunk by a known number of pixels."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy.ndimage import maximum_filter, minimum_filter

from bokehnet.depth_repair.edge_bias import find_edge_bias, shift_edges


def blobs(height: int = 200, width: int = 320) -> np.ndarray:
    """Return a map of near discs in front of a far slope, at least 14 pixels apart, (H, W)."""
    y, x = np.mgrid[:height, :width]
    disparity = (0.1 + 1e-4 * x).astype(np.float32)
    for row in range(40, height, 64):
        for column in range(40, width, 64):
            disparity[np.hypot(y - row, x - column) < 24] = 0.8
    return disparity


def busy_blocks(disparity: np.ndarray) -> np.ndarray:
    height, width = disparity.shape
    return np.ptp(disparity.reshape(height // 8, 8, width // 8, 8), axis=(1, 3)) > 0.05


class Oracle:
    """Votes computed from the true map; counts the calls."""

    def __init__(self, truth: np.ndarray) -> None:
        self.truth, self.calls = truth, 0

    def __call__(self, window: tuple[slice, slice], disparity: np.ndarray) -> np.ndarray:
        self.calls += 1
        shifted, is_near = disparity > 0.5, self.truth[window] > 0.5
        sides = maximum_filter(shifted, 5) & ~shifted, shifted & ~minimum_filter(shifted, 5)
        return np.array(
            [(sides[0] & is_near).sum(), sides[0].sum(), (sides[1] & ~is_near).sum(), sides[1].sum()]
        )


@pytest.mark.parametrize("pixels", range(-5, 6))
def test_shifting_equals_the_rank_filter_of_scipy(pixels):
    """Oracle: the filters of SciPy."""
    disparity = np.random.default_rng(0).random((61, 83), dtype=np.float32)
    oracle = maximum_filter if pixels > 0 else minimum_filter
    expected = oracle(disparity, 2 * abs(pixels) + 1, mode="nearest")
    assert_array_equal(shift_edges(disparity, pixels), expected)


@pytest.mark.parametrize("pixels", [-7, -5, -4, -3, -2, 2, 3, 4, 5, 6])
def test_the_shift_of_a_whole_map_is_estimated(pixels):
    truth = blobs()
    oracle = Oracle(truth)
    shifted = shift_edges(truth, pixels)
    assert find_edge_bias(shifted, busy_blocks(shifted), oracle) == -pixels
    assert oracle.calls <= 6 * 4


@pytest.mark.parametrize("pixels", [-4, -3, 3, 4])
def test_the_shift_of_a_part_of_a_map_is_estimated_fully(pixels):
    """Accurate parts of the map do not reduce the estimate."""
    truth = blobs(200, 800)
    shifted = np.where(np.arange(800) < 400, shift_edges(truth, pixels), truth)
    assert find_edge_bias(shifted, busy_blocks(shifted), Oracle(truth)) == -pixels


def test_accurate_maps_need_one_vote_per_window_and_do_not_change():
    truth = blobs()
    oracle = Oracle(truth)
    assert find_edge_bias(truth, busy_blocks(truth), oracle) == 0
    assert oracle.calls <= 4


def test_maps_with_holes_are_not_shifted():
    """The borders of holes vote for a change, but no shift of the whole map has fewer votes."""
    truth = blobs()
    y, x = np.mgrid[: truth.shape[0], : truth.shape[1]]
    hole = np.hypot(y % 16 - 8, x % 16 - 8) < 4
    shifted = np.where(hole, np.float32(0), truth)
    assert find_edge_bias(shifted, busy_blocks(shifted), Oracle(truth)) == 0


def test_maps_without_edges_need_no_votes():
    oracle = Oracle(np.zeros((64, 64)))
    assert find_edge_bias(np.zeros((64, 64), np.float32), np.zeros((8, 8), bool), oracle) == 0
    assert oracle.calls == 0


@pytest.mark.parametrize("shape", [(8, 8), (8, 512), (1024, 16)])
def test_maps_of_any_size(shape):
    truth = np.where(np.arange(shape[1]) < shape[1] // 2, 0.9, 0.1) * np.ones(shape)
    shifted = shift_edges(truth.astype(np.float32), -3)
    busy = np.ones((shape[0] // 8, shape[1] // 8), bool)
    assert find_edge_bias(shifted, busy, Oracle(truth)) in {2, 3, 4}
