"""ChromaticAberration in pictures of the rays, against what the strengths of the wavelengths say of an edge.

The authority is the integral over the spectrum, by the response of each channel: of the mean shift for
lateral, of the variance of discs (r^2 / 4 across) for axial fringes.
"""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.classical.rays_renderer import rays
from bokehnet.optics.aberrations.chromatic_aberration import ChromaticAberration
from bokehnet.optics.aberrations.field_maps import inversion
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.spectral.spectrum import MAX_WAVELENGTH, MIN_WAVELENGTH
from bokehnet.optics.spectral.wavelength_sampling import WavelengthSampling

HEIGHT, WIDTH = 96, 240
HALF_DIAGONAL = 0.5 * np.hypot(HEIGHT, WIDTH)
BRIGHT, DARK = 0.8, 0.1
ROWS = slice(40, 56)
SPECTRUM = MIN_WAVELENGTH + (MAX_WAVELENGTH - MIN_WAVELENGTH) * (np.arange(600) + 0.5) / 600
LIGHT = {
    "continuous": WavelengthSampling(),
    "rgb": WavelengthSampling(dispersion="rgb"),
    "equaliser": WavelengthSampling(equaliser=(4, 0.2, 0.2, 4, 0.2, 0.2, 4)),
}


def edge(column):
    """Bright left of a column, dark from it on."""
    image = np.full((HEIGHT, WIDTH, 3), BRIGHT, np.float32)
    image[:, column:] = DARK
    return image


def render(column, defocus, chromatic_aberration, light=None, seed=0):
    lens_response = LensResponse(
        chromatic_aberration=chromatic_aberration, wavelength_sampling=light or WavelengthSampling()
    )
    level = np.full((HEIGHT, WIDTH), defocus, np.float32)
    return rays(edge(column), level, lens_response=lens_response, seed=seed)


def moments(picture):
    """Place of the edge in each channel and the variance of its slope, pixels."""
    profile = picture[ROWS].mean(0)
    weight = -np.diff(profile, axis=0) / (BRIGHT - DARK)
    place = np.arange(1, WIDTH)[:, None]
    mean = (weight * place).sum(0)
    return mean, (weight * (place - mean) ** 2).sum(0)


def spectral_mean(values, light):
    """Mean over the light of each channel of values (N,) over ``SPECTRUM``."""
    return (light.response(SPECTRUM) * values[:, None]).mean(0)


@pytest.mark.parametrize("name", LIGHT)
def test_lateral_fringes_shift_each_channel_by_its_wavelength(name):
    """An edge in focus, off the axis: its place moves by h s1, in the mean over the channel's wavelengths."""
    chromatic_aberration, light = ChromaticAberration(lateral=30), LIGHT[name]
    column = 180
    result, _ = moments(render(column, 0.0, chromatic_aberration, light))
    shift = (
        HALF_DIAGONAL * chromatic_aberration.strengths(SPECTRUM)[:, 1] * (column - WIDTH / 2) / HALF_DIAGONAL
    )
    # The field position is that of the receiving pixel, beyond the edge by the shift.
    shift = shift / (1 - chromatic_aberration.strengths(SPECTRUM)[:, 1])
    expected = column + spectral_mean(shift, light)
    assert np.ptp(expected) > 5
    # Three wavelengths meet whole pixels of a sharp picture, and the curve of a mean is not the mean's.
    assert_allclose(result, expected, atol=0.35 if name != "rgb" else 0.9)


@pytest.mark.parametrize("defocus", [9.0, -9.0])
@pytest.mark.parametrize("name", ["continuous", "equaliser"])
def test_axial_fringes_blur_each_channel_by_its_wavelength(defocus, name):
    """Discs of the radius d + s0: red ones are the larger in front of focus, blue ones behind it."""
    chromatic_aberration, light = ChromaticAberration(axial=3), LIGHT[name]
    place, result = moments(render(WIDTH // 2, defocus, chromatic_aberration, light))
    radius = defocus + HALF_DIAGONAL * chromatic_aberration.strengths(SPECTRUM)[:, 0]
    expected = spectral_mean(radius**2 / 4, light)
    assert_allclose(result, expected, rtol=0.08)
    assert (result[0] > result[2]) == (defocus > 0)
    assert_allclose(place, WIDTH / 2, atol=0.1)


def test_there_are_no_lateral_fringes_on_the_axis():
    """An edge through the middle, in and out of focus: all channels are alike but for the noise."""
    for defocus in (0.0, -6.0):
        place, _ = moments(render(WIDTH // 2, defocus, ChromaticAberration(lateral=10)))
        assert_allclose(place, WIDTH / 2, atol=0.1)


def test_in_focus_axial_fringes_shift_no_color():
    """All that is left there is a blur around the same point; an even picture keeps its colour."""
    picture = render(180, 0.0, ChromaticAberration(axial=6))
    place, result = moments(picture)
    assert_allclose(place, 180, atol=0.1)
    radius = HALF_DIAGONAL * ChromaticAberration(axial=6).strengths(SPECTRUM)[:, 0]
    expected = spectral_mean(radius**2 / 4, WavelengthSampling())
    averaged = 2 / 3  # what the mean of 3x3 pixels adds where surfaces are blurred
    assert (result > expected - 0.1).all()
    assert (result < expected + averaged + 0.25).all()
    assert_allclose(picture[ROWS, 60:120], BRIGHT, rtol=1e-5)


def test_the_thesis_decay_leaves_no_axial_fringe_in_the_corner():
    """Authority: equation 4.7 with A = t, the difference of focus by 1 - t: at t = 0.95 a twentieth."""
    plain, decayed = (
        moments(render(column, 9.0, ChromaticAberration(axial=3, axial_map=inversion)))[1]
        for column in (120, 214)
    )
    assert np.ptp(decayed) < 0.35 * np.ptp(plain)


def test_strength_0_is_the_identity():
    level = np.full((HEIGHT, WIDTH), 5, np.float32)
    expected = rays(edge(150), level)
    assert_array_equal(
        rays(edge(150), level, lens_response=LensResponse(chromatic_aberration=ChromaticAberration())),
        expected,
    )
