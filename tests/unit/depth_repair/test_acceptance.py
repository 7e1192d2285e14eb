"""Acceptance of a repair. Oracle: a plain loop over pixels."""

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.depth_repair.acceptance import (
    accept_repair,
    count_misplaced,
    misplaced_fractions,
)


def bars(height: int, width: int, period: int = 16) -> np.ndarray:
    """Return a map of vertical bars, (H, W)."""
    return np.tile((np.arange(width) % period < period // 2).astype(np.float32), (height, 1))


def test_counts_and_fractions_equal_those_of_a_loop():
    rng = np.random.default_rng(3)
    original = bars(45, 150)
    repaired = np.where(rng.random(original.shape) < 0.02, 1 - original, original)
    edge_pixels, misplaced = count_misplaced(original, repaired, 0.05)
    assert edge_pixels.shape == misplaced.shape == (6, 19)
    assert edge_pixels.sum() == original.size  # an edge is never farther than a block
    changed = repaired != original
    for row in range(6):
        for column in range(19):
            assert misplaced[row, column] == changed[8 * row : 8 * row + 8, 8 * column : 8 * column + 8].sum()
    assert_allclose(accept_repair(original, repaired).misplaced_fraction, changed.mean())
    fractions = misplaced_fractions(edge_pixels, misplaced)
    for row, column in ((0, 0), (3, 9), (5, 18)):
        window = np.s_[max(0, row - 8) : row + 9, max(0, column - 8) : column + 9]
        expected = (misplaced[window].sum() + 500 * changed.mean()) / (edge_pixels[window].sum() + 500)
        assert_allclose(fractions[row, column], expected)


def test_a_map_with_errors_on_one_side_is_repaired_only_there():
    truth = bars(200, 800)
    original = truth.copy()
    original[:, 3:200] = truth[:, :197]
    result, fraction, _ = accept_repair(original, truth)
    assert_array_equal(result, truth)
    assert 0.25 < fraction < 0.5


def test_isolated_changes_of_a_repair_are_rejected():
    original = bars(200, 800)
    repaired = original.copy()
    repaired[100:104, 300:312] = 0.4
    result, fraction, _ = accept_repair(original, repaired)
    assert_array_equal(result, original)
    assert fraction == 0
    assert not np.shares_memory(result, original)


def test_maps_without_edges_do_not_change():
    original = np.full((20, 30), 0.5, np.float32)
    result, fraction, _ = accept_repair(original, original.copy())
    assert_array_equal(result, original)
    assert fraction == 0
