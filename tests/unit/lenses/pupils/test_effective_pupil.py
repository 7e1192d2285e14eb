"""Aiming at what is open: few rays are lost, and no light."""

import dataclasses

import numpy as np
import pytest

from bokehnet.lenses import catalog_names, load_lens
from bokehnet.lenses.reports.unvignetted_fraction import unvignetted_fraction
from bokehnet.optics.sampling import disc_from_square, halton

UV = disc_from_square(np.stack([halton(4096, 2), halton(4096, 3)], -1))


@pytest.mark.parametrize("name", catalog_names(mirrors=False))
def test_most_rays_pass_wherever_they_start(name):
    lens = load_lens(name)
    shares = [
        unvignetted_fraction(lens, share * lens.prescription.image_radius) for share in (0.0, 0.3, 0.7, 1.0)
    ]
    assert shares[0] > 0.94
    assert min(shares) > 0.8


def test_more_rays_pass_than_with_the_exit_pupil_where_rims_clip():
    lens = load_lens("double_gauss")
    exit_only = dataclasses.replace(lens, pupil_sampling="exit")
    corner = lens.prescription.image_radius
    assert unvignetted_fraction(exit_only, corner) < 0.35
    assert unvignetted_fraction(lens, corner) > 2.4 * unvignetted_fraction(exit_only, corner)


@pytest.mark.parametrize(("x", "y"), [(30.0, 0.0), (-21.0, 21.0), (0.0, -30.0)])
def test_both_ways_of_sampling_measure_the_same_light(x, y):
    """Both ways give the same irradiance where the exit pupil contains all rays that pass."""
    lens = load_lens("double_gauss")
    exit_only = dataclasses.replace(lens, pupil_sampling="exit")
    light = [one.sample_rays(np.tile([x, y], (len(UV), 1)), UV).weight.mean() for one in (lens, exit_only)]
    assert light[0] == pytest.approx(light[1], rel=0.01)


def test_the_exit_pupil_of_gaussian_optics_misses_light_of_a_fast_lens():
    """The effective pupil is the default: 7 % of the light on the axis of the Double Gauss at f/2."""
    lens = load_lens("double_gauss")
    exit_only = dataclasses.replace(lens, pupil_sampling="exit")
    light = [one.sample_rays(np.zeros((len(UV), 2)), UV).weight.mean() for one in (lens, exit_only)]
    assert 1.05 < light[0] / light[1] < 1.09


@pytest.mark.parametrize("wavelength", [440.0, 650.0])
def test_other_wavelengths_fit_into_the_ellipses(wavelength):
    """Of rays aimed just outside, at most one in fifty would have passed."""
    lens = load_lens("double_gauss")
    angle = np.linspace(0, 2 * np.pi, 720)
    rim = 1.005 * np.stack([np.cos(angle), np.sin(angle)], -1)
    for field in (0.0, 20.0, 40.0):
        rays = lens.sample_rays(np.tile([field, 0.0], (720, 1)), rim, wavelength)
        assert (rays.weight > 0).mean() <= 0.02


def test_a_dark_corner_has_weight_zero_and_stays_finite():
    lens = load_lens("double_gauss")
    rays = lens.sample_rays(np.tile([90.0, 0.0], (16, 1)), UV[:16])
    assert np.isfinite(rays.slope).all()
    assert np.isfinite(rays.weight).all()
