"""Distortion models: the signs of photographers, calibrations, inverses, folds and gradients."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from kornia.geometry.calibration import distort_points
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.errors import ParameterError
from bokehnet.optics.aberrations.distortion import BrownConrady, DivisionModel

RNG = np.random.default_rng(0)
DISC = RNG.uniform(-1, 1, (500, 2))
DISC = DISC[np.hypot(*DISC.T) < 1]  # half-diagonals: all of any picture
CALIBRATIONS = [
    BrownConrady(radial=(-0.2, 0.05, 0.01)),
    BrownConrady(radial=(0.3, -0.1, 0.0)),
    BrownConrady(radial=(0.1, -0.3, 0.2), decentring=(0.01, -0.02)),
    BrownConrady(decentring=(-0.02, 0.015)),
]


@pytest.mark.parametrize("strength", [-0.4, -0.1, 0.1, 0.4])
def test_division_is_the_formula_and_its_strength_the_move_of_the_corner(strength):
    """Authority: Fitzgibbon 2001, u = d / (1 + K |d|^2)."""
    model = DivisionModel(strength=strength)
    squares = (DISC**2).sum(-1, keepdims=True)
    assert_allclose(model.undistort(DISC), DISC / (1 + strength * squares), rtol=1e-14)
    corner = np.array([0.8, 0.6])
    u = model.undistort(corner)
    assert 1 / np.hypot(*u) - 1 == pytest.approx(strength)


@pytest.mark.parametrize("model", [DivisionModel(strength=-0.2), BrownConrady(radial=(-0.2, 0.0, 0.0))])
def test_below_0_draws_inwards(model):
    """Barrel: |d| < |u|, and the more so farther out."""
    u = np.array([[0.3, 0.0], [0.9, 0.0]])
    moved = np.hypot(*model.distort(u).T) / u[:, 0]
    assert moved[1] < moved[0] < 1


@given(strength=st.floats(-0.9, 0.9), x=st.floats(-0.7, 0.7), y=st.floats(-0.7, 0.7))
def test_division_is_undone_in_closed_form(strength, x, y):
    model = DivisionModel(strength=strength)
    d = np.array([x, y])
    assert_allclose(model.distort(model.undistort(d)), d, rtol=1e-9, atol=1e-12)


@given(
    radial=st.tuples(*[st.floats(-0.5, 0.5)] * 3),
    decentring=st.tuples(*[st.floats(-0.01, 0.01)] * 2),
    x=st.floats(-0.7, 0.7),
    y=st.floats(-0.7, 0.7),
)
def test_the_polynomial_is_undone_by_newton_wherever_it_does_not_fold(radial, decentring, x, y):
    model = BrownConrady(radial=radial, decentring=decentring)
    if model.reach < 1.1:  # decentring folds a little before
        return
    d = np.array([[x, y]])
    assert_allclose(model.distort(model.undistort(d)), d, atol=1e-10)


@pytest.mark.parametrize("model", CALIBRATIONS)
def test_the_polynomial_is_that_of_calibrations(model):
    """Oracle: kornia's distort_points, OpenCV's order of coefficients, with the identity as camera."""
    (k1, k2, k3), (p1, p2) = model.radial, model.decentring
    coefficients = torch.tensor([[k1, k2, p1, p2, k3]], dtype=torch.float64)
    camera = torch.eye(3, dtype=torch.float64)[None]
    expected = distort_points(torch.from_numpy(DISC)[None], camera, coefficients)[0]
    assert_allclose(model.distort(DISC), expected.numpy(), atol=1e-12)


@pytest.mark.parametrize("radial", [(-0.2, 0.0, 0.0), (-0.3, 0.02, 0.0), (0.2, -0.3, 0.05), (0.0, 0.0, -0.1)])
def test_the_reach_is_where_the_radius_turns_back(radial):
    """Oracle: the first maximum of |d| over |u| on a dense grid."""
    radius = np.linspace(0, 5, 2_000_001)
    square = radius**2
    d = radius * (1 + square * (radial[0] + square * (radial[1] + square * radial[2])))
    turning = np.flatnonzero(np.diff(d) <= 0)[0]
    model = BrownConrady(radial=radial)
    assert model.reach == pytest.approx(d[turning], rel=1e-9)
    near, beyond = np.array([[0.999 * model.reach, 0.0]]), np.array([[0.0, 1.001 * model.reach]])
    assert np.isinf(model.undistort(beyond)).all()
    u = model.undistort(near)
    assert u[0, 0] < radius[turning]
    assert_allclose(model.distort(u), near, atol=1e-10)
    assert np.isinf(model.distort(np.array([1.001 * radius[turning], 0.0]))).all()


@pytest.mark.parametrize("strength", [-0.6, 0.6])
def test_beyond_its_reach_division_has_no_place(strength):
    """|strength| |d|^2 = 1 is the pole of a barrel and the fold of a pincushion."""
    model = DivisionModel(strength=strength)
    radius = 1 / math.sqrt(0.6)
    places = np.array([[0.999 * radius, 0.0], [1.001 * radius, 0.0]])
    assert_array_equal(np.isinf(model.undistort(places)), [[False, False], [True, True]])
    if strength > 0:  # |u| has its largest value, radius / 2, at the fold
        assert np.isinf(model.distort(np.array([0.501 * radius, 0.0]))).all()


def test_an_identity_is_exact():
    for model in (DivisionModel(strength=0.0), BrownConrady()):
        assert_array_equal(model.undistort(DISC), DISC)
        assert_array_equal(model.distort(DISC), DISC)


def test_decentring_that_folds_is_reported():
    with pytest.raises(ParameterError, match="folds over itself"):
        BrownConrady(decentring=(0.4, 0.0)).undistort(DISC)


@pytest.mark.parametrize("strength", [-0.91, 2.0, math.nan])
def test_a_strength_out_of_range_is_reported(strength):
    with pytest.raises(ParameterError, match=r"strength: expected -0\.9 to 0\.9"):
        DivisionModel(strength=strength)


def test_a_non_numeric_coefficient_is_reported():
    with pytest.raises(ParameterError, match="radial: expected a finite number"):
        BrownConrady(radial=(0.1, math.inf, 0.0))


def tensors(*numbers):
    return [torch.tensor(number, dtype=torch.float64, requires_grad=True) for number in numbers]


@pytest.mark.parametrize("way", ["distort", "undistort"])
def test_gradients_of_places_and_coefficients(way):
    """Oracle: finite differences, by gradcheck."""
    places = torch.from_numpy(DISC[:6]).clone().requires_grad_()
    division = lambda places, k: getattr(DivisionModel(strength=k), way)(places)  # noqa: E731
    assert torch.autograd.gradcheck(division, (places, *tensors(-0.3)))

    def polynomial(places, k1, k2, k3, p1, p2):
        return getattr(BrownConrady(radial=(k1, k2, k3), decentring=(p1, p2)), way)(places)

    assert torch.autograd.gradcheck(polynomial, (places, *tensors(-0.2, 0.1, 0.02, 0.01, -0.02)))


@pytest.mark.parametrize("model", [*CALIBRATIONS, DivisionModel(strength=0.3)])
def test_tensors_are_treated_as_arrays_are(model):
    assert_allclose(model.undistort(torch.from_numpy(DISC)).numpy(), model.undistort(DISC), atol=1e-14)
