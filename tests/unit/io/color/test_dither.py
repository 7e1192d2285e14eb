"""Rounding to few levels."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from bokehnet.io.color.dither import quantise


def test_levels_stay_where_they_are():
    levels = np.repeat(np.arange(256.0).reshape(16, 16, 1), 3, axis=2) / 255
    assert_array_equal(quantise(levels, 8, top=5), np.rint(levels * 255))
    assert_array_equal(quantise(levels.astype(np.float32), 8, top=5), np.rint(levels * 255))


@pytest.mark.parametrize("share", [0.1, 0.5, 0.83])
def test_the_mean_of_a_few_pixels_is_the_value(share):
    """Between two levels: 8x8 pixels tell an eighth of a level and less."""
    flat = np.full((64, 64, 3), (100 + share) / 255)
    result = quantise(flat, 8, top=0).astype(float)
    assert set(np.unique(result)) == {100.0, 101.0}
    means = result.reshape(8, 8, 8, 8, 3).mean(axis=(1, 3)) - 100
    assert np.abs(means - share).max() < 1 / 16
    assert abs(means.mean() - share) < 0.005


def test_a_slope_shows_no_bands():
    """Plain rounding leaves a sawtooth of half a level; over 8x8 pixels nothing of it remains."""
    slope = np.tile(np.linspace(100, 104, 512)[None, :, None], (64, 1, 1)) / 255
    means = [
        (quantise(slope, 8, top=top).astype(float) - 255 * slope).reshape(8, 8, 64, 8).mean(axis=(1, 3))
        for top in (None, 0)
    ]
    assert np.abs(means[0]).max() > 0.4
    assert np.abs(means[1]).max() < 0.07


def test_grey_stays_grey():
    """It distinguishes maps from colour pictures."""
    grey = np.repeat(np.random.default_rng(0).random((20, 30, 1)), 3, axis=2)
    result = quantise(grey, 8, top=3)
    assert_array_equal(result, np.repeat(result[..., :1], 3, axis=2))


def test_strips_are_cut_from_one_picture():
    values = np.random.default_rng(0).random((50, 40, 3))
    whole = quantise(values, 8, top=0)
    assert_array_equal(
        np.concatenate([quantise(values[:17], 8, top=0), quantise(values[17:], 8, top=17)]), whole
    )


def test_without_a_place_it_is_plain_rounding():
    values = np.random.default_rng(0).random((5, 4, 3))
    assert_array_equal(quantise(values, 16), np.rint(values * 65535))
    assert quantise(values, 16).dtype == np.uint16
