"""The thin lens against textbook formulas, and against rays."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from bokehnet.errors import LensError, ShapeError
from bokehnet.lenses import ThinLens, defocus_map
from bokehnet.optics.coc import defocus_from_disparity

distances = st.floats(200, 1e6)


@given(depth=distances, focus=distances, focal_length=st.floats(8, 150), f_number=st.floats(1, 22))
def test_coc_equals_the_textbook_formula(depth, focus, focal_length, f_number):
    lens = ThinLens(focal_length=focal_length, f_number=f_number, focus_distance=focus)
    diameter = focal_length**2 * abs(depth - focus) / (f_number * depth * (focus - focal_length))
    assert abs(lens.coc_radius(1 / depth)) == pytest.approx(diameter / 2, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("depth", [400.0, 900.0, 5000.0])
def test_traced_spot_equals_coc_radius(depth):
    """The ray tracer and the classical renderers must agree about one lens."""
    lens = ThinLens(focal_length=50.0, f_number=1.8, focus_distance=1200.0)
    angle = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    rays = lens.sample_rays(np.zeros(2), np.stack([np.cos(angle), np.sin(angle)], axis=-1))
    spot = np.linalg.norm(rays.origin + depth * rays.slope, axis=-1)
    assert_allclose(spot * lens.sensor_distance / depth, abs(lens.coc_radius(1 / depth)), rtol=1e-12)


def test_lens_focused_at_infinity_blurs_by_pupil_and_focal_length():
    lens = ThinLens(focal_length=50.0, f_number=2.0)
    assert lens.sensor_distance == pytest.approx(50)
    assert lens.coc_radius(1 / 1000) == pytest.approx(12.5 * 50 / 1000)
    assert lens.coc_radius(0.0) == 0


def test_relative_disparity_and_lens_data_give_one_defocus():
    """K = pupil radius * sensor distance / pixel pitch makes the relative formula the physical one."""
    lens = ThinLens(focal_length=85.0, f_number=1.4, focus_distance=2000.0)
    disparity = np.array([[0.0, 1 / 900, 1 / 2000, 1 / 5000]])
    blur = lens.pupil_radius * lens.sensor_distance / 0.02
    assert_allclose(
        defocus_map(disparity, lens, 0.02), defocus_from_disparity(disparity, blur, 1 / 2000), atol=1e-12
    )


def test_defocus_formula_of_an_independent_renderer():
    """r = 0.5 f^2 / N |z - zf| / (z (zf - f)) W / sensor width, here for f/1.66 at 2.25 m, z = 0.5 m."""
    lens = ThinLens(focal_length=50.0, f_number=1.66, focus_distance=2250.0)
    expected = 0.5 * 0.05**2 / 1.66 * (2.25 - 0.5) / (0.5 * (2.25 - 0.05)) * 640 / 0.036
    assert defocus_map(np.full((1, 1), 1 / 500), lens, 36 / 640)[0, 0] == pytest.approx(expected)


@pytest.mark.parametrize(
    "data",
    [
        {"focal_length": 0.0, "f_number": 2.0},
        {"focal_length": 50.0, "f_number": 0.0},
        {"focal_length": 50.0, "f_number": 2.0, "focus_distance": 40.0},
        {"focal_length": math.nan, "f_number": 2.0},
        {"focal_length": 50.0, "f_number": math.inf},
    ],
)
def test_impossible_lenses_are_refused(data):
    with pytest.raises(LensError, match=r"need|focal_length: expected a number, got nan"):
        ThinLens(**data)


def test_defocus_map_wants_a_map():
    with pytest.raises(ShapeError, match=r"\(H, W\)"):
        defocus_map(np.zeros(5), ThinLens(focal_length=50.0, f_number=2.0), 0.01)
