"""Aberrations set by hand, as strong as one likes, instead of by a lens."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from bokehnet.checks import check_number, check_range
from bokehnet.errors import ParameterError
from bokehnet.optics.aberrations.aberration_map import DESIGN_WAVELENGTH, AberrationMap, term
from bokehnet.optics.aberrations.seidel import SeidelCoefficients

__all__ = ["AberrationSliders"]

# Percent; beyond it light would cross the whole picture.
_LARGEST = 100.0
_SLIDERS = ("spherical", "coma", "astigmatism", "field_curvature")


@dataclass(frozen=True, kw_only=True, slots=True)
class AberrationSliders:
    """Four of Seidel's five aberrations, in percent of the picture's half-diagonal; 0 is none.

    What they add to rays does not depend on how far things are. In the plane of focus that is all the blur
    there is; elsewhere it adds to the discs, so that behind focus the opposite sign looks as this one does
    in front.

    Attributes:
        spherical: Radius of the blur that rays through the rim of the pupil make. Above 0 the lens is
            overcorrected: discs behind focus have a bright rim, as soap bubbles, and are smaller; those in
            front fade out. Below 0, undercorrected, it is the reverse.
        coma: Length in the corners of a comet's tail, in proportion to the distance from the middle. Above 0
            tails point outwards, below 0 inwards; the head stays where it was.
        astigmatism: Radius in the corners of the blur that is left in focus, growing with the square of the
            distance. Above 0 discs behind focus are drawn out around the middle of the picture, a swirl, and
            those in front away from it; below 0 the reverse.
        field_curvature: Defocus in the corners of things in the plane of focus, growing as astigmatism does.
            Above 0 what is sharp lies farther away in the corners than in the middle, below 0 nearer, as
            behind simple lenses.
        focusing: "sharpest" focuses where ``spherical`` leaves the least blur, root mean square: two thirds
            of the way from the focus of rays near the axis, "paraxial", to that of rays through the rim. The
            paraxial focus has a sharp core in a wide veil.

    Raises:
        ParameterError: A number is not finite or beyond 100 percent, or the focusing has another name.

    Source:
        Born and Wolf, "Principles of optics", 1999, 5.3. Medial focus: astigmatism draws out along and around
        by the same amount, and field curvature does what is left.
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
            check_range(name, value, -_LARGEST, _LARGEST, "percent of the half-diagonal")
        if self.focusing not in ("sharpest", "paraxial"):
            raise ParameterError("focusing", "sharpest or paraxial", self.focusing)

    @property
    def coefficients(self) -> SeidelCoefficients:
        """Seidel's coefficients of these, half-diagonals."""
        return SeidelCoefficients(
            spherical=self.spherical / 100,
            coma=self.coma / 300,
            astigmatism=self.astigmatism / 100,
            field_curvature=(self.field_curvature - self.astigmatism) / 100,
        )

    def aberration_map(self) -> AberrationMap:
        """Return the aberration map; all 0 gives the perfect one."""
        transverse_aberration = self.coefficients.transverse_aberration()[None]
        if self.focusing == "sharpest":
            transverse_aberration[:, 0, term(0, 0, 0)] -= 2 / 3 * self.coefficients.spherical
        return AberrationMap(
            wavelengths=np.array([DESIGN_WAVELENGTH]),
            transverse_aberration=transverse_aberration,
            pupil_aberration=np.zeros_like(transverse_aberration),
        )
