"""Depth of field against the textbook and against the blur itself."""

import math

import pytest

from bokehnet.errors import ParameterError
from bokehnet.lenses import ThickLens, ThinLens
from bokehnet.lenses.reports.depth_of_field import depth_of_field


def test_limits_are_those_of_the_hyperfocal_formulas():
    """H = f^2 / (N c) + f; near s (H - f) / (H + s - 2 f), far s (H - f) / (H - s), c the blur's width."""
    f, number, c, s = 50.0, 2.8, 0.03, 3000.0
    hyperfocal = f * f / (number * c) + f
    near, far = depth_of_field(ThinLens(focal_length=f, f_number=number, focus_distance=s), c / 2)
    assert near == pytest.approx(s * (hyperfocal - f) / (hyperfocal + s - 2 * f))
    assert far == pytest.approx(s * (hyperfocal - f) / (hyperfocal - s))


def test_from_the_hyperfocal_distance_on_all_is_sharp_up_to_infinity():
    f, number, c = 35.0, 8.0, 0.03
    hyperfocal = f * f / (number * c) + f
    before, at, infinite = (
        depth_of_field(ThinLens(focal_length=f, f_number=number, focus_distance=focus), c / 2)
        for focus in (hyperfocal - 1, hyperfocal + 1, math.inf)
    )
    assert at[0] == pytest.approx(hyperfocal / 2, rel=1e-3)
    assert math.isfinite(before[1])
    assert math.isinf(at[1])
    assert infinite[0] == pytest.approx(hyperfocal - f)


def test_blur_at_the_limits_is_the_limit():
    lens = ThickLens(focal_length=85.0, f_number=2.0, focus_distance=2000.0, principal_depth=-25.0)
    near, far = depth_of_field(lens, 0.015)
    assert lens.coc_radius(1 / near) == pytest.approx(0.015)
    assert lens.coc_radius(1 / far) == pytest.approx(-0.015)


def test_a_limit_of_nothing_is_refused():
    with pytest.raises(ParameterError, match="more than 0"):
        depth_of_field(ThinLens(focal_length=50.0, f_number=2.0), 0.0)
