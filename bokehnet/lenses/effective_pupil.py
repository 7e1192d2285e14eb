"""Where rays must be aimed so that few are lost: the effective pupil, seen from each point of the sensor.

Off the axis the rims of the other surfaces cut the exit pupil, and its own aberrations move and stretch it.
What passes is found once by tracing, for points along one radius, and enclosed in ellipses; every
other point of the sensor is one of these, turned about the axis.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bokehnet.checks import Array, array_namespace, constant_like
from bokehnet.errors import LensError
from bokehnet.lenses.surface_trace import Surface, beam_between, trace
from bokehnet.optics.paraxial import Pupil

__all__ = ["EffectivePupil", "find_effective_pupil"]

_FIELDS = 33
_COARSE, _FINE = 48, 96
# Half-side of the searched square over the radius of the exit pupil.
_SEARCH = 2.5
# Ellipses are larger than what was found by this factor, because of the grid and of other wavelengths.
_MARGIN = 1.01
# Directions from which a lens is looked at that is not symmetric.
_AROUND = 4


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class EffectivePupil:
    """Ellipses in the plane of the exit pupil.

    Attributes:
        steepest: Slope, lateral over axial, from the middle of the exit pupil to the last sensor point.
        ellipses: (fields, 3): centre along the radius, half-axis along it, half-axis across, mm; fields are
            even steps of that slope, from 0.
    """

    steepest: float
    ellipses: np.ndarray

    def aim(self, sensor_xy: Array, distance: Array, pupil_uv: Array) -> tuple[Array, Array, Array]:
        """Map the unit disc onto the ellipse that is seen from a sensor point.

        Args:
            sensor_xy: (..., 2), mm.
            distance: From the exit pupil to the sensor point, mm.
            pupil_uv: (..., 2) in the unit disc.

        Returns:
            x and y in the plane of the exit pupil, mm, and the product of the half-axes, mm^2, each (...,).
        """
        x, y = sensor_xy[..., 0], sensor_xy[..., 1]
        u, v = pupil_uv[..., 0], pupil_uv[..., 1]
        xp = array_namespace(x)
        square = x * x + y * y
        off_axis = square > 0
        radius = xp.where(off_axis, square, xp.ones_like(square)) ** 0.5
        cosine = xp.where(off_axis, x / radius, xp.ones_like(x))
        sine = xp.where(off_axis, y / radius, xp.zeros_like(y))
        place = radius * off_axis / distance * ((len(self.ellipses) - 1) / self.steepest)
        centre, along, across = self._ellipse_at(place)
        radial = centre + along * (cosine * u + sine * v)
        tangential = across * (cosine * v - sine * u)
        return cosine * radial - sine * tangential, sine * radial + cosine * tangential, along * across

    def _ellipse_at(self, place: Array) -> tuple[Array, Array, Array]:
        """Interpolate between fields; ``place`` counts them, and beyond the last one nothing changes."""
        xp = array_namespace(place)
        place = xp.clip(place, 0, len(self.ellipses) - 1)
        below = xp.clip(xp.floor(place), 0, len(self.ellipses) - 2)
        share = (place - below)[..., None]
        index = below.astype(np.intp) if xp is np else below.long()
        ellipses = constant_like(self.ellipses, place)
        found = ellipses[index] * (1 - share) + ellipses[index + 1] * share
        return found[..., 0], found[..., 1], found[..., 2]


def find_effective_pupil(
    surfaces: Sequence[Surface], exit_pupil: Pupil, distance: float, sensor_radius: float
) -> EffectivePupil:
    """Find the effective pupil by tracing.

    Args:
        surfaces: The lens.
        exit_pupil: Its paraxial exit pupil.
        distance: From the exit pupil to the sensor, mm.
        sensor_radius: How far from the axis, mm.

    Raises:
        LensError: No ray from the middle of the sensor passes.

    Source:
        Steinert et al., "General spectral camera lens simulation", 2011, with bounding circles.
    """
    steepest = sensor_radius / distance
    field = np.linspace(0, sensor_radius, _FIELDS)[:, None, None]
    size = _SEARCH * abs(exit_pupil.radius)
    boxes = np.tile([-size, size, size], (_FIELDS, 1))
    ways = _seen_from_around(surfaces)
    boxes, _ = _narrow(ways, exit_pupil, distance, field, boxes, _COARSE)
    boxes, rims = _narrow(ways, exit_pupil, distance, field, boxes, _FINE)
    ellipses = np.zeros((_FIELDS, 3))
    for i, (box, rim) in enumerate(zip(boxes, rims, strict=True)):
        if np.isfinite(box).all():
            ellipses[i] = _enclose(*rim)
        elif i == 0:
            raise LensError("the lens passes no light: no ray from the middle of the sensor gets through")
        else:  # dark from here on; an ellipse of no area keeps the weight at 0
            ellipses[i, 0] = ellipses[i - 1, 0]
    return EffectivePupil(steepest=steepest, ellipses=ellipses)


def _seen_from_around(surfaces: Sequence[Surface]) -> list[list[Surface]]:
    """The lens as points in several directions of the sensor see it, and in a mirror; once if it is centred.

    What passes is then looked for in one half of the pupil, for points along one radius.
    """
    if all(surface.centred for surface in surfaces):
        return [list(surfaces)]
    ways = []
    for angle in 2 * np.pi * np.arange(_AROUND) / _AROUND:
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        for side in (1, -1):
            seen = []
            for surface in surfaces:
                (x, y), (about_x, about_y) = turn @ surface.shift[:2], turn @ surface.tilt
                shift = (float(x), side * float(y), surface.shift[2])
                seen.append(replace(surface, shift=shift, tilt=(side * float(about_x), float(about_y))))
            ways.append(seen)
    return ways


def _narrow(
    ways: Sequence[Sequence[Surface]],
    exit_pupil: Pupil,
    distance: float,
    field: np.ndarray,
    boxes: np.ndarray,
    count: int,
) -> tuple[np.ndarray, list[tuple[np.ndarray, np.ndarray]]]:
    """Bound what passes in boxes (fields, 3) of lowest u, highest u, highest v, by ``count``^2 rays.

    In ``ways`` is the lens as :func:`_seen_from_around` has it, all together symmetric in v. Boxes get one
    cell more all round; one where nothing passes becomes NaN. The rims are columns u and the highest v, of
    the outer sides of the cells.
    """
    steps = (np.arange(count) + 0.5) / count
    low, high, top = (boxes[:, i, None, None] for i in range(3))
    u = (low + (high - low) * steps[:, None]) * np.ones((1, 1, count))
    v = top * steps * np.ones((1, count, 1))
    start = (field, 0 * field, exit_pupil.position + distance)
    beam = beam_between(start, (u, v, exit_pupil.position))
    passes = np.zeros(u.shape, bool)
    for surfaces in ways:
        passes |= trace(surfaces, beam, backwards=True).passes
    passes &= np.isfinite(u)
    narrowed, rims = np.full_like(boxes, np.nan), []
    for i, inside in enumerate(passes):
        columns = np.flatnonzero(inside.any(axis=1))
        half_u, half_v = (high[i, 0, 0] - low[i, 0, 0]) / count / 2, top[i, 0, 0] / count / 2
        if len(columns):
            highest = np.where(inside, v[i], 0).max(axis=1)[columns] + half_v
            places = u[i, columns, 0]
            narrowed[i] = places[0] - 2 * half_u, places[-1] + 2 * half_u, highest.max() + half_v
            rims.append((np.concatenate([places - half_u, places + half_u]), np.tile(highest, 2)))
        else:
            rims.append((np.empty(0), np.empty(0)))
    return narrowed, rims


def _enclose(u: np.ndarray, v: np.ndarray) -> tuple[float, float, float]:
    """Smallest ellipse around points, upright and centred on v = 0: centre and half-axes along u and v."""
    centre = np.linspace(u.min(), u.max(), 65)[:, None, None]
    flatness = np.geomspace(0.25, 4, 65)[:, None]  # half-axis across over that along
    along2 = ((u - centre) ** 2 + (v / flatness) ** 2).max(axis=-1)
    best = np.unravel_index(np.argmin(along2 * flatness[:, 0]), along2.shape)
    along = _MARGIN * float(along2[best]) ** 0.5
    return float(centre[best[0], 0, 0]), along, along * float(flatness[best[1], 0])
