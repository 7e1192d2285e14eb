"""Effective pupil: the region of the exit pupil through which each sensor point receives light.

Off the axis the rims of the other surfaces clip the exit pupil, and its own aberrations move and stretch it.
Tracing finds the passing region once, for points along one radius, and encloses it in ellipses; for any
other sensor point the ellipse is rotated about the axis. Rays aimed at the ellipses are rarely lost.
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
_SEARCH_RADII = 2.5
# Enlargement of the ellipses, to allow for the grid and for other wavelengths.
_MARGIN = 1.01
# Number of directions in which a lens that is not rotationally symmetric is traced.
_DIRECTIONS = 4


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class EffectivePupil:
    """Ellipses in the plane of the exit pupil, one for each field.

    Attributes:
    max_slope: Slope, lateral over axial, from the centre of the exit pupil to the last sensor point.
        ellipses: (fields, 3): centre along the radius, half-axis along it, half-axis across, mm; fields are
            equal steps of that slope, from 0.
    """

    max_slope: float
    ellipses: np.ndarray

    def aim(self, sensor_xy: Array, distance: Array, pupil_uv: Array) -> tuple[Array, Array, Array]:
        """Map the unit disc onto the ellipse of a sensor point.

        Args:
            sensor_xy: Sensor points, mm, (..., 2).
            distance: Distance from the exit pupil to the sensor point, mm.
            pupil_uv: Points of the unit disc, (..., 2).

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
        place = radius * off_axis / distance * ((len(self.ellipses) - 1) / self.max_slope)
        centre, along, across = self._ellipse_at(place)
        radial = centre + along * (cosine * u + sine * v)
        tangential = across * (cosine * v - sine * u)
        return cosine * radial - sine * tangential, sine * radial + cosine * tangential, along * across

    def _ellipse_at(self, place: Array) -> tuple[Array, Array, Array]:
        """Interpolate between fields at the fractional index ``place``; constant beyond the last field."""
        xp = array_namespace(place)
        place = xp.clip(place, 0, len(self.ellipses) - 1)
        below = xp.clip(xp.floor(place), 0, len(self.ellipses) - 2)
        fraction = (place - below)[..., None]
        index = below.astype(np.intp) if xp is np else below.long()
        ellipses = constant_like(self.ellipses, place)
        ellipse = ellipses[index] * (1 - fraction) + ellipses[index + 1] * fraction
        return ellipse[..., 0], ellipse[..., 1], ellipse[..., 2]


def find_effective_pupil(
    surfaces: Sequence[Surface], exit_pupil: Pupil, distance: float, sensor_radius: float
) -> EffectivePupil:
    """Return the effective pupil of a lens, by ray tracing.

    Args:
        surfaces: Surfaces of the lens.
        exit_pupil: Paraxial exit pupil.
        distance: Distance from the exit pupil to the sensor, mm.
        sensor_radius: Largest distance of sensor points from the axis, mm.

    Raises:
        LensError: No ray from the centre of the sensor passes.

    Source:
        Steinert et al., "General spectral camera lens simulation", 2011, with bounding circles.
    """
    max_slope = sensor_radius / distance
    field = np.linspace(0, sensor_radius, _FIELDS)[:, None, None]
    size = _SEARCH_RADII * abs(exit_pupil.radius)
    boxes = np.tile([-size, size, size], (_FIELDS, 1))
    variants = _rotated_lenses(surfaces)
    boxes, _ = _narrow(variants, exit_pupil, distance, field, boxes, _COARSE)
    boxes, rims = _narrow(variants, exit_pupil, distance, field, boxes, _FINE)
    ellipses = np.zeros((_FIELDS, 3))
    for i, (box, rim) in enumerate(zip(boxes, rims, strict=True)):
        if np.isfinite(box).all():
            ellipses[i] = _enclose(*rim)
        elif i == 0:
            raise LensError("the lens passes no light: no ray from the middle of the sensor gets through")
        else:  # no light from this field on; an ellipse of no area gives weight 0
            ellipses[i, 0] = ellipses[i - 1, 0]
    return EffectivePupil(max_slope=max_slope, ellipses=ellipses)


def _rotated_lenses(surfaces: Sequence[Surface]) -> list[list[Surface]]:
    """Return the lens rotated to several directions of the sensor, and mirrored; unchanged if it is centred.

    The union of passing rays is then symmetric, so that points along one radius and one half of the pupil
    suffice.
    """
    if all(surface.centred for surface in surfaces):
        return [list(surfaces)]
    variants = []
    for angle in 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS:
        rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        for side in (1, -1):
            rotated = []
            for surface in surfaces:
                (x, y), (about_x, about_y) = rotation @ surface.shift[:2], rotation @ surface.tilt
                shift = (float(x), side * float(y), surface.shift[2])
                rotated.append(replace(surface, shift=shift, tilt=(side * float(about_x), float(about_y))))
            variants.append(rotated)
    return variants


def _narrow(
    variants: Sequence[Sequence[Surface]],
    exit_pupil: Pupil,
    distance: float,
    field: np.ndarray,
    boxes: np.ndarray,
    count: int,
) -> tuple[np.ndarray, list[tuple[np.ndarray, np.ndarray]]]:
    """Return bounding boxes and rims of the passing rays, traced on a grid of ``count``^2 rays per box.

    Boxes are (fields, 3): lowest u, highest u, highest v. ``variants`` contains the lenses of
    :func:`_rotated_lenses`, whose union is symmetric in v. Boxes are enlarged by one cell on all sides; a box
    without passing rays becomes NaN. The rims are columns u and the highest v, at the outer sides of the
    cells.
    """
    steps = (np.arange(count) + 0.5) / count
    low, high, top = (boxes[:, i, None, None] for i in range(3))
    u = (low + (high - low) * steps[:, None]) * np.ones((1, 1, count))
    v = top * steps * np.ones((1, count, 1))
    start = (field, 0 * field, exit_pupil.position + distance)
    beam = beam_between(start, (u, v, exit_pupil.position))
    passes = np.zeros(u.shape, bool)
    for surfaces in variants:
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
    """Return the smallest ellipse around points, centred on v = 0: centre, and half-axes along u and v."""
    centre = np.linspace(u.min(), u.max(), 65)[:, None, None]
    flatness = np.geomspace(0.25, 4, 65)[:, None]  # half-axis across over that along
    along2 = ((u - centre) ** 2 + (v / flatness) ** 2).max(axis=-1)
    best = np.unravel_index(np.argmin(along2 * flatness[:, 0]), along2.shape)
    along = _MARGIN * float(along2[best]) ** 0.5
    return float(centre[best[0], 0, 0]), along, along * float(flatness[best[1], 0])
