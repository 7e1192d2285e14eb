"""The shape of the lens opening: what part of the light a ray through each of its points carries.

Aperture coordinates (u right, v down, as in the picture) lie in the unit disc. A point of the scene with
signed blur radius d (pixels, + in front of focus) lights the pixels ``q + d * (u, v)`` around its own
place q. The ray through the pupil's point A, in pupil radii as seen from behind the camera, crosses the plane
of focus at A (1 - zf / z) from where the point is seen, so the light of A falls at ``q - d A``: a is -A, what
stands in the opening is seen upright behind focus and turned by 180 degrees in front of it.

The opening is the product of all its parts. Hole and rim belong to the round pupil, blades and picture
turn with ``rotation``; ``squeeze`` then narrows the whole. The cat's-eye alone depends on the place in the
picture and stands apart (:func:`cats_eye_shift`).
"""

import math
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
from numba.extending import register_jitable

from bokehnet.checks import array_of_numbers, check_number, check_range, check_rank, check_whole, number_of
from bokehnet.errors import ParameterError
from bokehnet.optics.disc_texture import disc_grain, onion_rings
from bokehnet.optics.sampling import disc_from_square

__all__ = ["Aperture", "blade_margin", "cats_eye_shift", "pupil_points", "transmission"]

# Name -> (lowest, highest); a cat's-eye of 1.5 leaves a seventh of the light in the picture's corner.
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

_FEWEST_BLADES, _MOST_BLADES = 3, 16

# Cells along each side of the density that pupil points follow, and sub-cells along each side of a cell.
_CELLS, _SUBCELLS = 256, 4


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Aperture:
    """The lens opening; the default is a plain disc. Equal by value, and a key of caches.

    Attributes:
        blades: Number of blades, 3 to 16; 0 is a round opening. One edge is on the left (behind focus, where
            shapes are turned, on the right), as path tracers have it.
        curvature: 0 for straight blades to 1 for a disc.
        rotation: Turn of blades and picture in degrees, counter-clockwise as seen.
        squeeze: Width over height of the blur disc, 0.1 to 10; the longer one keeps its size.
        cats_eye: Displacement, in pupil radii, of the second pupil disc in the picture's corner, 0 to 1.5.
        spherical_profile: Radial profile s of the light, -1 to 1: 1 + s * (2 rho^2 - 1) behind focus (above
            0: bright rims) and 1 - s * (2 rho^2 - 1) in front of it, as spherical aberration gives.
        obstruction: Radius of the central hole of a mirror lens, 0 to 0.95.
        picture: Any grey picture (H, W), values from 0 up: the transmission, as seen from behind the camera
            through the lens; lights behind focus show it upright. Its longer side spans the pupil's
            diameter; what lies outside the disc is cut off.
        onion: Contrast of the rings that a machined aspheric surface draws into discs, 0 to 1; bright
            behind focus is dark in front of it (:func:`bokehnet.optics.disc_texture.onion_rings`).
        onion_rings: Their number from the middle to the rim, 1 to 40, whole or not.
        grain: Contrast of dust and coating inside discs, 0 to 1; it stays with the glass when blades turn.
        grain_seed: Which grain, from 0 up.

    Raises:
        ParameterError: A number is out of range, or nothing is left of the opening.
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
        if blades != 0 and not _FEWEST_BLADES <= blades <= _MOST_BLADES:
            expected = f"0 (disc) or {_FEWEST_BLADES} to {_MOST_BLADES}"
            raise ParameterError("blades", expected, self.blades)
        check_whole("blades", self.blades)
        check_number("rotation", self.rotation)
        for name, (lowest, highest) in _RANGES.items():
            check_range(name, getattr(self, name), lowest, highest)
        check_whole("grain_seed", self.grain_seed, 0)
        key: tuple[Any, ...] = (self.blades, self.curvature, self.rotation, self.squeeze)
        key += (self.cats_eye, self.spherical_profile, self.obstruction)
        key += (self.onion, self.onion and self.onion_rings, self.grain, self.grain and self.grain_seed)
        if self.picture is not None:
            picture = array_of_numbers("picture", self.picture, np.float32)
            check_rank("picture", picture, 2, "(H, W)")
            if not (np.isfinite(picture).all() and picture.min() >= 0):
                least = f"{picture.min():g} to {picture.max():g}"
                raise ParameterError("picture", "finite values from 0 up", shown=least)
            picture.setflags(write=False)
            object.__setattr__(self, "picture", picture)
            key += (picture.shape, picture.tobytes())
        object.__setattr__(self, "_key", key)
        if self.picture is not None and not _density(self).any():
            raise ParameterError(
                "picture",
                "light inside the opening",
                shown="none",
                remedy="its longer side spans the pupil's diameter, and `blades` and `obstruction` cut it",
            )

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Aperture) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)

    @property
    def is_disc(self) -> bool:
        """Whether this is a plain disc, evenly lit, the same all over the picture."""
        evenly_lit = self.spherical_profile == 0 and self.onion == 0 and self.grain == 0
        return self.is_round and evenly_lit and self.cats_eye == 0

    @property
    def is_round(self) -> bool:
        """Whether the opening is the full unit disc; cat's-eye, rim, onion and grain are not looked at."""
        polygon = self.blades != 0 and self.curvature < 1
        return not polygon and self.squeeze == 1 and self.obstruction == 0 and self.picture is None


def blade_margin(
    blades: int, curvature: float, u: np.ndarray, v: np.ndarray, rho2: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """How far inside the blades (u, v) lies: a number from 0 up inside, and the size of its gradient.

    With half the angle of an edge A = pi / blades, each edge is an arc of curvature c through two corners
    on the unit circle, (cos A, +-sin A) in the edge's own axes with the normal n along the first. The
    arc's circle, |p|^2 - 2 x p.n + x^2 = 1 / c^2 with centre x = cos A - sqrt(1 / c^2 - sin^2 A) on n,
    multiplied by c, is ``c |p|^2 + 2 k p.n = m`` with w = sqrt(1 - c^2 sin^2 A), k = w - c cos A and
    m = 2 w cos A - c cos 2A: for c = 0 the straight edge p.n = cos A, for c = 1 the unit circle. A point
    is inside when it is inside all circles, hence inside the one whose normal is nearest (k >= 0).
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
    """Grey value at (u, v), linear between pixel centres, 0 outside."""
    height, width = picture.shape
    longer = max(height, width)
    column = np.clip((u * longer + width) / 2 - 0.5, 0, width - 1)
    row = np.clip((v * longer + height) / 2 - 0.5, 0, height - 1)
    left, top = column.astype(np.intp), row.astype(np.intp)
    right, bottom = np.minimum(left + 1, width - 1), np.minimum(top + 1, height - 1)
    x, y = column - left, row - top
    upper = picture[top, left] * (1 - x) + picture[top, right] * x
    lower = picture[bottom, left] * (1 - x) + picture[bottom, right] * x
    inside = (np.abs(u) * longer <= width) & (np.abs(v) * longer <= height)
    return np.where(inside, upper * (1 - y) + lower * y, 0.0)


def _profile(aperture: Aperture, u: np.ndarray, v: np.ndarray, rho2: np.ndarray, side: int) -> np.ndarray:
    """Light on an open disc, 1 on average, at (u, v) in the disc's own radii."""
    light = 1 - side * aperture.spherical_profile * (2 * rho2 - 1)
    if aperture.onion and side:
        light = light * (1 - side * aperture.onion * onion_rings(np.sqrt(rho2), aperture.onion_rings))
    if aperture.grain:
        light = light * (1 + aperture.grain * disc_grain(u, v, aperture.grain_seed))
    return np.asarray(light)


def transmission(aperture: Aperture, u: Any, v: Any, side: int = 0) -> np.ndarray:
    """Light that passes at aperture coordinates (u, v), everything except the cat's-eye.

    Args:
        aperture: The opening.
        u: To the right, in pupil radii; any shape that goes with ``v``.
        v: Down.
        side: +1 in front of focus, -1 behind it, 0 for the mean of both (no rim, no onion).

    Returns:
        Values from 0 up, float64; 1 where an evenly lit opening is open, 0 outside the unit disc.
    """
    u, v = np.broadcast_arrays(np.asarray(u, float), np.asarray(v, float))
    u, v = u * max(1.0, 1 / aperture.squeeze), v * max(1.0, aperture.squeeze)
    rho2 = u * u + v * v
    light = ((rho2 <= 1) & (rho2 >= aperture.obstruction**2)) * _profile(aperture, u, v, rho2, side)
    turn = math.radians(aperture.rotation)
    u, v = u * math.cos(turn) - v * math.sin(turn), u * math.sin(turn) + v * math.cos(turn)
    if aperture.blades:
        light = light * (blade_margin(aperture.blades, aperture.curvature, u, v, rho2)[0] >= 0)
    if aperture.picture is not None:
        light = light * _picture_at(aperture.picture, -u, -v)
    return np.asarray(light)


@register_jitable
def cats_eye_shift(cats_eye, x, y, width, height):  # type: ignore[no-untyped-def]
    """Centre (u, v), in pupil radii, of the second disc that clips the opening at a place of the picture.

    A ray with aperture coordinate a passes when ``|a - shift| <= 1``. The second disc is the rim of the
    front element, t in front of the pupil. A far point in direction theta (right and down as seen from
    behind the camera) sends its ray for the pupil's point A through ``A + t theta`` at that rim, so it
    passes for ``|A + t theta| <= 1``. A ray through the pupil's right side meets the sensor, before its
    focus (point in front of the focal plane), to the right of the point's image seen from behind, and
    the picture is the sensor turned by 180 degrees: light from A falls at ``q - d A``, hence a = -A and
    the shift is ``+t theta``, away from the picture's centre and growing with the distance from it.
    Behind focus a shape therefore loses its outer side, in front of focus its inner one; in either case
    what is left is narrow along the line to the picture's centre.

    Args:
        cats_eye: Displacement in the picture's corner, ``Aperture.cats_eye``.
        x: Column in pixels of the full-size picture, 0 in the middle of the first one.
        y: Row.
        width: Size of the full-size picture in pixels.
        height: The same.

    Source:
        Kingslake, "Optics in photography", SPIE 1992, on mechanical vignetting; the signs are ours.
    """
    scale = 2.0 * cats_eye / (width * width + height * height) ** 0.5
    return scale * (x - 0.5 * (width - 1)), scale * (y - 0.5 * (height - 1))


@lru_cache(maxsize=8)
def _density(aperture: Aperture) -> np.ndarray:
    """Mean transmission of both sides in each cell of the square [-1, 1]^2, (v, u)."""
    fine = _CELLS * _SUBCELLS
    axis = (np.arange(fine) + 0.5) * (2 / fine) - 1
    light = transmission(aperture, axis[None, :], axis[:, None])
    return light.reshape(_CELLS, _SUBCELLS, _CELLS, _SUBCELLS).mean(axis=(1, 3))


def _invert(cumulative: np.ndarray, row: np.ndarray, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cell and place inside it where rows of exclusive sums, (R, cells + 1), reach the share ``wanted``."""
    normal = cumulative / np.maximum(cumulative[:, -1:], 1e-300)
    ranked = (normal[:, 1:] + np.arange(len(normal))[:, None]).ravel()
    cells = normal.shape[1] - 1
    cell = np.clip(np.searchsorted(ranked, row + wanted, side="right") - row * cells, 0, cells - 1)
    low, high = normal[row, cell], normal[row, cell + 1]
    return cell, np.clip((wanted - low) / np.maximum(high - low, 1e-300), 0, 1)


def pupil_points(aperture: Aperture, square: np.ndarray, side: int) -> tuple[np.ndarray, np.ndarray]:
    """Map points of the unit square onto the opening so that strata stay strata.

    A round opening takes the points by :func:`disc_from_square`; any other one by inverting the sums of
    its transmission (mean of both sides), first along v, then along u. The weights carry what the density
    leaves: profiles and the exact edge inside a cell. The cat's-eye is not in here.

    Args:
        aperture: The opening.
        square: Points (N, 2) in [0, 1)^2.
        side: +1 in front of focus, -1 behind it.

    Returns:
        Aperture coordinates (N, 2), and weights (N,) from 0 up: means of ``weight * f(point)``, divided
        by the mean weight, tend to the mean of f over the light that passes.

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
