"""Rings and stars against Fourier transforms of the defocused pupil, Airy's pattern and closed forms."""

import numpy as np
import pytest

from bokehnet.optics.aperture import Aperture, transmission
from bokehnet.optics.spectral.diffraction import disc_kernel, ring_kernel, star_kernel
from bokehnet.optics.spectral.wavelength_sampling import WavelengthSampling

WAVELENGTHS, WEIGHTS = WavelengthSampling().sample(16)


def correlation(a, b):
    return np.corrcoef(a.ravel(), b.ravel())[0, 1]


def from_pupil(aperture, radius, unit, count, width=6.0, size=1024):
    """Oracle: the far field of the opening with a quadratic phase, one colour after the other, in pixels."""
    axis = (np.arange(size) - size / 2) * (width / size)
    amplitude = np.sqrt(transmission(aperture, axis[None], axis[:, None], 1 if radius > 0 else -1))
    square = axis[:, None] ** 2 + axis**2
    light = np.zeros((count * count, 3))
    for wavelength, weight in zip(WAVELENGTHS, WEIGHTS, strict=True):
        fresnel = abs(radius) / (2 * unit * wavelength / 1000)
        assert fresnel * width / size < 0.5  # the phase is sampled
        field = np.fft.fft2(amplitude * np.exp(1j * np.pi * fresnel * square))
        place = np.rint(np.fft.fftfreq(size, width / size) / fresnel * radius).astype(int) + count // 2
        y, x = np.meshgrid(place, place, indexing="ij")
        inside = (x >= 0) & (x < count) & (y >= 0) & (y < count)
        power = np.bincount((y * count + x)[inside], (np.abs(field) ** 2)[inside], count * count)
        light += power[:, None] / power.sum() * weight
    return light.reshape(count, count, 3) / light.sum(0)


@pytest.mark.parametrize(
    ("aperture", "radius"),
    [
        (Aperture(blades=5, rotation=12), 24.0),
        (Aperture(obstruction=0.4, spherical_profile=0.5), -24.0),
        pytest.param(Aperture(), 24.0, marks=pytest.mark.slow),
        pytest.param(Aperture(), -24.0, marks=pytest.mark.slow),
        pytest.param(Aperture(blades=5, rotation=12), -24.0, marks=pytest.mark.slow),
        pytest.param(Aperture(obstruction=0.4, spherical_profile=0.5), 24.0, marks=pytest.mark.slow),
    ],
)
def test_rings_are_those_of_the_defocused_pupil(aperture, radius):
    """Normalised correlation 0.98, and of the rings alone, without the disc of rays, too."""
    result, disc = ring_kernel(aperture, radius, 0.4), disc_kernel(aperture, radius)
    expected = from_pupil(aperture, radius, 0.4, len(result))
    assert result.sum((0, 1)) == pytest.approx(1)
    assert disc.sum() == pytest.approx(1)
    for channel in range(3):
        assert correlation(result[..., channel], expected[..., channel]) > 0.98
        rings = (kernel[..., channel] - disc for kernel in (result, expected))
        assert correlation(*rings) > 0.98


def test_without_waves_there_are_no_rings():
    """A very small f-number: the disc of rays."""
    disc = disc_kernel(Aperture(), 20.0)
    rings = ring_kernel(Aperture(), 20.0, 0.002)
    assert np.abs(rings - disc[..., None]).max() < 0.15 * disc.max()
    assert correlation(rings[..., 1], disc) > 0.995


def test_a_round_opening_has_the_pattern_of_airy():
    """Authority: (2 J1(v) / v)^2, the Bessel function by its integral."""
    unit = 20.0
    star = star_kernel(Aperture(), unit, 60)
    half = len(star) // 2
    axis = np.arange(-half, half + 1)
    radius = np.hypot(axis[:, None], axis)
    angle = (np.arange(400) + 0.5) * np.pi / 400
    expected = np.zeros((*radius.shape, 3))
    for wavelength, weight in zip(WAVELENGTHS, WEIGHTS, strict=True):
        v = np.linspace(1e-6, np.pi * radius.max() / (unit * wavelength / 1000), 2000)
        bessel = np.cos(angle[:, None] - v * np.sin(angle[:, None])).mean(0)
        airy = np.interp(radius, v * unit * wavelength / 1000 / np.pi, (2 * bessel / v) ** 2)
        expected += (airy / airy.sum())[..., None] * weight
    for channel in range(3):
        assert correlation(star[..., channel], expected[..., channel]) > 0.999
    assert star.sum((0, 1)) == pytest.approx(1)


def polygon_power(corners, frequency):
    """|Fourier transform|^2 of a polygon at (..., 2) cycles per unit.

    Authority: Gauss's theorem, a sum over edges (Lee and Mittra, IEEE Trans. Antennas Propag. 31, 1983).
    """
    k = 2 * np.pi * frequency
    square = (k * k).sum(-1)
    total = np.zeros(frequency.shape[:-1], complex)
    for a, b in zip(corners, np.roll(corners, -1, 0), strict=True):
        edge, middle = b - a, (a + b) / 2
        normal = np.array([edge[1], -edge[0]])
        total += (k @ normal) * np.sinc((k @ edge) / (2 * np.pi)) * np.exp(-1j * (k @ middle))
    return np.abs(total) ** 2 / np.maximum(square, 1e-12) ** 2


@pytest.mark.parametrize("blades", [5, 6])
def test_stars_are_those_of_the_polygon(blades):
    """Two spikes a blade, or one of each parallel pair; core and, by fourth roots, spikes."""
    unit, cells = 4.0, 5
    star = star_kernel(Aperture(blades=blades), unit, 40)
    half = len(star) // 2
    angle = np.pi + (np.arange(blades) + 0.5) * 2 * np.pi / blades
    corners = np.stack([np.cos(angle), np.sin(angle)], -1) / 2  # in diameters, an edge on the left
    fine = (np.arange((2 * half + 1) * cells) + 0.5) / cells - half - 0.5 + 1e-7
    places = np.stack(np.meshgrid(fine, fine), -1)
    expected = np.zeros_like(star)
    for wavelength, weight in zip(WAVELENGTHS, WEIGHTS, strict=True):
        power = polygon_power(corners, places / (unit * wavelength / 1000))
        power = power.reshape(2 * half + 1, cells, 2 * half + 1, cells).mean((1, 3))
        expected += (power / power.sum())[..., None] * weight
    for channel in range(3):
        assert correlation(star[..., channel], expected[..., channel]) > 0.999
        assert correlation(star[..., channel] ** 0.25, expected[..., channel] ** 0.25) > 0.98
