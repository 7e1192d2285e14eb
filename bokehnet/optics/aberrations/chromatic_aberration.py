"""Chromatic aberration by two sliders, axial and lateral, with the dispersion of a glass and field maps.

A lens is stronger for blue light than for red. It therefore focuses blue nearer (axial), and magnifies it
differently (lateral). In the terms of :mod:`bokehnet.optics.aberrations.aberration_map` both add to the
transverse aberration, ``E += a s_0 m_0 + h s_1 m_1``: a change of the blur radius and a change of scale, with
strengths s that depend on the wavelength and maps m that depend on the field position.

On the axis the lateral part is 0 for every map. The axial part is that of a lens: in the plane of focus the
design wavelength is sharp and the others are discs around the same point, of the radius that the slider
sets. It shifts no colour sideways and preserves areas of one colour.

Source: Jeong, Lee, Kwon and Lee, "Expressive chromatic accumulation buffering for defocus blur", The
Visual Computer 2016, for the model; its measure, change of blur instead of focal length, is our own.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from bokehnet.checks import Array, array_namespace, check_number, check_range
from bokehnet.errors import ParameterError
from bokehnet.optics.aberrations.aberration_map import DESIGN_WAVELENGTH
from bokehnet.optics.aberrations.field_maps import FieldMap, constant, linear
from bokehnet.optics.spectral.glass import C_LINE, F_LINE, Glass, make_glass
from bokehnet.optics.spectral.spectrum import MAX_WAVELENGTH, MIN_WAVELENGTH

__all__ = ["ChromaticAberration", "Curve", "achromat_curve", "glass_curve", "linear_curve", "make_curve"]

# Relative power of a lens as a function of the wavelength in nm: 0 at the design wavelength, with a range
# of 1 over the visible spectrum.
Curve = Callable[[Array], Array]

# Upper bound of both sliders, percent of the half-diagonal.
_MAX_STRENGTH = 100.0

# Upper bound of the size of maps, so that no composition sends rays to infinity.
_MAX_MAP = 10.0

# Distance from the axis, half-diagonals, below which the lateral fringe falls linearly to 0 for every map.
_AXIS_RADIUS = 0.05


def _normalized_power(power: Curve, middle: float, value_range: float, wavelength: Array) -> Array:
    return (power(wavelength) - middle) / value_range


def _normalized_curve(power: Callable[[Array], Array]) -> Curve:
    """Return the curve of a refractive power that is known up to scale and offset."""
    values = power(np.linspace(MIN_WAVELENGTH, MAX_WAVELENGTH, 601))
    return partial(_normalized_power, power, float(power(DESIGN_WAVELENGTH)), float(np.ptp(values)))


def _negative(wavelength: Array) -> Array:
    return -wavelength


linear_curve: Curve = _normalized_curve(_negative)


def glass_curve(name: str) -> Curve:
    """Return the curve of a single lens of the glass ``name``, with power proportional to n - 1.

    Raises:
        LensError: Unknown glass.
    """
    return _normalized_curve(make_glass(name).index)


def achromat_curve(crown: str = "N-BK7", flint: str = "F2") -> Curve:
    """Return the curve of two lenses that together have equal power for the blue F and the red C line.

    The remainder is the secondary spectrum: green is refracted most, both ends least.

    Raises:
        LensError: Unknown glass.

    Source:
        Born and Wolf, "Principles of optics", 1959, section 4.7.2, for the powers of the two lenses.
    """
    return _normalized_curve(partial(_doublet_power, make_glass(crown), make_glass(flint)))


_DEFAULT_CURVE = glass_curve("N-BK7")


def _doublet_power(crown: Glass, flint: Glass, wavelength: Array) -> Array:
    first, second = (
        (glass.index(wavelength) - 1) / (glass.index(F_LINE) - glass.index(C_LINE))
        for glass in (crown, flint)
    )
    return first - second


def make_curve(name: str) -> Curve:
    """Return the curve called ``linear``, ``achromat``, or by the name of a glass.

    Raises:
        LensError: Unknown name.
    """
    if name == "linear":
        return linear_curve
    return achromat_curve() if name == "achromat" else glass_curve(name)


@dataclass(frozen=True, kw_only=True, eq=False, slots=True)
class ChromaticAberration:
    """Axial and lateral chromatic aberration; the default is none.

    Strengths are percent of the half-diagonal of the picture, between the two wavelengths at which the curve
    differs most: 400 and 700 nm for a single glass. Negative values exchange the colours.

    Attributes:
        axial: Change of the blur radius. Above 0 as in a simple lens: blue focuses nearer, so that blurs
            have red rims in front of focus and blue rims behind it.
        lateral: Shift in the corner. Above 0 blue lies outside of red.
        axial_map: Factor of the axial strength over the field; constant for a real lens.
        lateral_map: Factor of the lateral shift over the field; t, a change of scale, for a real lens.
        curve: Power of the lens as a function of the wavelength. Default: that of N-BK7.

    Raises:
        ParameterError: A strength is not finite or beyond 100 percent, or a map or the curve is not callable.
    """

    axial: float = 0.0
    lateral: float = 0.0
    axial_map: FieldMap = constant
    lateral_map: FieldMap = linear
    curve: Curve = _DEFAULT_CURVE

    def __post_init__(self) -> None:
        for name in ("axial", "lateral"):
            value = getattr(self, name)
            check_number(name, value)
            check_range(name, value, -_MAX_STRENGTH, _MAX_STRENGTH, "percent of the half-diagonal")
        for name in ("axial_map", "lateral_map", "curve"):
            if not callable(getattr(self, name)):
                raise ParameterError(name, "a function", getattr(self, name))

    @property
    def is_none(self) -> bool:
        """True if all wavelengths coincide."""
        return self.axial == 0 and self.lateral == 0

    def strengths(self, wavelengths: Array) -> Array:
        """Return axial and lateral strength (..., 2), half-diagonals, of wavelengths (...,), nm."""
        curve = self.curve(wavelengths)
        return array_namespace(curve).stack([-self.axial / 100 * curve, self.lateral / 100 * curve], -1)

    def maps(self, field: Array) -> Array:
        """Return both factors (..., 2) at field positions (..., 2), of which the corner has length 1.

        The second multiplies the field position itself and is 1 everywhere for the map t. It is constant
        within 0.05 of the axis. Clips the maps to -10 to 10.
        """
        xp = array_namespace(field)
        squared = (field * field).sum(-1)
        theta = xp.arctan2(-field[..., 1], field[..., 0])
        t, safe = squared**0.5, xp.clip(squared, _AXIS_RADIUS**2, None) ** 0.5
        bound = _MAX_MAP
        return xp.stack(
            [
                xp.clip(self.axial_map(t, theta), -bound, bound),
                xp.clip(self.lateral_map(safe, theta), -bound, bound) / safe,
            ],
            -1,
        )
