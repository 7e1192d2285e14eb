"""Diffraction kernels: rings inside blur discs, and stars around lamps in focus.

Behind an aperture with the transmission T the light of a point is the squared modulus of the Fresnel integral
of sqrt(T). With lengths in radii of the aperture, and of the blur disc on the sensor, it depends on one
number alone, the Fresnel number ``F = r / (2 s)`` of the disc radius r and ``s = wavelength * f-number``,
both in pixels: large F is the geometric disc with rings at its rim, F = 0 the far field, the power of the
Fourier transform of the aperture, ``s`` pixels for each cycle across its diameter.

Source:
    Goodman, "Introduction to Fourier optics", 3rd ed. 2005: 4.2 (convolution and its transfer function), 4.3.
"""

import math
from functools import lru_cache

import numpy as np

from bokehnet.optics.aperture import Aperture, transmission
from bokehnet.optics.spectral.wavelength_sampling import WavelengthSampling

__all__ = ["disc_kernel", "ring_kernel", "star_kernel"]

_WAVELENGTHS = 16
# Width of the window around a disc, in radii, and its additional margin on each side, pixels.
_WINDOW, _MARGIN = 3.0, 8
# Sub-pixels along each side of a pixel, and samples along each side of a sub-pixel of rasterized apertures.
_SUBPIXELS, _SAMPLES = 3, 2
# Samples along each side of the far field, and its largest step, pixels.
_FAR_FIELD_SIZE, _MAX_STEP = 4096, 0.5


def _rasterize_aperture(
    aperture: Aperture, step: float, count: int, side: int, samples: int = _SAMPLES
) -> np.ndarray:
    """Return the transmission in cells (count, count) of width ``step``, aperture radii, about the centre."""
    fine = count * samples
    axis = (np.arange(fine) - (fine - 1) / 2) * (step / samples)
    light = np.zeros((fine, fine))
    inside = np.flatnonzero(np.abs(axis) <= 1)
    if inside.size:
        cut = slice(inside[0], inside[-1] + 1)
        light[cut, cut] = transmission(aperture, axis[None, cut], axis[cut, None], side)
    return _block_means(light, samples)


def _block_means(light: np.ndarray, subpixels: int) -> np.ndarray:
    """Return the means over square blocks of ``subpixels`` along each side."""
    count = len(light) // subpixels
    means: np.ndarray = light.reshape(count, subpixels, count, subpixels).mean((1, 3))
    return means


def _width(radius: float) -> int:
    return 2 * math.ceil(_WINDOW / 2 * abs(radius) + _MARGIN) + 1


def _spreads(unit: float) -> tuple[np.ndarray, np.ndarray]:
    """Return wavelength times f-number in pixels, (N,), and the red, green and blue weights, (N, 3)."""
    wavelengths, weights = WavelengthSampling().sample(_WAVELENGTHS)
    return unit * wavelengths / 1000, weights


@lru_cache(maxsize=64)
def disc_kernel(aperture: Aperture, radius: float) -> np.ndarray:
    """Return the geometric disc of a point, (n, n) with n odd, sum 1.

    Args:
        aperture: Aperture at the centre of the picture.
        radius: Signed blur radius, pixels, positive in front of focus, not 0.
    """
    count = _width(radius) * _SUBPIXELS
    light = _block_means(
        _rasterize_aperture(aperture, 1 / (_SUBPIXELS * radius), count, 1 if radius > 0 else -1), _SUBPIXELS
    )
    disc: np.ndarray = light / light.sum()
    return disc


@lru_cache(maxsize=64)
def ring_kernel(aperture: Aperture, radius: float, unit: float) -> np.ndarray:
    """Return the disc with diffraction rings, (n, n, 3) with n odd, the sum of each colour 1.

    Args:
        aperture: Aperture at the centre of the picture.
        radius: Signed blur radius, pixels, positive in front of focus, not 0.
        unit: F-number over the pixel pitch in micrometres; up to 2, where pixels are still wider than
            half of a wavelength times the f-number.
    """
    spread, weights = _spreads(unit)
    # Coarser sampling would alias: the phase of the transfer function would step by more than half a cycle.
    subpixels = _SUBPIXELS if _SUBPIXELS * spread.max() <= _WINDOW / 2 else 1
    count = _width(radius) * subpixels
    side = 1 if radius > 0 else -1
    amplitude = np.sqrt(_rasterize_aperture(aperture, 1 / (subpixels * radius), count, side))
    spectrum = np.fft.fft2(amplitude)
    frequency = np.fft.fftfreq(count) * (subpixels * abs(radius))  # cycles per radius
    square = frequency[:, None] ** 2 + frequency**2
    light = np.zeros((*_block_means(amplitude, subpixels).shape, 3))
    for scale, weight in zip(spread, weights, strict=True):
        fresnel = abs(radius) / (2 * scale)
        wave = np.fft.ifft2(spectrum * np.exp((-1j * math.pi / fresnel) * square))
        light += _block_means(wave.real**2 + wave.imag**2, subpixels)[..., None] * weight
    rings: np.ndarray = light / light.sum((0, 1))
    return rings


@lru_cache(maxsize=4)
def star_kernel(aperture: Aperture, unit: float, largest: int) -> np.ndarray:
    """Return the diffraction star of a point in focus, (n, n, 3) with n odd, the sum of each colour 1.

    Args:
        aperture: Aperture at the centre of the picture.
        unit: F-number over the pixel pitch in micrometres.
        largest: Upper bound of the half-width, pixels; the extent of the sampled far field also limits it.
    """
    spread, weights = _spreads(unit)
    padding = max(2.0, spread.max() / _MAX_STEP)
    across = int(_FAR_FIELD_SIZE / padding) // 2 * 2
    amplitude = np.sqrt(_rasterize_aperture(aperture, 2 / across, across, 0, 1))
    power = np.abs(np.fft.rfft2(amplitude, (_FAR_FIELD_SIZE, _FAR_FIELD_SIZE)))
    power = np.fft.fftshift(power * power, axes=0)
    half = max(1, min(largest, int(across / 2 * spread.min() - 2)))
    sums = np.zeros((power.shape[0] + 1, power.shape[1] + 1))
    np.cumsum(power, 0, out=power)
    np.cumsum(power, 1, out=sums[1:, 1:])
    edges = np.arange(-half, half + 2) - 0.5
    light = np.zeros((2 * half + 1, 2 * half + 1, 3))
    for scale, weight in zip(spread, weights, strict=True):
        samples = edges * (_FAR_FIELD_SIZE / across / scale) + 0.5  # from the lower end of the middle sample
        down = _between(sums, samples + _FAR_FIELD_SIZE // 2)
        # Columns from the middle of the first column on; the others are their mirror image.
        right = _between(down.T, np.maximum(samples[half:], 0.5)).T
        right = np.diff(np.diff(right, axis=0), axis=1)
        right[:, 0] *= 2
        plane = np.concatenate([right[::-1, :0:-1], right], 1)
        light += (plane / plane.sum())[..., None] * weight
    star: np.ndarray = light / light.sum((0, 1))
    return star


def _between(sums: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Return the rows of ``sums`` at fractional ``places``, linearly interpolated."""
    low = places.astype(np.intp)
    fraction = (places - low)[:, None]
    rows: np.ndarray = sums[low] * (1 - fraction) + sums[low + 1] * fraction
    return rows
