"""Shape and transmission of the aperture.

Aperture coordinates (u right, v down, as in the picture) lie in the unit disc. A point of the scene with
signed blur radius d (pixels, + in front of focus) lights the pixels ``q + d * (u, v)`` around its own
pixel q. The ray through the pupil point A, in pupil radii as seen from behind the camera, crosses the plane
of focus at a distance A (1 - zf / z) from the line of sight to the point, so its light falls at ``q - d A``
and the aperture coordinate is a = -A. Discs show the aperture upright behind focus and turned by 180 degrees
in front of it.

The transmission is the product of all parts. The central hole and the rim belong to the round pupil; blades
and picture turn with ``rotation``; ``squeeze`` then narrows the result. Only the cat's-eye depends on the
position in the picture, so :func:`cats_eye_shift` computes it separately.
"""

import math
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
from numba.extending import register_jitable

from bokehnet.checks import (
    Array,
    array_of_numbers,
    check_number,
    check_range,
    check_rank,
    check_whole,
    number_of,
)
from bokehnet.errors import ParameterError
from bokehnet.optics.disc_texture import disc_grain, onion_rings
from bokehnet.optics.pixels.resampling import bilinear
from bokehnet.optics.sampling import disc_from_square

__all__ = ["Aperture", "blade_margin", "cats_eye_shift", "pupil_points", "transmission"]

# Name -> (minimum, maximum); a cat's-eye of 1.5 leaves a seventh of the light in the corner of the picture.
_RANGES = {
    "curvature": (0.0, 1.0),
    "squeeze": (0.1, 10.0),
    "cats_eye": (0.0, 1.5),
    "spherical_profile": (-1.0, 1.0),
    "obstruction": (0.0, 0.95),
    "onion": (0.0, 1.0),
    "onion_rings": (1.0, 40.0),
    "grain": (0.0, 1.0),
}

_MIN_BLADES, _MAX_BLADES = 3, 16

# Cells along each side of the sampling density of pupil points, and sub-cells along each side of a cell.
_CELLS, _SUBCELLS = 256, 4


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Aperture:
    """Aperture of a lens; the default is an evenly lit disc. Hashable, compared by value.

    Attributes:
        blades: Number of blades, 3 to 16; 0 is a round aperture. One edge is on the left (on the right behind
            focus, where shapes are turned), as in path tracers.
        curvature: Curvature of the blades, from 0 (straight) to 1 (disc).
        rotation: Rotation of blades and picture, degrees, counter-clockwise as seen.
        squeeze: Width over height of the blur disc, 0.1 to 10; the longer axis keeps its size.
        cats_eye: Shift of the second pupil disc in the corner of the picture, pupil radii, 0 to 1.5.
        spherical_profile: Radial profile s of the light, -1 to 1: 1 + s * (2 rho^2 - 1) behind focus (bright
            rims above 0) and 1 - s * (2 rho^2 - 1) in front of it, as by spherical aberration.
        obstruction: Radius of the central obstruction of a mirror lens, pupil radii, 0 to 0.95.
        picture: Transmission as a grey picture (H, W), values >= 0, as seen from behind the camera through
            the lens; lights behind focus show it upright. Its longer side spans the diameter of the pupil;
            the disc crops the rest.
        onion: Contrast of the rings that a machined aspheric surface leaves in discs, 0 to 1; a ring that is
            bright behind focus is dark in front of it (:func:`bokehnet.optics.disc_texture.onion_rings`).
        onion_rings: Number of rings from the centre to the rim, 1 to 40, not necessarily whole.
        grain: Contrast of dust and coating inside discs, 0 to 1; independent of the rotation of the blades.
        grain_seed: Seed of the grain, >= 0.

    Raises:
        ParameterError: A number is out of range, or the aperture passes no light.
        ShapeError: ``picture`` is not (H, W).
    """

    blades: int = 0
    curvature: float = 0.0
    rotation: float = 0.0
    squeeze: float = 1.0
    cats_eye: float = 0.0
    spherical_profile: float = 0.0
    obstruction: float = 0.0
    picture: npt.NDArray[np.floating[Any]] | None = None
    onion: float = 0.0
    onion_rings: float = 12.0
    grain: float = 0.0
    grain_seed: int = 0
    _key: tuple[Any, ...] = field(init=False, repr=False, default=())

    def __post_init__(self) -> None:
        blades = number_of(self.blades)
        if blades != 0 and not _MIN_BLADES <= blades <= _MAX_BLADES:
            expected = f"0 (disc) or {_MIN_BLADES} to {_MAX_BLADES}"
            raise ParameterError("blades", expected, self.blades)
        check_whole("blades", self.blades)
        check_number("rotation", self.rotation)
        for name, (minimum, maximum) in _RANGES.items():
            check_range(name, getattr(self, name), minimum, maximum)
        check_whole("grain_seed", self.grain_seed, 0)
        key: tuple[Any, ...] = (self.blades, self.curvature, self.rotation, self.squeeze)
        key += (self.cats_eye, self.spherical_profile, self.obstruction)
        key += (self.onion, self.onion and self.onion_rings, self.grain, self.grain and self.grain_seed)
        if self.picture is not None:
            picture = array_of_numbers("picture", self.picture, np.float32)
            check_rank("picture", picture, 2, "(H, W)")
            if not (np.isfinite(picture).all() and picture.min() >= 0):
                value_range = f"{picture.min():g} to {picture.max():g}"
                raise ParameterError("picture", "finite values from 0 up", shown=value_range)
            picture.setflags(write=False)
            object.__setattr__(self, "picture", picture)
            key += (picture.shape, picture.tobytes())
        object.__setattr__(self, "_key", key)
        if self.picture is not None and not _density(self).any():
            raise ParameterError(
                "picture",
                "light inside the aperture",
                shown="none",
                remedy="its longer side spans the pupil's diameter, and `blades` and `obstruction` cut it",
            )

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Aperture) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)

    @property
    def is_disc(self) -> bool:
        """True if this is an evenly lit disc, the same everywhere in the picture."""
        evenly_lit = self.spherical_profile == 0 and self.onion == 0 and self.grain == 0
        return self.is_round and evenly_lit and self.cats_eye == 0

    @property
    def is_round(self) -> bool:
        """True if the outline is the full unit disc; ignores cat's-eye, radial profile, onion and grain."""
        polygon = self.blades != 0 and self.curvature < 1
        return not polygon and self.squeeze == 1 and self.obstruction == 0 and self.picture is None


def blade_margin(
    blades: int, curvature: float, u: np.ndarray, v: np.ndarray, rho2: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return a measure of the distance of (u, v) from the blades, >= 0 inside, and the size of its gradient.

    With half the angle of an edge A = pi / blades, each edge is an arc of curvature c through two corners
    on the unit circle, (cos A, +-sin A) in the axes of the edge, whose normal n is the first axis. The
    circle of the arc, |p|^2 - 2 x p.n + x^2 = 1 / c^2 with centre x = cos A - sqrt(1 / c^2 - sin^2 A) on n,
    multiplied by c, is ``c |p|^2 + 2 k p.n = m`` with w = sqrt(1 - c^2 sin^2 A), k = w - c cos A and
    m = 2 w cos A - c cos 2A: for c = 0 the straight edge p.n = cos A, for c = 1 the unit circle. A point
    is inside if it is inside all circles, hence inside the one whose normal is nearest (k >= 0).
    """
    half_angle = math.pi / blades
    w = math.sqrt(1 - (curvature * math.sin(half_angle)) ** 2)
    k = w - curvature * math.cos(half_angle)
    m = 2 * w * math.cos(half_angle) - curvature * math.cos(2 * half_angle)
    along = np.full(np.shape(rho2), -np.inf)
    for edge in range(blades):
        angle = 2 * edge * half_angle  # from the left
        along = np.maximum(along, v * math.sin(angle) - u * math.cos(angle))
    gradient = 2 * np.sqrt(np.maximum(curvature**2 * rho2 + 2 * curvature * k * along + k * k, 0))
    return m - (curvature * rho2 + 2 * k * along), gradient


def _picture_at(picture: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return the grey value at (u, v), linear between pixel centres, 0 outside."""
    height, width = picture.shape
    longer = max(height, width)
    column = np.clip((u * longer + width) / 2 - 0.5, 0, width - 1)
    row = np.clip((v * longer + height) / 2 - 0.5, 0, height - 1)
    inside = (np.abs(u) * longer <= width) & (np.abs(v) * longer <= height)
    return np.where(inside, bilinear(picture, row, column), 0.0)


def _profile(aperture: Aperture, u: np.ndarray, v: np.ndarray, rho2: np.ndarray, side: int) -> np.ndarray:
    """Return the light on an unobstructed disc, 1 on average, at (u, v) in radii of the disc."""
    light = 1 - side * aperture.spherical_profile * (2 * rho2 - 1)
    if aperture.onion and side:
        light = light * (1 - side * aperture.onion * onion_rings(np.sqrt(rho2), aperture.onion_rings))
    if aperture.grain:
        light = light * (1 + aperture.grain * disc_grain(u, v, aperture.grain_seed))
    return np.asarray(light)


def transmission(aperture: Aperture, u: Any, v: Any, side: int = 0) -> np.ndarray:
    """Return the transmission at aperture coordinates (u, v), without the cat's-eye.

    Args:
        aperture: Aperture of the lens.
        u: Coordinate to the right, pupil radii; any shape that broadcasts with ``v``.
        v: Coordinate down, pupil radii.
        side: +1 in front of focus, -1 behind it, 0 for the mean of both (no radial profile, no onion).

    Returns:
        Transmission, >= 0, float64; 1 inside an evenly lit aperture, 0 outside the unit disc.
    """
    u, v = np.broadcast_arrays(np.asarray(u, float), np.asarray(v, float))
    u, v = u * max(1.0, 1 / aperture.squeeze), v * max(1.0, aperture.squeeze)
    rho2 = u * u + v * v
    light = ((rho2 <= 1) & (rho2 >= aperture.obstruction**2)) * _profile(aperture, u, v, rho2, side)
    angle = math.radians(aperture.rotation)
    u, v = u * math.cos(angle) - v * math.sin(angle), u * math.sin(angle) + v * math.cos(angle)
    if aperture.blades:
        light = light * (blade_margin(aperture.blades, aperture.curvature, u, v, rho2)[0] >= 0)
    if aperture.picture is not None:
        light = light * _picture_at(aperture.picture, -u, -v)
    return np.asarray(light)


@register_jitable
def cats_eye_shift(cats_eye: float, x: Array, y: Array, width: float, height: float) -> tuple[Array, Array]:
    """Return the centre (u, v), pupil radii, of the second disc that clips the aperture at a pixel.

    A ray with aperture coordinate a passes if ``|a - shift| <= 1``. The second disc is the rim of the
    front element, t in front of the pupil. A far point in direction theta (right and down as seen from
    behind the camera) sends its ray for the pupil point A through ``A + t theta`` at that rim, so it
    passes if ``|A + t theta| <= 1``. A ray through the right side of the pupil meets the sensor, before its
    focus (point in front of the focal plane), to the right of the image of the point seen from behind, and
    the picture is the sensor turned by 180 degrees: light from A falls at ``q - d A``, hence a = -A and
    the shift is ``+t theta``, away from the centre of the picture and growing with the distance from it.
    Behind focus a shape therefore loses its outer side, in front of focus its inner one; in either case
    the remaining shape is narrow along the line to the centre of the picture.

    Args:
        cats_eye: Shift in the corner of the picture, pupil radii, ``Aperture.cats_eye``.
        x: Column in the full-size picture, pixels, 0 at the centre of the first pixel.
        y: Row in the full-size picture, pixels, 0 at the centre of the first pixel.
        width: Width of the full-size picture, pixels.
        height: Height of the full-size picture, pixels.

    Source:
        Kingslake, "Optics in photography", SPIE 1992, on mechanical vignetting; the signs are our own.
    """
    scale = 2.0 * cats_eye / (width * width + height * height) ** 0.5
    return scale * (x - 0.5 * (width - 1)), scale * (y - 0.5 * (height - 1))


@lru_cache(maxsize=8)
def _density(aperture: Aperture) -> np.ndarray:
    """Return the mean transmission of both sides in each cell of the square [-1, 1]^2, (v, u)."""
    fine = _CELLS * _SUBCELLS
    axis = (np.arange(fine) + 0.5) * (2 / fine) - 1
    light = transmission(aperture, axis[None, :], axis[:, None])
    return light.reshape(_CELLS, _SUBCELLS, _CELLS, _SUBCELLS).mean(axis=(1, 3))


def _invert(cumulative: np.ndarray, row: np.ndarray, fraction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the cell, and the position in it, at which rows of exclusive sums reach ``fraction``.

    ``cumulative`` is (R, cells + 1).
    """
    normal = cumulative / np.maximum(cumulative[:, -1:], 1e-300)
    sorted_sums = (normal[:, 1:] + np.arange(len(normal))[:, None]).ravel()
    cells = normal.shape[1] - 1
    cell = np.clip(np.searchsorted(sorted_sums, row + fraction, side="right") - row * cells, 0, cells - 1)
    low, high = normal[row, cell], normal[row, cell + 1]
    return cell, np.clip((fraction - low) / np.maximum(high - low, 1e-300), 0, 1)


def pupil_points(aperture: Aperture, square: np.ndarray, side: int) -> tuple[np.ndarray, np.ndarray]:
    """Map points of the unit square onto the aperture, preserving strata.

    A round aperture uses :func:`disc_from_square`; any other aperture inverts the cumulative sums of its
    transmission (mean of both sides), first along v, then along u. The weights account for the difference
    from this density: radial profiles and the exact edge inside a cell. Does not include the cat's-eye.

    Args:
        aperture: Aperture of the lens.
        square: Points (N, 2) in [0, 1)^2.
        side: +1 in front of focus, -1 behind it.

    Returns:
        Aperture coordinates (N, 2), and weights (N,) >= 0: the mean of ``weight * f(point)``, divided
        by the mean weight, converges to the mean of f over the transmitted light.

    Source:
        Pharr, Jakob and Humphreys, "Physically based rendering", 2016, 13.6.7 (2D sampling).
    """
    square = np.asarray(square, float)
    if aperture.is_round:
        points = np.asarray(disc_from_square(square))
        u, v = points[:, 0], points[:, 1]
        return points, _profile(aperture, u, v, (points**2).sum(-1), side)
    density = _density(aperture)
    along_u = np.pad(np.cumsum(density, axis=1), ((0, 0), (1, 0)))
    along_v = np.pad(np.cumsum(along_u[:, -1]), (1, 0))[None]
    row, down = _invert(along_v, np.zeros(len(square), np.intp), square[:, 1])
    column, right = _invert(along_u, row, square[:, 0])
    points = np.stack([column + right, row + down], -1) * (2 / _CELLS) - 1
    return points, transmission(aperture, points[:, 0], points[:, 1], side) / density[row, column]
