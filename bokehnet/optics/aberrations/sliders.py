"""Artistic aberrations set by sliders instead of by a lens."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from bokehnet.checks import check_number, check_range
from bokehnet.errors import ParameterError
from bokehnet.optics.aberrations.aberration_map import DESIGN_WAVELENGTH, AberrationMap, term
from bokehnet.optics.aberrations.seidel import SeidelCoefficients

__all__ = ["AberrationSliders"]

# Upper bound of the sliders, percent of the half-diagonal; beyond it light would cross the whole picture.
_MAX_STRENGTH = 100.0
_SLIDERS = ("spherical", "coma", "astigmatism", "field_curvature")


@dataclass(frozen=True, kw_only=True, slots=True)
class AberrationSliders:
    """Four of Seidel's five aberrations, in percent of the half-diagonal of the picture; 0 is none.

    The contribution to rays does not depend on depth. In the plane of focus it is the only
    blur; elsewhere it adds to the discs, so that the opposite sign looks behind focus as this sign does
    in front.

    Attributes:
        spherical: Blur radius of the rays through the rim of the pupil. Above 0 the lens is
            overcorrected: discs behind focus have a bright rim, like soap bubbles, and are smaller; discs in
            front fade out. Below 0 (undercorrected) the reverse.
        coma: Length of the comatic tail in the corners, proportional to the distance from the centre. Above 0
            tails point outwards, below 0 inwards; the head does not move.
        astigmatism: Blur radius in focus in the corners, growing with the square of the
            distance. Above 0 discs behind focus are elongated around the centre of the picture, a swirl, and
            discs in front are elongated radially; below 0 the reverse.
        field_curvature: Defocus in the corners of points in the plane of focus, growing as astigmatism does.
            Above 0 the surface of focus is farther away in the corners than at the centre, below 0 nearer, as
            for simple lenses.
        focusing: "sharpest" focuses at the minimum root mean square blur of ``spherical``: two thirds
            of the way from the focus of rays near the axis, "paraxial", to that of rays through the rim. The
            paraxial focus has a sharp core in a wide veil.

    Raises:
        ParameterError: A number is not finite or beyond 100 percent, or the focusing has another name.

    Source:
        Born and Wolf, "Principles of optics", 1999, 5.3. Medial focus: astigmatism elongates discs equally in
        both directions, and field curvature is the remainder.
    """

    spherical: float = 0.0
    coma: float = 0.0
    astigmatism: float = 0.0
    field_curvature: float = 0.0
    focusing: Literal["sharpest", "paraxial"] = "sharpest"

    def __post_init__(self) -> None:
        for name in _SLIDERS:
            value = getattr(self, name)
            check_number(name, value)
            check_range(name, value, -_MAX_STRENGTH, _MAX_STRENGTH, "percent of the half-diagonal")
        if self.focusing not in ("sharpest", "paraxial"):
            raise ParameterError("focusing", "sharpest or paraxial", self.focusing)

    @property
    def coefficients(self) -> SeidelCoefficients:
        """Seidel coefficients of these sliders, half-diagonals."""
        return SeidelCoefficients(
            spherical=self.spherical / 100,
            coma=self.coma / 300,
            astigmatism=self.astigmatism / 100,
            field_curvature=(self.field_curvature - self.astigmatism) / 100,
        )

    def aberration_map(self) -> AberrationMap:
        """Return the aberration map; it is perfect if all sliders are 0."""
        transverse_aberration = self.coefficients.transverse_aberration()[None]
        if self.focusing == "sharpest":
            transverse_aberration[:, 0, term(0, 0, 0)] -= 2 / 3 * self.coefficients.spherical
        return AberrationMap(
            wavelengths=np.array([DESIGN_WAVELENGTH]),
            transverse_aberration=transverse_aberration,
            pupil_aberration=np.zeros_like(transverse_aberration),
        )
