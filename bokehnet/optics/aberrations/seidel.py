"""Third-order aberrations: Seidel sums of surfaces, and the resulting aberration map.

The sum over the surfaces is one function of the aperture coordinate a and the field position h, the wavefront

``W = S1/8 (a.a)^2 + S2/2 (a.a)(a.h) + S3/2 (a.h)^2 + (S3 + S4)/4 (a.a)(h.h) + S5/2 (a.h)(h.h)``

in mm, and transverse aberrations are proportional to its gradient with respect to a. Two paraxial rays
determine the five sums: the marginal ray, from the centre of the picture to the rim of the pupil (a = 1), and
the chief ray, from the corner (h = 1) to the centre of the pupil. With the two rays exchanged the same sums
are those of the image of the pupil.

Source: Welford, "Aberrations of optical systems", 1986, ch. 8; names B, C, D, E, F after Born and Wolf,
"Principles of optics", 1999, ch. 5. Rays are (y, n u) as in :mod:`bokehnet.optics.paraxial`.
"""

from dataclasses import dataclass

import numpy as np

from bokehnet.checks import Array
from bokehnet.optics.aberrations.aberration_map import TERMS, term

__all__ = ["SeidelCoefficients", "SeidelSums", "surface_sums", "uniform_irradiance"]


@dataclass(frozen=True, slots=True)
class SeidelSums:
    """Seidel sums S1 to S5, mm, numbers or one per wavelength; the sums of surfaces add up."""

    spherical: Array = 0.0
    coma: Array = 0.0
    astigmatism: Array = 0.0
    petzval: Array = 0.0
    distortion: Array = 0.0

    def __add__(self, other: "SeidelSums") -> "SeidelSums":
        """Return the sums of both surfaces or systems in sequence."""
        return SeidelSums(
            self.spherical + other.spherical,
            self.coma + other.coma,
            self.astigmatism + other.astigmatism,
            self.petzval + other.petzval,
            self.distortion + other.distortion,
        )


def surface_sums(
    marginal: tuple[Array, Array],
    chief: tuple[Array, Array],
    curvature: Array,
    fourth_order: Array,
    before: Array,
    behind: Array,
) -> SeidelSums:
    """Return the Seidel sums of one surface.

    Args:
        marginal: Height y, mm, and n u of the marginal ray in front of the surface.
        chief: Height y, mm, and n u of the chief ray in front of the surface.
        curvature: 1 / radius, 1/mm, positive if the centre lies behind.
        fourth_order: Eight times the fourth-order coefficient of the sag, less that of the sphere,
            1/mm^3; ``k / radius^3`` for a conic.
        before: Refractive index in front.
        behind: Refractive index behind.

    Source:
        Welford, "Aberrations of optical systems", 1986, 8.2 and 8.4. The fifth sum is written without
        division by the angle of the marginal ray, which is 0 for a ray that meets a surface at right angles.
    """
    (y, nu), (y_chief, nu_chief) = marginal, chief
    power = (behind - before) * curvature
    angle, angle_chief = nu + before * curvature * y, nu_chief + before * curvature * y_chief  # n i
    pupil_aberration = (nu - power * y) / behind**2 - nu / before**2  # change of u / n
    lagrange = nu_chief * y - nu * y_chief
    flattening = 1 / behind - 1 / before
    aspheric = fourth_order * (behind - before)
    return SeidelSums(
        spherical=-angle * angle * y * pupil_aberration + aspheric * y**4,
        coma=-angle * angle_chief * y * pupil_aberration + aspheric * y**3 * y_chief,
        astigmatism=-angle_chief * angle_chief * y * pupil_aberration + aspheric * y**2 * y_chief**2,
        petzval=-(lagrange**2) * curvature * flattening,
        distortion=angle_chief
        * (
            angle_chief**2 * y * (1 / before**2 - 1 / behind**2)
            + y_chief * (lagrange + angle_chief * y) * curvature * flattening
        )
        + aspheric * y * y_chief**3,
    )


@dataclass(frozen=True, slots=True)
class SeidelCoefficients:
    """Seidel coefficients of the transverse aberration, each in half-diagonals of the picture.

    ``E = B (a.a) a + F (2 (a.h) a + (a.a) h) + 2 C (a.h) h + D (h.h) a + E (h.h) h``

    Numbers, or one per wavelength. At the rim of the pupil and in the corner of the picture, B is the radius
    of the blur by spherical aberration, 3 F the length of the tail by coma, D and 2 C + D the half-axes
    across and along the radius by astigmatism and field curvature, E the shift by distortion.

    Attributes:
        spherical: B.
        coma: F.
        astigmatism: C.
        field_curvature: D.
        distortion: E.
    """

    spherical: Array = 0.0
    coma: Array = 0.0
    astigmatism: Array = 0.0
    field_curvature: Array = 0.0
    distortion: Array = 0.0

    @classmethod
    def from_sums(cls, sums: SeidelSums, lagrange: Array) -> "SeidelCoefficients":
        """Return the coefficients at the sensor.

        Args:
            sums: Seidel sums of all surfaces, mm.
            lagrange: Lagrange invariant of the two rays, ``n (u_chief y - u y_chief)``, mm. At the sensor,
                where y is 0 and y_chief the half-diagonal, it is ``-n' u'`` times the half-diagonal.
        """
        half = -0.5 / lagrange
        return cls(
            spherical=half * sums.spherical,
            coma=half * sums.coma,
            astigmatism=half * sums.astigmatism,
            field_curvature=half * (sums.astigmatism + sums.petzval),
            distortion=half * sums.distortion,
        )

    def transverse_aberration(self) -> np.ndarray:
        """Return the coefficients of E of the aberration map, (..., 2, 20)."""
        return _table(
            along_pupil=(self.spherical, 2 * self.coma, self.field_curvature),
            along_field=(self.coma, 2 * self.astigmatism, self.distortion),
        )

    def pupil_aberration(self) -> np.ndarray:
        """Return the coefficients of A - a of the aberration map, (..., 2, 20), for those of the pupil.

        In the image of the pupil a and h exchange their roles.
        """
        return _table(
            along_pupil=(self.distortion, 2 * self.astigmatism, self.coma),
            along_field=(self.field_curvature, 2 * self.coma, self.spherical),
        )


def uniform_irradiance(rise: Array, tilt: Array) -> np.ndarray:
    """Return the displacement of points in the stop that gives equal areas equal light; the rim is fixed.

    Args:
        rise: Coefficient of a.a in the light ``1 + rise a.a + tilt a.h`` of points, numbers or (L,), small.
        tilt: Coefficient of a.h, of the same shape.

    Returns:
        Displacement, as coefficients of a polynomial of the aberration map, (..., 2, 20). Its
        divergence is the light less its mean, and on the unit circle it is tangential.
    """
    table = _table(along_pupil=(rise / 4, tilt / 4, 0.0), along_field=(tilt / 8, 0.0, 0.0))
    table[..., 0, term(0, 0, 0)] = -rise / 4
    table[..., 1, term(0, 0, 0)] = -3 * tilt / 8
    return table


def _table(along_pupil: tuple[Array, ...], along_field: tuple[Array, ...]) -> np.ndarray:
    """Return a table (..., 2, 20) with the given coefficients of a.a, a.h and h.h."""
    rows = np.broadcast_arrays(*map(np.asarray, (*along_pupil, *along_field)))
    table = np.zeros((*rows[0].shape, 2, len(TERMS)))
    squares = (term(1, 0, 0), term(0, 1, 0), term(0, 0, 1))
    for number, row in enumerate(rows):
        table[..., number // 3, squares[number % 3]] = row
    return table
