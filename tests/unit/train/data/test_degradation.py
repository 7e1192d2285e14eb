import math

import numpy as np
import pytest

from bokehnet.errors import ParameterError
from train.data.degradation import DEGRADATIONS, DEGRADED, degrade

STEP = np.where(np.arange(64) < 30, 0.25, 0.75)[None].repeat(40, 0).astype(np.float32)


def _edge(disparity):
    """The first column that is near."""
    return int(np.argmax(disparity[20] > 0.5))


@pytest.mark.parametrize("shift", [2, 5])
def test_near_surfaces_lose_and_gain_the_given_number_of_pixels(shift):
    assert _edge(degrade(STEP, "eroded", shift)) == 30 + shift
    assert _edge(degrade(STEP, "dilated", shift)) == 30 - shift
    assert _edge(degrade(STEP, "eroded")) == 32


@pytest.mark.parametrize(("name", "pick"), [("eroded", np.min), ("dilated", np.max)])
def test_windows_are_those_of_a_plain_loop(name, pick):
    disparity = np.random.default_rng(0).random((17, 23)).astype(np.float32)
    padded = np.pad(disparity, 2, mode="edge")
    expected = [[pick(padded[y : y + 5, x : x + 5]) for x in range(23)] for y in range(17)]
    np.testing.assert_array_equal(degrade(disparity, name, edge_shift=2), expected)


def test_a_blurred_step_is_the_error_function_of_three_pixels():
    """Authority: a step under a Gaussian is its cumulative distribution."""
    expected = [0.25 + 0.25 * (1 + math.erf((x - 29.5) / 3 / math.sqrt(2))) for x in range(64)]
    np.testing.assert_allclose(degrade(STEP, "blurred")[20], expected, atol=2e-3)


def test_quantised_has_256_levels_and_errs_by_half_of_one():
    disparity = (0.3 + 4 * np.random.default_rng(1).random((50, 60))).astype(np.float32)
    result = degrade(disparity, "quantised")
    assert len(np.unique(result)) <= 256
    assert np.abs(result - disparity).max() <= np.ptp(disparity) / 255 / 2 + 1e-6
    assert np.abs(result - disparity).max() > np.ptp(disparity) / 255 / 3
    flat = np.full((4, 4), 0.3, np.float32)
    np.testing.assert_array_equal(degrade(flat, "quantised"), flat)


@pytest.mark.parametrize("name", DEGRADATIONS)
def test_defocus_may_be_given_in_place_of_disparity(name):
    """Defocus is ``blur * (disparity - focus)``; the sky has disparity 0."""
    disparity = np.random.default_rng(2).random((30, 40)).astype(np.float32)
    disparity[:10] = 0
    before = disparity.copy()
    result = degrade(32 * (disparity - 0.5), name)
    np.testing.assert_allclose(result, 32 * (degrade(disparity, name) - 0.5), atol=2e-5)
    assert result.dtype == np.float32
    np.testing.assert_array_equal(disparity, before)


def test_names_are_known():
    assert set(DEGRADED) < set(DEGRADATIONS)
    np.testing.assert_array_equal(degrade(STEP, "clean"), STEP)
    with pytest.raises(ParameterError, match="expected one of blurred, clean"):
        degrade(STEP, "shifted")
