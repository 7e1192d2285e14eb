"""The visible spectrum and its colours."""

import math

import numpy as np

from bokehnet.checks import Array, array_namespace

__all__ = ["MAX_WAVELENGTH", "MIN_WAVELENGTH", "wavelength_color"]

# Visible range, nm; outside it the eye has less than a thousandth of its peak sensitivity.
MIN_WAVELENGTH, MAX_WAVELENGTH = 400.0, 700.0

# Lobes of x, y, z: height, peak in nm, width below and above the peak in nm.
_LOBES = (
    ((1.056, 599.8, 37.9, 31.0), (0.362, 442.0, 16.0, 26.7), (-0.065, 501.1, 20.4, 26.2)),
    ((0.821, 568.8, 46.9, 40.5), (0.286, 530.9, 16.3, 31.1)),
    ((1.217, 437.0, 11.8, 36.0), (0.681, 459.0, 26.0, 13.8)),
)
# IEC 61966-2-1: CIE XYZ to linear RGB with Rec.709 primaries.
_RGB_FROM_XYZ = ((3.2406, -1.5372, -0.4986), (-0.9689, 1.8758, 0.0415), (0.0557, -0.2040, 1.0570))


def _rgb(wavelength: Array) -> Array:
    xp = array_namespace(wavelength)
    xyz = []
    for lobes in _LOBES:
        value = 0 * wavelength
        for height, peak, below, above in lobes:
            width = xp.where(wavelength < peak, below, above)
            value = value + height * xp.exp(-0.5 * ((wavelength - peak) / width) ** 2)
        xyz.append(value)
    rows = [sum(factor * value for factor, value in zip(row, xyz, strict=True)) for row in _RGB_FROM_XYZ]
    return xp.stack(rows, -1)


def _white() -> tuple[float, float, float]:
    """Return the mean of :func:`_rgb` over the spectrum."""
    wavelengths = MIN_WAVELENGTH + (MAX_WAVELENGTH - MIN_WAVELENGTH) * (np.arange(3000) + 0.5) / 3000
    red, green, blue = (math.fsum(values) / 3000 for values in _rgb(wavelengths).T)
    return red, green, blue


_WHITE = _white()


def wavelength_color(wavelength: Array) -> Array:
    """Return the linear RGB (..., 3), Rec.709, of a wavelength; the mean over the spectrum is (1, 1, 1).

    Pure colours lie outside the gamut of the primaries, so some values are negative; sums over a broad
    spectrum are not. Weighting a mean over wavelengths from ``MIN_WAVELENGTH`` to ``MAX_WAVELENGTH`` by this
    colour leaves a picture uncoloured where the lens has no dispersion.

    Args:
        wavelength: Wavelength, nm, any shape, array or tensor.

    Source:
        Wyman, Sloan and Shirley, "Simple analytic approximations to the CIE XYZ color matching functions",
        Journal of Computer Graphics Techniques 2013, the fit by several lobes.
    """
    xp = array_namespace(wavelength)
    rgb = _rgb(wavelength)
    return xp.stack([rgb[..., channel] / _WHITE[channel] for channel in range(3)], -1)
