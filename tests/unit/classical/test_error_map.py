import numpy as np
import pytest
from numpy.testing import assert_array_equal

from bokehnet.classical.error_map import geometric_error_map
from bokehnet.errors import ParameterError


def step(left: float, right: float) -> np.ndarray:
    return np.repeat([[left] * 30 + [right] * 30], 40, axis=0)


def test_a_step_marks_the_reach_of_the_larger_radius_on_both_sides():
    """Boundary pixels are columns 29 and 30; each reaches 8 pixels."""
    mask = geometric_error_map(step(-8.0, 2.0), softness=0)
    assert_array_equal(np.flatnonzero(mask[20]), np.arange(29 - 8, 30 + 8 + 1))


def test_a_slope_marks_nothing():
    slope = np.repeat(np.linspace(-6, 6, 60)[None], 40, axis=0)
    assert geometric_error_map(slope).max() == 0


def test_soft_edge_is_outside_the_hard_mask_and_narrow():
    soft, hard = (geometric_error_map(step(-8.0, 2.0), softness=s) for s in (2, 0))
    assert soft[hard == 1].min() == pytest.approx(1)
    assert set(np.flatnonzero(soft[20])) <= set(range(29 - 12, 30 + 13))
    assert 0 < soft[20, 29 - 9] < 1


def test_the_mask_does_not_care_about_the_side_of_focus():
    assert_array_equal(geometric_error_map(step(-8.0, 2.0)), geometric_error_map(step(8.0, -2.0)))


def test_a_step_inside_the_sharp_range_still_counts_as_a_boundary():
    """A jump of 1 px is seen even when it is small; one of 0.4 px is not (threshold 0.5)."""
    assert geometric_error_map(step(0.0, 1.0)).max() == 1
    assert geometric_error_map(step(0.0, 0.4)).max() == 0


def test_nan_is_rejected():
    with pytest.raises(ParameterError, match="NaN"):
        geometric_error_map(np.full((3, 3), np.nan))
