"""Aberration map: deviation of the rays of a lens from those of a perfect lens.

A lens sends the ray of the pixel p and of the aperture coordinate a along a straight line of the scene. Seen
from the centre of the entrance pupil, the points of the picture that it crosses are linear in the defocus
s: ``p - s A - E``. For a perfect lens A is a and the transverse aberration E is 0; for any other lens
both depend on a, on the field position h and on the wavelength. E is the aberration in the plane of focus,
and A contains the aberrations of the pupils. The effects of an aperture or a tilted sensor are part of the
same two quantities, so that one map serves prescriptions, third-order theory, sliders and tilted planes of
focus.

A lens that is symmetric about its axis, and in every plane through it, can only give
``a f + h g`` with f and g functions of a.a, a.h and h.h. Here they are polynomials of the third degree in
these three, which describe aberrations up to the seventh order: 20 coefficients each.

Source: Hullin, Hanika and Heidrich, "Polynomial optics", Computer Graphics Forum 2012, for lenses as
polynomials; Gotanda, Kawase and Kakimoto, "Real-time rendering of physically based optical effects in
theory and practice", SIGGRAPH courses 2015, for the name. Invariants and the linear form are our own.
"""

from dataclasses import dataclass, replace

import numpy as np

from bokehnet.checks import (
    Array,
    array_namespace,
    array_of_numbers,
    check_finite,
    check_kind,
    check_numbers,
    check_rank,
)
from bokehnet.errors import ParameterError, ShapeError
from bokehnet.optics.spectral.glass import D_LINE

__all__ = ["DESIGN_WAVELENGTH", "TERMS", "UNTILTED_AXES", "AberrationMap", "rim_passes", "term"]

# Exponents of (a.a, a.h, h.h), up to the third degree.
TERMS = tuple((i, j, k) for i in range(4) for j in range(4 - i) for k in range(4 - i - j))

# Wavelength of maps without dispersion, nm: the yellow line of helium.
DESIGN_WAVELENGTH = D_LINE

# Axes of an aperture parallel to the sensor.
UNTILTED_AXES = ((1.0, 0.0), (0.0, 1.0), (0.0, 0.0))


def term(i: int, j: int, k: int) -> int:
    """Return the index in ``TERMS`` of the monomial ``(a.a)^i (a.h)^j (h.h)^k``."""
    return TERMS.index((i, j, k))


@dataclass(frozen=True, kw_only=True, eq=False, slots=True)
class AberrationMap:
    """Aberrations and vignetting of a lens; the default is a perfect lens.

    Aperture coordinates a are those of :mod:`bokehnet.optics.aperture`: (u right, v down) in the unit disc.
    Light of a point with defocus d arrives at ``q + d a`` behind a perfect lens, at ``q + d A + E``
    behind this one. Field positions h are measured from the centre of the picture, right and down, with
    the corner of the full-size picture at |h| = 1.

    Attributes:
        wavelengths: Wavelengths of the coefficients, nm, ascending, (L,).
        transverse_aberration: Coefficients of f and g of the transverse aberration E, in half-diagonals of
            the picture, (L, 2, 20). The ray of a = 0 at the design wavelength deviates by the distortion,
            which maps exclude by default.
        pupil_aberration: Coefficients of f and g of A - a, dimensionless, (L, 2, 20).
        vignetting_apertures: Rims that clip the pupil, as pairs (shift, radius): a passes if ``|a - shift
            h| <= radius``; a radius below 0 is that of a central obstruction, as of a mirror lens: a
            passes if ``|a - shift h| >= -radius``.
        tilt: Tilt of the plane of focus: decrease of the defocus of a fixed point, pixels, per pixel to the
            right and down, as the focus gets nearer. A is further divided by
            ``1 + tilt.a`` (:func:`bokehnet.optics.focus_plane.plane_aberration_map`).
        aperture_axes: Axes of a tilted aperture: the components of its coordinates to the
            right, down, and along the normal of the picture, three pairs. The first two form a vector of A,
            from which the third times h is subtracted; its unit is the pupil radius over the distance at
            which h is 1 (:func:`bokehnet.optics.focus_plane.tilted_aberration_map`).

    Raises:
        ShapeError: The shapes of the arrays are inconsistent.
        ParameterError: A number is not finite, wavelengths are not ascending, or a rim has radius 0.
    """

    wavelengths: np.ndarray
    transverse_aberration: np.ndarray
    pupil_aberration: np.ndarray
    vignetting_apertures: tuple[tuple[float, float], ...] = ()
    tilt: tuple[float, float] = (0.0, 0.0)
    aperture_axes: tuple[tuple[float, float], ...] = UNTILTED_AXES

    def __post_init__(self) -> None:
        for name in ("wavelengths", "transverse_aberration", "pupil_aberration"):
            array = np.ascontiguousarray(array_of_numbers(name, getattr(self, name), np.float64))
            check_finite(name, array)
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        check_rank("wavelengths", self.wavelengths, 1, "(L,)")
        expected = (len(self.wavelengths), 2, len(TERMS))
        for name in ("transverse_aberration", "pupil_aberration"):
            if getattr(self, name).shape != expected:
                raise ShapeError(
                    f"aberration map: {name}: expected {expected}, got {getattr(self, name).shape}"
                )
        check_kind("vignetting_apertures", self.vignetting_apertures, tuple, list)
        for aperture in self.vignetting_apertures:
            check_numbers("vignetting_apertures", aperture, 2)
        check_numbers("tilt", self.tilt, 2)
        check_kind("aperture_axes", self.aperture_axes, tuple, list)
        if len(self.aperture_axes) != len(UNTILTED_AXES):
            raise ParameterError("aperture_axes", "three pairs", self.aperture_axes)
        for axis in self.aperture_axes:
            check_numbers("aperture_axes", axis, 2)
        if (np.diff(self.wavelengths) <= 0).any():
            raise ParameterError("wavelengths", "rising wavelengths", self.wavelengths.tolist())
        if any(radius == 0 for _, radius in self.vignetting_apertures):
            raise ParameterError(
                "vignetting_apertures", "circles with a radius other than 0", self.vignetting_apertures
            )

    @classmethod
    def perfect(cls) -> "AberrationMap":
        """Return the map of a perfect lens."""
        zeros = np.zeros((1, 2, len(TERMS)))
        return cls(
            wavelengths=np.array([DESIGN_WAVELENGTH]), transverse_aberration=zeros, pupil_aberration=zeros
        )

    @property
    def is_perfect(self) -> bool:
        """True if the map has no aberrations, vignetting or tilt."""
        return not (
            self.transverse_aberration.any()
            or self.pupil_aberration.any()
            or self.vignetting_apertures
            or any(self.tilt)
            or tuple(map(tuple, self.aperture_axes)) != UNTILTED_AXES
        )

    @property
    def is_dispersive(self) -> bool:
        """True if the aberrations depend on the wavelength."""
        return bool(
            (np.ptp(self.transverse_aberration, axis=0) > 0).any()
            or (np.ptp(self.pupil_aberration, axis=0) > 0).any()
        )

    def without_tilt(self) -> "AberrationMap":
        """Return the map without the tilt of focus plane and aperture."""
        return replace(self, tilt=(0.0, 0.0), aperture_axes=UNTILTED_AXES)

    def on_axis(self) -> "AberrationMap":
        """Return the map with the rays of the axis at every field position; the tilt stays.

        Only f's powers of a.a are left: spherical aberration and axial colour, as in a radial profile. Rims
        are centred, so that a central obstruction stays and no cat's-eye is left.

        Source:
            Jeong, "Efficient and expressive rendering for real-time defocus blur and bokeh", dissertation,
            5.2: the profile texture of a lens, one row for each defocus and wavelength.
        """
        is_radial = np.array([[j == k == 0 for _, j, k in TERMS], [False] * len(TERMS)])
        return replace(
            self,
            transverse_aberration=np.where(is_radial, self.transverse_aberration, 0.0),
            pupil_aberration=np.where(is_radial, self.pupil_aberration, 0.0),
            vignetting_apertures=tuple((0.0, radius) for _, radius in self.vignetting_apertures),
        )

    def at(self, wavelength: float | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return interpolated coefficients of both aberrations, (..., 2, 20), at wavelengths in nm, (...).

        Outside the range of wavelengths the coefficients are constant.
        """
        wavelength = np.asarray(wavelength, float)
        upper = np.clip(np.searchsorted(self.wavelengths, wavelength), 1, max(len(self.wavelengths) - 1, 1))
        lower = upper - 1
        upper = np.minimum(upper, len(self.wavelengths) - 1)
        width = np.maximum(self.wavelengths[upper] - self.wavelengths[lower], 1e-9)
        along = np.clip((wavelength - self.wavelengths[lower]) / width, 0, 1)[..., None, None]
        return (
            self.transverse_aberration[lower] * (1 - along) + self.transverse_aberration[upper] * along,
            self.pupil_aberration[lower] * (1 - along) + self.pupil_aberration[upper] * along,
        )

    def __add__(self, other: "AberrationMap") -> "AberrationMap":
        """Return the combination: aberrations add up, all vignetting apertures clip, tilts are composed."""
        own, others = np.array(self.aperture_axes, float), np.array(other.aperture_axes, float)
        across, along = own[:2] @ others[:2], own[2] + others[2]
        wavelengths = np.union1d(self.wavelengths, other.wavelengths)
        parts = [lens.at(wavelengths) for lens in (self, other)]
        return AberrationMap(
            wavelengths=wavelengths,
            transverse_aberration=parts[0][0] + parts[1][0],
            pupil_aberration=parts[0][1] + parts[1][1],
            vignetting_apertures=self.vignetting_apertures + other.vignetting_apertures,
            tilt=(self.tilt[0] + other.tilt[0], self.tilt[1] + other.tilt[1]),
            aperture_axes=tuple((float(row[0]), float(row[1])) for row in (*across, along)),
        )

    def __call__(
        self, pupil: Array, field: Array, wavelength: float = DESIGN_WAVELENGTH
    ) -> tuple[Array, Array, Array]:
        """Return the deviations of rays.

        Args:
            pupil: Aperture coordinates a, (..., 2), array or tensor.
            field: Field positions h of the pixels at which the rays arrive, (..., 2).
            wavelength: Wavelength, nm.

        Returns:
            Transverse aberration E in half-diagonals (..., 2), coordinates A (..., 2), and True for rays that
            pass the vignetting apertures (...,).
        """
        transverse_aberration, pupil_aberration = self.at(wavelength)
        xp = array_namespace(pupil)
        squares = (pupil * pupil).sum(-1), (pupil * field).sum(-1), (field * field).sum(-1)

        def combine(coefficients: np.ndarray) -> Array:
            f, g = (_polynomial(row, *squares)[..., None] for row in coefficients)
            return pupil * f + field * g

        tilt = 1 + self.tilt[0] * pupil[..., 0] + self.tilt[1] * pupil[..., 1]
        passes = squares[0] == squares[0]
        for shift, radius in self.vignetting_apertures:
            passes = passes & rim_passes(pupil, field, shift, radius)
        if xp is np:
            tilt = np.asarray(tilt)
        coordinates = pupil + combine(pupil_aberration)
        if tuple(map(tuple, self.aperture_axes)) != UNTILTED_AXES:
            right, down, along = (
                x * coordinates[..., 0] + y * coordinates[..., 1] for x, y in self.aperture_axes
            )
            coordinates = xp.stack([right, down], -1) - along[..., None] * field
        return combine(transverse_aberration), coordinates / tilt[..., None], passes


def rim_passes(pupil: Array, field: Array, shift: float, radius: float) -> Array:
    """Return True for aperture coordinates (..., 2) that pass a rim, at field positions (..., 2)."""
    square = ((pupil - shift * field) ** 2).sum(-1)
    return square <= radius * radius if radius > 0 else square >= radius * radius


def _polynomial(coefficients: np.ndarray, x: Array, y: Array, z: Array) -> Array:
    """Return the sum of ``coefficients`` (20,) times the monomials of ``TERMS``."""
    total = 0 * (x + y + z)
    for coefficient, (i, j, k) in zip(coefficients, TERMS, strict=True):
        if coefficient != 0:
            total = total + float(coefficient) * x**i * y**j * z**k
    return total
