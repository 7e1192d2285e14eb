"""Filters of the depth repair against SciPy and against their formulas, pixel by pixel."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.ndimage import maximum_filter, minimum_filter
from scipy.ndimage import shift as scipy_shift

from bokehnet.depth_repair.filters import (
    joint_bilateral,
    local_extremes,
    shift_edges,
    translate_map,
    weighted_median,
)


@pytest.mark.parametrize("pixels", range(-5, 6))
def test_shifting_equals_the_rank_filter_of_scipy(pixels):
    """Oracle: the filters of SciPy."""
    disparity = np.random.default_rng(0).random((61, 83), dtype=np.float32)
    oracle = maximum_filter if pixels > 0 else minimum_filter
    expected = oracle(disparity, 2 * abs(pixels) + 1, mode="nearest")
    assert_array_equal(shift_edges(disparity, pixels), expected)


def test_local_extremes_equal_the_rank_filters_of_scipy():
    """Oracle: the filters of SciPy."""
    values = np.random.default_rng(1).random((23, 31), dtype=np.float32)
    low, high = local_extremes(values, 3)
    assert_array_equal(low, minimum_filter(values, 7, mode="nearest"))
    assert_array_equal(high, maximum_filter(values, 7, mode="nearest"))


@pytest.mark.parametrize("offset", [(0, 1), (0, -2), (3, 0), (-4, 4), (5, -6), (-1, -7)])
def test_translation_repeats_the_border(offset):
    """Oracle: scipy's shift."""
    disparity = np.random.default_rng(0).random((31, 43), dtype=np.float32)
    assert_array_equal(
        translate_map(disparity, offset), scipy_shift(disparity, offset, order=0, mode="nearest")
    )


def test_the_bilateral_filter_equals_its_formula():
    """Oracle: the weighted mean, window by window."""
    rng = np.random.default_rng(0)
    colors, disparity = rng.random((9, 11, 3), np.float32), rng.random((9, 11), np.float32)
    expected = np.empty(disparity.shape)
    for y, x in np.ndindex(disparity.shape):
        window = slice(max(0, y - 3), y + 4), slice(max(0, x - 3), x + 4)
        color_distance = ((colors[window] - colors[y, x]) ** 2).sum(-1) / 0.06**2
        distance = color_distance + ((disparity[window] - disparity[y, x]) / 0.25) ** 2
        weight = np.exp(-0.5 * distance)
        expected[y, x] = (weight * disparity[window]).sum() / weight.sum()
    assert_allclose(joint_bilateral(colors, disparity, 3, 0.06, 0.25), expected, atol=1e-5)


def test_the_weighted_median_equals_that_of_sorted_disparities():
    """Oracle: sorted disparities; the tolerance is one of 24 bins of their range."""
    rng = np.random.default_rng(1)
    colors, disparity = rng.random((14, 15, 3), np.float32), rng.random((14, 15), np.float32)
    filtered = weighted_median(colors, disparity, np.ones((14, 15), bool), 3, 0.05, 0.05)
    for y, x in np.ndindex(disparity.shape):
        window = np.s_[max(0, y - 3) : y + 4, max(0, x - 3) : x + 4]
        weight = np.exp(-((colors[window] - colors[y, x]) ** 2).sum(-1) / (2 * 0.05**2)).ravel()
        values = disparity[window].ravel()
        order = np.argsort(values)
        cumulative = np.cumsum(weight[order])
        median = values[order][np.searchsorted(cumulative, 0.5 * cumulative[-1])]
        assert_allclose(filtered[y, x], median, atol=np.ptp(values) / 24 + 1e-6)


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (3, 17)])
def test_small_maps_stay_finite_and_within_range(shape):
    rng = np.random.default_rng(0)
    colors, disparity = rng.random((*shape, 3), np.float32), rng.random(shape, np.float32)
    for result in (
        weighted_median(colors, disparity, np.ones(shape, bool), 3, 0.05, 0.05),
        joint_bilateral(colors, disparity, 3, 0.05, 0.1),
        shift_edges(disparity, 2),
    ):
        assert np.isfinite(result).all()
        assert disparity.min() - 1e-6 <= result.min() <= result.max() <= disparity.max() + 1e-6
