"""Chromatic aberration by two sliders: axial and lateral fringes, with the curve of a glass and maps.

A lens is stronger for blue light than for red. It then focuses blue nearer (axial), and shows it at
another size (lateral). In the terms of :mod:`bokehnet.optics.aberrations.aberration_map` both add to the
miss, ``E += a s_0 m_0 + h s_1 m_1``: a change of the blur radius and a change of scale, which depend on the
wavelength by the strengths s and on the field by the maps m.

On the axis the lateral part is 0 for every map. The axial part is as in a lens: in the plane of focus the
design wavelength is sharp and the others are discs around the same point, of the radius that the slider
says. It moves no colour to any side, and areas of one colour keep it.

Source: Jeong, Lee, Kwon and Lee, "Expressive chromatic accumulation buffering for defocus blur", The
Visual Computer 2016, for the model; measured as change of blur, not of focal length, it is ours.
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

# Strength of a lens by the wavelength in nm: 0 at the design wavelength, and its spread over the visible
# spectrum is 1.
Curve = Callable[[Array], Array]

# Percent of the half-diagonal.
_LARGEST = 100.0

# Bound of maps, so that no composition sends rays to infinity.
_STRONGEST_MAP = 10.0

# Nearer to the axis than this, in half-diagonals, the lateral fringe goes linearly to 0, whatever its map.
_AXIS = 0.05


def _scaled(power: Curve, middle: float, spread: float, wavelength: Array) -> Array:
    return (power(wavelength) - middle) / spread


def _spread_to_one(power: Callable[[Array], Array]) -> Curve:
    """Return the curve of a refractive power that is known but for its unit and zero."""
    values = power(np.linspace(MIN_WAVELENGTH, MAX_WAVELENGTH, 601))
    return partial(_scaled, power, float(power(DESIGN_WAVELENGTH)), float(np.ptp(values)))


def _falling(wavelength: Array) -> Array:
    return -wavelength


linear_curve: Curve = _spread_to_one(_falling)


def glass_curve(name: str) -> Curve:
    """A single lens of the glass ``name``: the power is in proportion to n - 1.

    Raises:
        LensError: No glass has that name.
    """
    return _spread_to_one(make_glass(name).index)


def achromat_curve(crown: str = "N-BK7", flint: str = "F2") -> Curve:
    """Two lenses that together have one power for the blue F and the red C line.

    What remains is the secondary spectrum: green is refracted most, both ends least.

    Raises:
        LensError: No glass has one of the names.

    Source:
        Born and Wolf, "Principles of optics", 1959, section 4.7.2, for the powers of the two lenses.
    """
    return _spread_to_one(partial(_power_of_two, make_glass(crown), make_glass(flint)))


_DEFAULT_CURVE = glass_curve("N-BK7")


def _power_of_two(crown: Glass, flint: Glass, wavelength: Array) -> Array:
    first, second = (
        (glass.index(wavelength) - 1) / (glass.index(F_LINE) - glass.index(C_LINE))
        for glass in (crown, flint)
    )
    return first - second


def make_curve(name: str) -> Curve:
    """Return the curve called ``linear``, ``achromat``, or by the name of a glass.

    Raises:
        LensError: Nothing has that name.
    """
    if name == "linear":
        return linear_curve
    return achromat_curve() if name == "achromat" else glass_curve(name)


@dataclass(frozen=True, kw_only=True, eq=False, slots=True)
class ChromaticAberration:
    """Axial and lateral chromatic aberration; the default is none.

    Strengths are percent of the picture's half-diagonal, between the wavelengths that the curve sets
    furthest apart: 400 and 700 nm for a single glass. Below 0 colours change places.

    Attributes:
        axial: Change of the blur radius. Above 0 as in a simple lens: blue focuses nearer, so that blurs
            have red rims in front of focus and blue rims behind it.
        lateral: Shift in the corner. Above 0 blue lies outwards of red.
        axial_map: Factor of the axial strength over the field; a lens has the same everywhere.
        lateral_map: Factor of the lateral shift over the field; a lens has t, a change of scale.
        curve: How the strength of the lens goes with the wavelength. Default: that of N-BK7.

    Raises:
        ParameterError: A strength is not finite or beyond 100 percent, or a map or the curve is no function.
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
            check_range(name, value, -_LARGEST, _LARGEST, "percent of the half-diagonal")
        for name in ("axial_map", "lateral_map", "curve"):
            if not callable(getattr(self, name)):
                raise ParameterError(name, "a function", getattr(self, name))

    @property
    def is_none(self) -> bool:
        """Whether wavelengths stay together."""
        return self.axial == 0 and self.lateral == 0

    def strengths(self, wavelengths: Array) -> Array:
        """Axial and lateral strength (..., 2), half-diagonals, of wavelengths (...,), nm."""
        curve = self.curve(wavelengths)
        return array_namespace(curve).stack([-self.axial / 100 * curve, self.lateral / 100 * curve], -1)

    def maps(self, field: Array) -> Array:
        """Factors (..., 2) of both at field positions (..., 2), of which the corner has length 1.

        The second stands before the field position itself and is 1 everywhere for the map t. Nearer to
        the axis than 0.05 it stays as it is there. No map passes 10, up or down.
        """
        xp = array_namespace(field)
        squared = (field * field).sum(-1)
        theta = xp.arctan2(-field[..., 1], field[..., 0])
        t, safe = squared**0.5, xp.clip(squared, _AXIS**2, None) ** 0.5
        bound = _STRONGEST_MAP
        return xp.stack(
            [
                xp.clip(self.axial_map(t, theta), -bound, bound),
                xp.clip(self.lateral_map(safe, theta), -bound, bound) / safe,
            ],
            -1,
        )
