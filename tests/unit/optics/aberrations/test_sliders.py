"""Aberrations by hand: each slider does what its description says, in its unit."""

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose

from bokehnet.errors import ParameterError
from bokehnet.optics.aberrations.aberration_map import AberrationMap
from bokehnet.optics.aberrations.sliders import AberrationSliders

NAMES = [field.name for field in dataclasses.fields(AberrationSliders) if field.name != "focusing"]
RIM = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
CORNER = np.array([0.6, -0.8])
ACROSS = np.array([0.8, 0.6])


def transverse_aberration(pupil, field, **sliders):
    pupil = np.asarray(pupil, float)
    result, run, passes = AberrationSliders(**sliders).aberration_map()(
        pupil, np.broadcast_to(field, pupil.shape)
    )
    assert_allclose(run, pupil)
    assert passes.all()
    return result


def disc_radii(defocus, pupil, field, **sliders):
    """Return the distances of the rays of a light from its image by a perfect lens."""
    return np.linalg.norm(defocus * pupil + transverse_aberration(pupil, field, **sliders), axis=-1)


def test_all_at_zero_is_the_perfect_lens():
    aberration_map = AberrationSliders().aberration_map()
    assert aberration_map.is_perfect
    assert_allclose(aberration_map.transverse_aberration, AberrationMap.perfect().transverse_aberration)


def test_sliders_add_up_and_are_proportional_to_their_number():
    aberration_maps = [
        AberrationSliders(**{name: 2.5}).aberration_map().transverse_aberration for name in NAMES
    ]
    assert all(np.abs(aberration_map).max() > 0 for aberration_map in aberration_maps)
    all_four = AberrationSliders(**dict.fromkeys(NAMES, 2.5)).aberration_map().transverse_aberration
    assert_allclose(sum(aberration_maps), all_four, rtol=1e-14)
    assert_allclose(
        AberrationSliders(**dict.fromkeys(NAMES, -5.0)).aberration_map().transverse_aberration,
        -2 * all_four,
        rtol=1e-14,
    )


@pytest.mark.parametrize("field", [(0.0, 0.0), tuple(CORNER)])
def test_spherical_is_the_blur_of_the_rim_all_over_the_picture(field):
    """Authority: Born and Wolf 5.3, B rho^3."""
    assert_allclose(transverse_aberration(RIM, field, spherical=3.0, focusing="paraxial"), 0.03 * RIM)
    assert_allclose(
        transverse_aberration(0.5 * RIM, field, spherical=3.0, focusing="paraxial"), 0.03 / 8 * RIM
    )


def test_overcorrected_discs_behind_focus_have_a_bright_rim_and_those_in_front_fade_out():
    """Light goes as the inverse of the area that a ring of the pupil fills: bright where radii bunch."""
    radius = np.linspace(0, 1, 101)
    pupil = np.stack([radius, 0 * radius], -1)
    for sign in (1, -1):
        for defocus, bunched in ((-0.06 * sign, True), (0.06 * sign, False)):
            areas = np.diff(
                disc_radii(defocus, pupil, (0, 0), spherical=sign * 1.5, focusing="paraxial") ** 2
            )
            light = np.diff(radius**2) / areas
            assert (light[-1] > 2 * light[0]) == bunched


def test_least_blur_in_focus_is_at_minus_two_thirds_of_the_spherical_slider():
    """Oracle: rms over the disc by quadrature, for a row of defocus values."""
    radius = np.sqrt((np.arange(4000) + 0.5) / 4000)
    pupil = np.stack([radius, 0 * radius], -1)
    tried = np.linspace(-0.03, 0.0, 301)
    rms = [
        np.mean(disc_radii(defocus, pupil, (0, 0), spherical=3.0, focusing="paraxial") ** 2)
        for defocus in tried
    ]
    assert tried[np.argmin(rms)] == pytest.approx(-0.02, abs=1.5e-4)


def test_coma_draws_a_tail_outwards_of_the_given_length_and_a_third_as_wide_to_each_side():
    """Authority: Born and Wolf 5.3: circles of radius F rho^2 around 2 F rho^2; here 3 F is the slider."""
    angle = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    tail = transverse_aberration(np.stack([np.cos(angle), np.sin(angle)], -1), CORNER, coma=9.0)
    along, across = tail @ CORNER, tail @ ACROSS
    assert (along.max(), along.min()) == (pytest.approx(0.09, rel=1e-4), pytest.approx(0.03, rel=1e-4))
    assert across.max() == pytest.approx(0.03, rel=1e-4)
    assert_allclose(transverse_aberration([[0.0, 0.0]], CORNER, coma=9.0), 0)
    assert_allclose(transverse_aberration(RIM, (0, 0), coma=9.0), 0)
    assert (transverse_aberration(RIM, CORNER, coma=-9.0) @ CORNER < 0).all()


def test_astigmatism_leaves_a_disc_in_focus_and_draws_discs_behind_focus_around_the_middle():
    """Authority: Born and Wolf 5.3; the medial image is round."""
    aberrations = transverse_aberration(np.stack([CORNER, ACROSS]), CORNER, astigmatism=4.0)
    assert_allclose(aberrations, [0.04 * CORNER, -0.04 * ACROSS])
    assert_allclose(
        transverse_aberration(RIM, 0.5 * CORNER, astigmatism=4.0),
        transverse_aberration(RIM, CORNER, astigmatism=1.0),
    )
    for defocus, around in ((-0.1, True), (0.1, False)):
        along, across = disc_radii(defocus, np.stack([CORNER, ACROSS]), CORNER, astigmatism=4.0)
        assert (across > along) == around


def test_field_curvature_is_a_defocus_that_grows_towards_the_corner():
    """Above 0 the corner looks as if in front of focus, so that what is sharp there is farther away."""
    assert_allclose(transverse_aberration(RIM, CORNER, field_curvature=5.0), 0.05 * RIM)
    assert_allclose(transverse_aberration(RIM, 0.5 * CORNER, field_curvature=5.0), 0.0125 * RIM)
    assert_allclose(disc_radii(-0.05, RIM, CORNER, field_curvature=5.0), 0, atol=1e-15)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("value", [np.nan, np.inf, 101.0, -1e9])
def test_impossible_slider_values_are_reported(name, value):
    with pytest.raises(ParameterError, match=f"^{name}: expected"):
        AberrationSliders(**{name: value})
