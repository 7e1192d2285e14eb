"""The slider that is nearest to a barrel, and that both are one model."""

import dataclasses

import numpy as np
import pytest

from bokehnet.lenses import load_lens
from bokehnet.lenses.aberrations.aberration_fit import fit_aberration_map
from bokehnet.lenses.aberrations.relative_illumination import relative_illumination
from bokehnet.lenses.reports.cats_eye import nearest_cats_eye
from bokehnet.optics.aberrations.aberration_map import rim_passes
from bokehnet.optics.aperture import cats_eye_shift
from bokehnet.optics.vignette import rim_factor


@pytest.mark.parametrize("slider", [0.0, 0.4, 1.1])
def test_a_barrel_that_is_a_slider_is_that_slider(slider):
    result, differs = nearest_cats_eye([(slider, 1.0)] if slider else [])
    assert result == pytest.approx(slider, abs=0.006)
    assert differs < 0.005


def test_a_barrel_on_both_sides_is_a_slider_of_twice_the_shift():
    """Geometry: discs at -s and s meet in the shape that discs at 0 and 2 s meet in, about another middle."""
    result, differs = nearest_cats_eye([(0.3, 1.0), (-0.3, 1.0)])
    assert result == pytest.approx(0.6, rel=0.02)
    assert differs < 0.02


def test_a_narrow_barrel_is_no_slider():
    _, differs = nearest_cats_eye([(0.0, 0.7)])
    assert differs > 0.1


def test_the_slider_of_a_traced_lens_leaves_the_light_that_its_rims_leave():
    """Traced: the light of the Petzval lens over cos^4, in the mean over its picture."""
    lens = load_lens("petzval")
    slider, _ = nearest_cats_eye(fit_aberration_map(lens, wavelengths=()).vignetting_apertures)
    radius = lens.prescription.image_radius
    shares = np.sqrt((np.arange(32) + 0.5) / 32)
    place = np.linspace(0, 1, 33)
    light = np.interp(shares, place, relative_illumination(lens, radius))
    slope = shares * radius / (lens.sensor_position - lens.paraxial.exit.position)
    expected = (light * (1 + slope**2) ** 2).mean()
    assert rim_factor(np.stack([shares, 0 * shares], -1), slider).mean() == pytest.approx(expected, rel=0.03)


def test_the_slider_is_a_rim_of_the_aberration_map():
    """One model: a slider clips the rays that a vignetting aperture of its shift and radius 1 clips."""
    rng = np.random.default_rng(0)
    size, slider = (301, 201), 0.7
    pupil, place = rng.uniform(-1, 1, (500, 2)), rng.uniform(0, 200, 2)
    shift = np.array(cats_eye_shift(slider, *place, *size))
    half_diagonal = 0.5 * np.hypot(*size)
    field = (place - (np.array(size) - 1) / 2) / half_diagonal
    expected = ((pupil - shift) ** 2).sum(-1) <= 1
    assert (rim_passes(pupil, field, slider, 1.0) == expected).all()
    assert 50 < expected.sum() < 450


@pytest.mark.parametrize("name", ["petzval", pytest.param("double_gauss", marks=pytest.mark.slow)])
def test_the_slider_has_the_opening_that_is_traced(name):
    """Authority: which rays of a point near the corner the glass lets pass, where they cross the pupil.

    Both shapes are centred on each other, in one size; at most 12 % of what either covers is of
    one alone.
    """
    lens = load_lens(name, focus_distance=30 * load_lens(name).focal_length)
    lens = dataclasses.replace(lens, pupil_sampling="exit")
    slider, differs = nearest_cats_eye(fit_aberration_map(lens, wavelengths=()).vignetting_apertures)
    field = np.array([0.9, 0.0])
    axis = np.linspace(-1.5, 1.5, 301)
    points = np.stack(np.meshgrid(axis, axis), -1).reshape(-1, 2)
    sensor = np.broadcast_to(-field * lens.prescription.image_radius, points.shape)
    passed = lens.sample_rays(sensor, points).weight > 0
    # Light passes left of the pupil's middle where aperture coordinates say right.
    traced = -lens.sample_rays(sensor, points).origin[passed] / lens.thick.pupil_radius
    drawn = points[rim_passes(points, field, slider, 1.0) & ((points**2).sum(-1) <= 1)]
    shapes = [covered(traced), covered(drawn)]
    assert (drawn[:, 0].max() - drawn[:, 0].min()) < 0.95 * (drawn[:, 1].max() - drawn[:, 1].min())
    apart = (shapes[0] != shapes[1]).sum() / (shapes[0] | shapes[1]).sum()
    assert apart < 0.12, (slider, differs, apart)
    assert differs < 0.12


def covered(points, cells=40):
    """Cells that points fill, their middle in the middle and their spread a quarter of the side."""
    away = (points - points.mean(0)) / np.sqrt(((points - points.mean(0)) ** 2).sum(-1).mean())
    seen, _, _ = np.histogram2d(away[:, 1], away[:, 0], cells, [[-2, 2], [-2, 2]])
    return seen > 0
