"""The aberration map: how far the rays through a lens pass beside the places where a perfect lens sends them.

A lens sends the ray of the pixel p and of the aperture coordinate a along a straight line of the scene. Seen
from the middle of the entrance pupil, the places of the picture that it runs over are linear in the defocus
s: ``p - s A - E``. Behind a perfect lens A is a and the transverse aberration E is 0; behind any other one
both depend on a, on the field position h and on the wavelength. E is the aberration in the plane of focus,
and A holds what the aberrations of the pupils add. What an aperture or a tilted sensor does is in the same
two numbers, so that one map serves prescriptions, third-order theory, sliders and leaning planes of focus.

A lens that is symmetric about its axis, and in every plane through it, can only give
``a f + h g`` with f and g functions of a.a, a.h and h.h. Here they are polynomials of the third degree in
these three, which hold aberrations up to the seventh order: 20 numbers each.

Source: Hullin, Hanika and Heidrich, "Polynomial optics", Computer Graphics Forum 2012, for lenses as
polynomials; Gotanda, Kawase and Kakimoto, "Real-time rendering of physically based optical effects in
theory and practice", SIGGRAPH courses 2015, for the name. Invariants and the linear form are ours.
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

# Nanometres, of maps without dispersion: the yellow line of helium.
DESIGN_WAVELENGTH = D_LINE

# Axes of an aperture that does not lean.
UNTILTED_AXES = ((1.0, 0.0), (0.0, 1.0), (0.0, 0.0))


def term(i: int, j: int, k: int) -> int:
    """Place in ``TERMS`` of the monomial ``(a.a)^i (a.h)^j (h.h)^k``."""
    return TERMS.index((i, j, k))


@dataclass(frozen=True, kw_only=True, eq=False, slots=True)
class AberrationMap:
    """What a lens does to its rays, beyond focusing; the default is a perfect lens.

    Aperture coordinates a are those of :mod:`bokehnet.optics.aperture`: (u right, v down) in the unit disc,
    light of a point with defocus d arrives at ``q + d a`` behind a perfect lens, at ``q + d A + E``
    behind this one. Field positions h are measured from the middle of the picture, right and down, with
    the corner of the full-size picture at |h| = 1.

    Attributes:
        wavelengths: Nanometres, rising, (L,).
        transverse_aberration: Coefficients of f and g of the transverse aberration E, in half-diagonals of
            the picture, (L, 2, 20). The ray of a = 0 at the design wavelength misses by distortion; maps
            leave it out unless told otherwise.
        pupil_aberration: The same of A - a, without unit, (L, 2, 20).
        vignetting_apertures: Rims that cut the pupil, as pairs (shift, radius): a passes where ``|a - shift
            h| <= radius``; a radius below 0 is that of what is dark inside, as behind a mirror lens: a
            passes where ``|a - shift h| >= -radius``.
        tilt: How the plane of focus leans: pixels of defocus by which the focus gets nearer per pixel to the
            right and down, so that the defocus of a thing at rest falls. A is further divided by
            ``1 + tilt.a`` (:func:`bokehnet.optics.focus_plane.plane_aberration_map`).
        aperture_axes: How an aperture stands that leans against the picture: what its coordinates go to the
            right, down, and along the picture's normal, three pairs. The first two make a vector of A, from
            which the third is taken h times; its unit is the pupil radius over the distance at which h is 1
            (:func:`bokehnet.optics.focus_plane.tilted_aberration_map`).

    Raises:
        ShapeError: Arrays do not fit together.
        ParameterError: A number is not finite, wavelengths do not rise, or a rim has no size.
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
        nothing = np.zeros((1, 2, len(TERMS)))
        return cls(
            wavelengths=np.array([DESIGN_WAVELENGTH]), transverse_aberration=nothing, pupil_aberration=nothing
        )

    @property
    def is_perfect(self) -> bool:
        """Whether rays go where those of a perfect lens do."""
        return not (
            self.transverse_aberration.any()
            or self.pupil_aberration.any()
            or self.vignetting_apertures
            or any(self.tilt)
            or tuple(map(tuple, self.aperture_axes)) != UNTILTED_AXES
        )

    @property
    def is_dispersive(self) -> bool:
        """Whether wavelengths go different ways."""
        return bool(
            (np.ptp(self.transverse_aberration, axis=0) > 0).any()
            or (np.ptp(self.pupil_aberration, axis=0) > 0).any()
        )

    def without_tilt(self) -> "AberrationMap":
        """Return the same without the tilt of focus plane and aperture."""
        return replace(self, tilt=(0.0, 0.0), aperture_axes=UNTILTED_AXES)

    def at(self, wavelength: float | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Coefficients of both aberrations, (..., 2, 20), for wavelengths in nm, (...); linear in between.

        Beyond the first and the last wavelength they stay as they are there.
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
        """Both together: aberrations add up, all vignetting apertures cut, one leans on the other."""
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
        """What rays do.

        Args:
            pupil: Aperture coordinates a, (..., 2), array or tensor.
            field: Field positions h of the pixels where they arrive, (..., 2).
            wavelength: Nanometres.

        Returns:
            Transverse aberration E in half-diagonals (..., 2), coordinates A (..., 2), and where vignetting
            apertures let rays pass (...,).
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
        run = pupil + combine(pupil_aberration)
        if tuple(map(tuple, self.aperture_axes)) != UNTILTED_AXES:
            right, down, along = (x * run[..., 0] + y * run[..., 1] for x, y in self.aperture_axes)
            run = xp.stack([right, down], -1) - along[..., None] * field
        return combine(transverse_aberration), run / tilt[..., None], passes


def rim_passes(pupil: Array, field: Array, shift: float, radius: float) -> Array:
    """Which aperture coordinates (..., 2) a vignetting aperture lets pass, for field positions (..., 2)."""
    square = ((pupil - shift * field) ** 2).sum(-1)
    return square <= radius * radius if radius > 0 else square >= radius * radius


def _polynomial(coefficients: np.ndarray, x: Array, y: Array, z: Array) -> Array:
    """Sum of ``coefficients`` (20,) times the monomials of ``TERMS``."""
    total = 0 * (x + y + z)
    for coefficient, (i, j, k) in zip(coefficients, TERMS, strict=True):
        if coefficient != 0:
            total = total + float(coefficient) * x**i * y**j * z**k
    return total
