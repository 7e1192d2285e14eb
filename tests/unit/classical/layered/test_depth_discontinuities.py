"""Authority: steps and slopes whose sides are known by construction."""

import numpy as np
import pytest

from bokehnet.classical.layered.depth_discontinuities import (
    BACK,
    FRONT,
    discontinuity_sides,
    sharpen_discontinuities,
)


def step(width=20, low=-5.0, high=10.0):
    defocus = np.full((8, width), low, np.float32)
    defocus[:, : width // 2] = high
    return defocus


def test_sides_of_a_step():
    sides = discontinuity_sides(step())
    assert (sides[:, 9] == FRONT).all()
    assert (sides[:, 10] == BACK).all()
    assert not sides[:, :9].any()
    assert not sides[:, 11:].any()


def test_a_line_thinner_than_its_surroundings_has_both_sides():
    defocus = np.zeros((5, 9), np.float32)
    defocus[:, 4], defocus[:, 5:] = 5.0, 10.0
    assert (discontinuity_sides(defocus)[:, 4] == FRONT | BACK).all()


@pytest.mark.parametrize("ramp", [2, 5, 11])
def test_a_ramp_becomes_a_step_in_its_middle(ramp):
    defocus = np.repeat(np.interp(np.arange(40), [15, 15 + ramp], [20.0, -20.0])[None], 6, 0)
    sharp = sharpen_discontinuities(defocus.astype(np.float32))
    assert set(np.unique(sharp)) <= {-20.0, 20.0}
    assert abs((sharp[0] > 0).sum() - (15.5 + ramp / 2)) <= 1


def test_steps_and_slopes_stay_as_they_are():
    slope = np.repeat((0.9 * np.arange(30, dtype=np.float32))[None], 6, 0)
    for defocus in (step(), slope, np.zeros((1, 1), np.float32)):
        np.testing.assert_array_equal(sharpen_discontinuities(defocus), defocus)
