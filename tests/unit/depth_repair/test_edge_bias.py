"""How far all steps of a map stand out of place together."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy.ndimage import maximum_filter, minimum_filter

from bokehnet.depth_repair.edge_bias import find_edge_bias, shift_edges


def blobs(height: int = 200, width: int = 320) -> np.ndarray:
    """Near discs before a far slope, none closer to another than 14 px."""
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
    """Votes of someone who knows the true map; counts how often it is asked."""

    def __init__(self, truth: np.ndarray) -> None:
        self.truth, self.asked = truth, 0

    def __call__(self, window: tuple[slice, slice], disparity: np.ndarray) -> np.ndarray:
        self.asked += 1
        given, true = disparity > 0.5, self.truth[window] > 0.5
        sides = maximum_filter(given, 5) & ~given, given & ~minimum_filter(given, 5)
        return np.array([(sides[0] & true).sum(), sides[0].sum(), (sides[1] & ~true).sum(), sides[1].sum()])


@pytest.mark.parametrize("pixels", range(-5, 6))
def test_shifting_is_the_filter_over_square_windows(pixels):
    """Oracle: scipy's filters."""
    disparity = np.random.default_rng(0).random((61, 83), dtype=np.float32)
    oracle = maximum_filter if pixels > 0 else minimum_filter
    wanted = oracle(disparity, 2 * abs(pixels) + 1, mode="nearest")
    assert_array_equal(shift_edges(disparity, pixels), wanted)


@pytest.mark.parametrize("pixels", [-7, -5, -4, -3, -2, 2, 3, 4, 5, 6])
def test_a_shift_of_the_whole_map_is_found(pixels):
    truth = blobs()
    oracle = Oracle(truth)
    given = shift_edges(truth, pixels)
    assert find_edge_bias(given, busy_blocks(given), oracle) == -pixels
    assert oracle.asked <= 6 * 4


@pytest.mark.parametrize("pixels", [-4, -3, 3, 4])
def test_a_shift_of_a_part_of_the_map_is_found_in_full(pixels):
    """Parts that stand right do not halve it."""
    truth = blobs(200, 800)
    given = np.where(np.arange(800) < 400, shift_edges(truth, pixels), truth)
    assert find_edge_bias(given, busy_blocks(given), Oracle(truth)) == -pixels


def test_maps_that_stand_right_are_asked_once_and_kept():
    truth = blobs()
    oracle = Oracle(truth)
    assert find_edge_bias(truth, busy_blocks(truth), oracle) == 0
    assert oracle.asked <= 4


def test_maps_with_holes_are_not_shifted():
    """Their rims ask to move, and to no shift of the whole map fewer object."""
    truth = blobs()
    y, x = np.mgrid[: truth.shape[0], : truth.shape[1]]
    hole = np.hypot(y % 16 - 8, x % 16 - 8) < 4
    given = np.where(hole, np.float32(0), truth)
    assert find_edge_bias(given, busy_blocks(given), Oracle(truth)) == 0


def test_maps_without_steps_are_not_asked_at_all():
    oracle = Oracle(np.zeros((64, 64)))
    assert find_edge_bias(np.zeros((64, 64), np.float32), np.zeros((8, 8), bool), oracle) == 0
    assert oracle.asked == 0


@pytest.mark.parametrize("shape", [(8, 8), (8, 512), (1024, 16)])
def test_any_size(shape):
    truth = np.where(np.arange(shape[1]) < shape[1] // 2, 0.9, 0.1) * np.ones(shape)
    given = shift_edges(truth.astype(np.float32), -3)
    busy = np.ones((shape[0] // 8, shape[1] // 8), bool)
    assert find_edge_bias(given, busy, Oracle(truth)) in {2, 3, 4}
