"""Factors that darken: their formulas, their ends, and how they are undone."""

import math

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.errors import ParameterError
from bokehnet.optics.vignette import Vignette, cos4_factor, rim_factor, scale_saturation

FIELD = np.random.default_rng(0).uniform(-0.7, 0.7, (40, 2))
CORNER = np.array([0.8, 0.6])  # of a picture of 4:3


def test_cos4_is_that_of_the_angle():
    """Authority: the law; in the plane of the sensor the tangent grows with the radius."""
    radius = np.hypot(*FIELD.T)
    angle = np.arctan(radius * math.tan(math.radians(40)))
    assert_allclose(cos4_factor(FIELD, 40), np.cos(angle) ** 4, rtol=1e-12)
    assert cos4_factor(CORNER, 45) == pytest.approx(0.25)


@pytest.mark.parametrize("shift", [0.3, 1.0, 1.5])
def test_rims_leave_what_two_discs_share(shift):
    """Oracle: points of a fine grid that lie in both discs."""
    v, u = np.mgrid[-1:1:2001j, -1:1:2001j]
    disc = u * u + v * v <= 1
    moved = (u - 0.8 * shift) ** 2 + (v - 0.6 * shift) ** 2 <= 1
    assert rim_factor(CORNER, shift) == pytest.approx((disc & moved).sum() / disc.sum(), abs=2e-4)


def test_strength_0_is_1_to_the_bit():
    for factor in (
        cos4_factor(FIELD, 0.0),
        rim_factor(FIELD, 0.0),
        Vignette(stops=0.0).factor(FIELD, 4 / 3),
    ):
        assert_array_equal(factor, 1)


@pytest.mark.parametrize("roundness", [0.0, 0.4, 1.0])
def test_a_vignette_begins_at_its_radius_and_is_full_in_the_corner(roundness):
    """Default radius and softness sum to 1, the corner, whatever the roundness."""
    vignette = Vignette(stops=1.5, roundness=roundness)
    corners = np.array([[0.8, 0.6], [-0.8, 0.6], [0.8, -0.6]])
    assert_allclose(vignette.factor(corners, 4 / 3), 2**-1.5)
    inner = 0.2 * np.array([[1, 0], [0, 1], [-0.6, 0.8]])
    assert_array_equal(vignette.factor(inner, 4 / 3), 1)


def test_roundness_0_is_the_ellipse_of_the_picture():
    """Points at the same parts of both half-sides are alike; a circle is darker at the long side."""
    places = np.array([[0.8 * 0.9, 0.0], [0.0, 0.6 * 0.9]])
    ellipse = Vignette(stops=1.0, roundness=0.0).factor(places, 4 / 3)
    assert ellipse[0] == pytest.approx(ellipse[1])
    assert ellipse[0] < 0.95
    circle = Vignette(stops=1.0).factor(places, 4 / 3)
    assert circle[0] < circle[1]


def test_the_falloff_is_the_smoothstep_of_the_squared_radius():
    """Smoothstep m^2 (3 - 2 m), the cubic with flat ends: 5/32 at a quarter of the way, 1/2 half-way."""
    vignette = Vignette(stops=1.0, radius=0.3, softness=0.7)
    for fraction, strength in ((0.25, 5 / 32), (0.5, 0.5)):
        radius = math.sqrt(0.3**2 + fraction * (1 - 0.3**2))
        assert vignette.factor(radius * CORNER, 4 / 3) == pytest.approx(2**-strength)


def test_stops_below_0_brighten_by_as_much():
    darker, brighter = (Vignette(stops=stops).factor(FIELD, 1.5) for stops in (2.0, -2.0))
    assert_allclose(darker * brighter, 1)
    assert darker.min() < 0.5


def test_every_factor_stays_above_0_at_its_end():
    """So that dividing undoes it."""
    assert cos4_factor(CORNER, 80) > 5e-4
    assert rim_factor(CORNER, 1.5) > 0.1
    assert Vignette(stops=10.0).factor(CORNER, 4 / 3) == pytest.approx(2**-10)


def test_gradients_of_the_strengths():
    """Oracle: finite differences, by gradcheck."""
    field = torch.from_numpy(FIELD)

    def factors(angle, shift, stops, radius, softness, roundness):
        vignette = Vignette(stops=stops, radius=radius, softness=softness, roundness=roundness)
        return cos4_factor(field, angle), rim_factor(field, shift), vignette.factor(field, 1.5)

    numbers = [
        torch.tensor(x, dtype=torch.float64, requires_grad=True) for x in (30, 0.8, 1.2, 0.2, 0.6, 0.5)
    ]
    assert torch.autograd.gradcheck(factors, numbers)


@pytest.mark.parametrize(
    "numbers",
    [
        {"stops": 11},
        {"stops": math.nan},
        {"radius": -0.1},
        {"softness": 0.0},
        {"roundness": 1.5},
        {"color_loss": 2},
    ],
)
def test_a_number_out_of_range_is_reported(numbers):
    name = next(iter(numbers))
    with pytest.raises(ParameterError, match=f"^{name}: expected"):
        Vignette(**{"stops": 1.0, **numbers})


def test_colour_goes_towards_the_corners_and_luminance_stays():
    """Authority: the luminance of ITU-R BT.709, which half way to grey is the same."""
    vignette = Vignette(stops=0.0, color_loss=0.5)
    share = vignette.color(np.array([[0.0, 0.0], [0.6, 0.8]]), 1.5)
    assert_allclose(share, [1, 0.5])
    light = np.array([[0.9, 0.2, 0.1], [0.9, 0.2, 0.1]])
    result = scale_saturation(light, share)
    grey = 0.2126 * 0.9 + 0.7152 * 0.2 + 0.0722 * 0.1
    assert_array_equal(result[0], light[0])
    assert_allclose(result[1], (light[1] + grey) / 2)
    assert_allclose(result @ [0.2126, 0.7152, 0.0722], grey)
    assert_array_equal(vignette.factor(FIELD, 1.5), 1)
