"""Augmented disparity: what is done to it stays within what disparity can be."""

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose, assert_array_equal
from scipy.ndimage import gaussian_filter, grey_dilation, map_coordinates, maximum_filter, minimum_filter

from train.data import augmentation
from train.data.augmentation import augment_disparity


def blocks(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.kron(rng.random((4, 4)), np.ones((16, 16))).astype(np.float32)


@pytest.mark.parametrize("seed", range(12))
def test_it_stays_in_the_range_of_the_true_one_and_differs(seed):
    disparity = blocks(seed)
    augmented = augment_disparity(disparity, np.random.default_rng(seed))
    assert augmented.shape == disparity.shape
    assert augmented.dtype == np.float32
    assert augmented.min() >= disparity.min() - 0.002  # half a step of eight bits
    assert augmented.max() <= disparity.max() + 0.002
    assert np.abs(augmented - disparity).max() > 0.01


def test_the_same_generator_degrades_equally():
    first, second = (augment_disparity(blocks(0), np.random.default_rng(5)) for _ in range(2))
    assert_array_equal(first, second)


def test_edges_move_by_pixels_and_no_farther():
    """The strongest changes together reach less than half of a 64-pixel map: its far corner stays."""
    disparity = np.zeros((96, 96), np.float32)
    disparity[:24, :24] = 1
    for seed in range(20):
        augmented = augment_disparity(disparity, np.random.default_rng(seed))
        assert np.abs(augmented[72:, 72:]).max() < 0.01


def noise() -> tuple[np.ndarray, torch.Tensor]:
    array = np.random.default_rng(3).random((40, 50), dtype=np.float32)
    return array, torch.from_numpy(array)[None, None]


def test_growth_is_the_largest_or_least_of_a_window():
    """Oracle: scipy's filters with the border repeated."""
    array, tensor = noise()
    assert_array_equal(augmentation._grow(tensor, 3)[0, 0], maximum_filter(array, 7, mode="nearest"))
    assert_array_equal(augmentation._grow(tensor, -2)[0, 0], minimum_filter(array, 5, mode="nearest"))


def test_rounded_growth_is_by_a_cross_and_a_square_in_turn():
    """Oracle: scipy's grey dilation."""
    array, tensor = noise()
    cross = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]], bool)
    expected = grey_dilation(array, footprint=cross, mode="nearest")
    expected = grey_dilation(expected, footprint=np.ones((3, 3), bool), mode="nearest")
    expected = grey_dilation(expected, footprint=cross, mode="nearest")
    assert_array_equal(augmentation._grow(tensor, 3, rounded=True)[0, 0], expected)


def test_blur_is_a_gaussian():
    """Oracle: scipy's filter, cut off at the same place."""
    array, tensor = noise()
    expected = gaussian_filter(array, 1.4, mode="nearest", radius=5)
    assert_allclose(augmentation._blur(tensor, 1.4)[0, 0], expected, atol=1e-6)


def test_a_shift_takes_each_value_from_its_own_way_off():
    """Oracle: scipy's linear interpolation, the border repeated."""
    array, tensor = noise()
    rng, same = (np.random.default_rng(7) for _ in range(2))
    shifted = augmentation._shift(tensor, 2.0, rng)[0, 0]
    way = 2.0 * augmentation._smooth_noise((40, 50), 2, float(same.uniform(24, 96)), same)[0].numpy()
    y, x = np.mgrid[:40, :50]
    expected = map_coordinates(array, [y + way[1], x + way[0]], order=1, mode="nearest")
    assert np.abs(way).max() > 1
    assert_allclose(shifted, expected, atol=3e-5)
