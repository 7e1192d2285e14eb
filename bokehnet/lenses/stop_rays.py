"""Rays through a prescription, with their intersections with the aperture stop."""

from dataclasses import dataclass, replace

import numpy as np

from bokehnet.lenses.prescription import PrescriptionLens
from bokehnet.lenses.surface_trace import Beam, Surface, beam_between, trace

__all__ = ["StopRays", "chief_rays", "stop_rays"]

# Iterations towards the centre of the stop; each reduces the error to a few per cent, the pupil aberration.
_MAX_ITERATIONS = 20


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class StopRays:
    """Traced rays in the orientation of the picture: right and down.

    Attributes:
        stop: Intersections with the stop, in radii of the iris as set, (..., 2); the sign is that of
            aperture coordinates (:mod:`bokehnet.optics.aperture`).
        origin: Intersections with the plane of the entrance pupil, mm, (..., 2).
        slope: Lateral displacement per unit of depth, (..., 2).
        heights: Height over semi-diameter at each surface including the stop, (surfaces, ...); above 1 is
            clipped, and a very large number marks rays that cannot continue.
        sensor_slope: Direction cosines (x, y, t) at the sensor, (3, ...).
        inner_heights: Height over inner radius at each surface with a central obstruction, (obstructions,
            ...); below 1 is blocked.
    """

    stop: np.ndarray
    origin: np.ndarray
    slope: np.ndarray
    heights: np.ndarray
    sensor_slope: np.ndarray
    inner_heights: np.ndarray

    @property
    def passes(self) -> np.ndarray:
        """True for unobstructed rays, (...,)."""
        return np.asarray(
            (self.heights.max(axis=0) <= 1) & (self.inner_heights.min(axis=0, initial=np.inf) >= 1)
        )


def stop_rays(
    lens: PrescriptionLens, place: np.ndarray, aim: np.ndarray, wavelength: float | None = None
) -> StopRays:
    """Trace rays from the sensor into the scene; clipped rays continue and are marked.

    Args:
        lens: Lens to trace.
        place: Points of the picture relative to its centre, mm on the sensor, (..., 2), right and down.
        aim: Points in the plane of the paraxial exit pupil, mm in sensor orientation, (..., 2).
        wavelength: Wavelength, nm; None is the design wavelength.
    """
    surfaces = lens.surfaces_at(wavelength)
    start = (-place[..., 0], -place[..., 1], lens.sensor_position)
    beam = beam_between(start, (aim[..., 0], aim[..., 1], lens.paraxial.exit.position))
    sensor_slope = np.stack(beam.direction)
    heights, inner_heights, stop = [], [], np.zeros(place.shape)
    for surface in reversed(surfaces):
        if surface.stop:
            # Entrance and exit pupil may be inverted images of the stop; light that passes left of the
            # centre of the pupil, in the scene, has aperture coordinates on the right.
            scale = -np.sign(lens.paraxial.stop_magnification) / surface.semi_diameter
            stop = scale * np.stack(beam.at(surface.vertex), -1)
        beam, height = _pass(replace(surface, inner_radius=0.0), beam)
        heights.append(height)
        if surface.inner_radius > 0:
            inner_heights.append(height * surface.semi_diameter / surface.inner_radius)
    dx, dy, dt = beam.direction
    return StopRays(
        stop=stop,
        origin=np.stack(beam.at(lens.paraxial.entrance.position), -1),
        slope=np.stack([-dx / dt, -dy / dt], -1),
        heights=np.stack(heights[::-1]),
        sensor_slope=sensor_slope,
        inner_heights=np.stack(inner_heights[::-1]) if inner_heights else np.ones((0, *place.shape[:-1])),
    )


def _pass(surface: Surface, beam: Beam) -> tuple[Beam, np.ndarray]:
    """Return the rays behind one surface, and their height over semi-diameter at it."""
    clear = Beam(
        position=beam.position, direction=beam.direction, fill=0 * beam.fill, stop_fill=0 * beam.fill
    )
    passed = trace([surface], clear, backwards=True)
    return passed, np.maximum(passed.fill, passed.stop_fill)


def chief_rays(lens: PrescriptionLens, place: np.ndarray, wavelength: float | None = None) -> StopRays:
    """Trace the rays through the centre of the stop; arguments as for :func:`stop_rays`."""
    step = np.sign(lens.paraxial.stop_magnification) * lens.paraxial.exit.radius
    aim = np.zeros(place.shape)
    for _ in range(_MAX_ITERATIONS):
        aim = aim + step * stop_rays(lens, place, aim, wavelength).stop
    return stop_rays(lens, place, aim, wavelength)
