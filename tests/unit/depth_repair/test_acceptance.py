"""Where a repaired map is taken: the shares are those of a plain loop over pixels."""

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.depth_repair.acceptance import (
    accept_repair,
    count_misplaced,
    misplaced_fractions,
)


def bars(height: int, width: int, period: int = 16) -> np.ndarray:
    """Upright bars."""
    return np.tile((np.arange(width) % period < period // 2).astype(np.float32), (height, 1))


def test_counts_and_shares_are_those_of_a_loop():
    rng = np.random.default_rng(3)
    given = bars(45, 150)
    repaired = np.where(rng.random(given.shape) < 0.02, 1 - given, given)
    near, moved = count_misplaced(given, repaired, 0.05)
    assert near.shape == moved.shape == (6, 19)
    assert near.sum() == given.size  # a step is never farther than a block
    changed = repaired != given
    for row in range(6):
        for column in range(19):
            assert moved[row, column] == changed[8 * row : 8 * row + 8, 8 * column : 8 * column + 8].sum()
    assert_allclose(accept_repair(given, repaired).misplaced_fraction, changed.mean())
    shares = misplaced_fractions(near, moved)
    for row, column in ((0, 0), (3, 9), (5, 18)):
        window = np.s_[max(0, row - 8) : row + 9, max(0, column - 8) : column + 9]
        wanted = (moved[window].sum() + 500 * changed.mean()) / (near[window].sum() + 500)
        assert_allclose(shares[row, column], wanted)


def test_a_map_that_is_wrong_on_one_side_is_repaired_there():
    right = bars(200, 800)
    given = right.copy()
    given[:, 3:200] = right[:, :197]
    result, taken, _ = accept_repair(given, right)
    assert_array_equal(result, right)
    assert 0.25 < taken < 0.5


def test_single_mistakes_of_a_repair_are_not_taken():
    given = bars(200, 800)
    repaired = given.copy()
    repaired[100:104, 300:312] = 0.4
    result, taken, _ = accept_repair(given, repaired)
    assert_array_equal(result, given)
    assert taken == 0
    assert not np.shares_memory(result, given)


def test_maps_without_steps_stay_as_they_are():
    given = np.full((20, 30), 0.5, np.float32)
    result, taken, _ = accept_repair(given, given.copy())
    assert_array_equal(result, given)
    assert taken == 0
