"""Augmented disparity: what is done to it stays within what disparity can be."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from train.augmentation import augment_disparity


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


def test_the_same_generator_spoils_alike():
    first, second = (augment_disparity(blocks(0), np.random.default_rng(5)) for _ in range(2))
    assert_array_equal(first, second)


def test_edges_move_by_pixels_and_no_farther():
    """The strongest changes together reach less than half of a 64-pixel map: its far corner stays."""
    disparity = np.zeros((96, 96), np.float32)
    disparity[:24, :24] = 1
    for seed in range(20):
        augmented = augment_disparity(disparity, np.random.default_rng(seed))
        assert np.abs(augmented[72:, 72:]).max() < 0.01
