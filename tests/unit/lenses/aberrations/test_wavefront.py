"""Wave-fronts against ray-optics, optiland, the slopes of rays, and formulas of diffraction."""

import dataclasses

import numpy as np
import pytest

from bokehnet.lenses import load_lens
from bokehnet.lenses.aberrations.wavefront import trace_wavefront, wave_mtf, wave_psf, zernike_fit
from bokehnet.lenses.reports.analysis import airy_mtf, field_rays


def test_paths_are_those_of_ray_optics():
    """ray-optics 0.9.8, ``wave_abr_full_calc`` at 10 degrees, whose middle ray arrives at 8.82116412 mm."""
    lens = load_lens("cooke_triplet", focusing="paraxial")
    front = trace_wavefront(lens, 8.82116412 / lens.prescription.image_radius, count=51)
    reference = {
        (0.5, 0.0): -0.009313799756,
        (-0.5, 0.0): 0.063512709911,
        (0.0, 0.5): 0.438462308342,
        (0.8, 0.0): -0.012845061942,
        (0.3, 0.6): 0.681022020866,
    }
    for place, waves in reference.items():
        i, j = (round((part + 1.25) / 0.05) for part in place)
        np.testing.assert_allclose(front.pupil[i, j], place, atol=1e-12)
        assert front.waves[i, j] == pytest.approx(waves, abs=3e-5)


def test_polynomials_are_those_of_optiland():
    """optiland 0.6, ``ZernikeOPD`` on the axis, Noll, 64 rings; it weighs rays otherwise."""
    lens = load_lens("cooke_triplet", focusing="paraxial")
    result = zernike_fit(trace_wavefront(lens, 0.0))
    expected = np.zeros(22)
    expected[[0, 3, 10, 21]] = 0.44512, 0.373784, 0.084024, -0.005724
    np.testing.assert_allclose(result, expected, atol=1e-4)


@pytest.mark.parametrize(("name", "share"), [("petzval", 0.0), ("telephoto", 0.5), ("retrofocus", 0.4)])
def test_rays_are_normal_to_the_wave_front(name, share):
    """Welford 1986, 7.3: rays miss by the slope of the wave-front over cosines, from the middle ray."""
    lens = load_lens(name, f_number=8.0, focus_distance=5000.0)
    front = trace_wavefront(lens, share)
    lengths = 1e-6 * front.wavelength * front.waves
    step = front.pupil[1, 0, 0] - front.pupil[0, 0, 0]
    slopes = np.stack(np.gradient(front.cosines, step, axis=(0, 1)), -1)
    gradient = np.stack(np.gradient(lengths, step, axis=(0, 1)), -1)
    miss = np.linalg.solve(slopes.swapaxes(-1, -2), gradient[..., None])[..., 0]
    inside = (front.pupil**2).sum(-1) < 0.8
    expected = field_rays(lens, share, front.pupil[inside]).place
    np.testing.assert_allclose(miss[inside], expected, atol=0.02 * np.abs(expected).max())


def test_contrast_of_a_perfect_wave_is_that_of_airy():
    """Goodman 2005, 6.4, at the f-number of the cone of real rays."""
    lens = load_lens("cooke_triplet", focusing="paraxial")
    front = trace_wavefront(lens, 0.0)
    perfect = dataclasses.replace(front, waves=0 * front.waves)
    frequencies = np.array([0.0, 10.0, 20.0, 40.0, 150.0, 400.0])
    for curve in wave_mtf(perfect, frequencies):
        np.testing.assert_allclose(curve, airy_mtf(lens, frequencies, front.wavelength), atol=2e-3)


@pytest.mark.parametrize(("name", "share", "defocus"), [("cooke_triplet", 0.0, 0.0), ("petzval", 0.7, 0.05)])
def test_the_spectrum_of_the_point_spread_is_the_contrast(name, share, defocus):
    """Hopkins 1955: the autocorrelation of the pupil function is the transform of its intensity."""
    lens = load_lens(name, f_number=5.6)
    front = trace_wavefront(lens, share, count=257)
    cosine = np.sqrt(1 - (front.cosines**2).sum(-1))
    moved = dataclasses.replace(front, waves=front.waves - defocus * cosine / (1e-6 * front.wavelength))
    offsets = np.arange(-200, 200) * 1e-3
    psf = wave_psf(front, offsets, defocus, count=640)
    frequencies = np.array([10.0, 20.0, 40.0])
    for axis, curve in enumerate(wave_mtf(moved, frequencies)):
        lines = psf.sum(1 - axis)
        contrast = [abs((lines * np.exp(2j * np.pi * f * offsets)).sum()) for f in frequencies]
        np.testing.assert_allclose(contrast, curve, atol=0.015)


def test_the_point_spread_of_a_perfect_wave_is_that_of_airy():
    """Airy 1835: the first dark ring is at 0.61 wavelengths over the sine of the cone."""
    front = trace_wavefront(load_lens("cooke_triplet", f_number=8.0, focusing="paraxial"), 0.0)
    perfect = dataclasses.replace(front, waves=0 * front.waves)
    offsets = np.arange(-40, 41) * 2.5e-4
    profile = wave_psf(perfect, offsets)[40, 40:]
    sine = np.ptp(front.cosines[front.passes][:, 0]) / 2
    assert offsets[40 + int(np.argmin(profile[:32]))] == pytest.approx(
        0.61 * 1e-6 * front.wavelength / sine, abs=2.5e-4
    )
    assert profile[:32].min() < 2e-3 * profile[0]


def test_a_gaussian_pupil_has_a_gaussian_point_spread():
    """The transform of exp(-a rho^2) is a Gaussian: sigma = wavelength sqrt(a) / (2 pi sine of the cone)."""
    front = trace_wavefront(load_lens("cooke_triplet", f_number=8.0, focusing="paraxial"), 0.0)
    perfect = dataclasses.replace(front, waves=0 * front.waves)
    offsets, factor = np.arange(-60, 61) * 4e-4, 6.0
    profile = wave_psf(perfect, offsets, apodisation=factor).sum(1)
    passing = front.passes
    sine = np.ptp(front.cosines[passing][:, 0]) / np.ptp(front.pupil[passing][:, 0])
    sigma = 1e-6 * front.wavelength * np.sqrt(factor) / (2 * np.pi * sine)
    assert np.sqrt((profile * offsets**2).sum()) == pytest.approx(sigma, rel=0.01)


def test_contrast_of_the_triplet_is_that_of_optiland():
    """optiland 0.6, ``FFTMTF`` with 256 rays on a grid of 2048, over the whole disc of the Gaussian pupil.

    Our stop cuts at 0.993 of that disc: here the rest passes, too. A disc of 256 rays is known in width
    to one in 255, and so are its frequencies: by that much the curves may be apart.
    """
    lens = load_lens("cooke_triplet", focusing="paraxial")
    front = trace_wavefront(lens, 0.0, count=257)
    whole = dataclasses.replace(front, passes=(front.pupil**2).sum(-1) <= 1)
    assert np.isfinite(front.waves[whole.passes]).all()
    frequencies = np.array([10.0, 20.0, 40.0])
    result = wave_mtf(whole, frequencies)[0]
    apart = np.abs(wave_mtf(whole, frequencies * 256 / 255)[0] - result).max()
    assert apart < 0.003
    np.testing.assert_allclose(result, [0.81027, 0.51370, 0.19889], atol=apart)


def test_what_rims_cut_is_not_in_the_wave():
    """Traced: at the corner of the double Gauss light passes a lens-shaped part of the pupil."""
    front = trace_wavefront(load_lens("double_gauss"), 1.0)
    along, across = (np.ptp(front.pupil[front.passes][:, axis]) for axis in (0, 1))
    assert along < 0.6 * across
    assert front.rms < np.std(front.waves[front.passes])
