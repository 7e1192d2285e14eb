"""Rays through a prescription, with the place where each crosses the aperture stop."""

from dataclasses import dataclass, replace

import numpy as np

from bokehnet.lenses.prescription import PrescriptionLens
from bokehnet.lenses.surface_trace import Beam, Surface, beam_between, trace

__all__ = ["StopRays", "chief_rays", "stop_rays"]

# Steps towards the middle of the stop; each leaves the pupil's aberration, a few per cent, of the transverse
# aberration.
_STEPS = 20


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class StopRays:
    """What is known of traced rays, in the orientation of the picture: right and down.

    Attributes:
        stop: Where they cross the stop, in radii of the iris as it is set, (..., 2); the sign is that of
            aperture coordinates (:mod:`bokehnet.optics.aperture`).
        origin: Where they cross the plane of the entrance pupil, mm, (..., 2).
        slope: Lateral travel per unit of depth, (..., 2).
        heights: Height over semi-diameter at each surface, (surfaces, ...), the stop among them; above 1 is
            clipped, and a very large number marks rays that cannot go on.
        sensor_slope: Cosines (x, y, t) of the angles at the sensor, (3, ...).
        cores: Height over inner radius at each surface that stops rays near the axis, (some, ...); below 1 is
            stopped.
    """

    stop: np.ndarray
    origin: np.ndarray
    slope: np.ndarray
    heights: np.ndarray
    sensor_slope: np.ndarray
    cores: np.ndarray

    @property
    def passes(self) -> np.ndarray:
        """Which rays nothing has stopped, (...,)."""
        return np.asarray((self.heights.max(axis=0) <= 1) & (self.cores.min(axis=0, initial=np.inf) >= 1))


def stop_rays(
    lens: PrescriptionLens, place: np.ndarray, aim: np.ndarray, wavelength: float | None = None
) -> StopRays:
    """Trace rays from the sensor into the scene; none is given up where it is clipped.

    Args:
        lens: The lens.
        place: Places in the picture from its middle, mm on the sensor, (..., 2), right and down.
        aim: Points of the paraxial exit pupil's plane, mm on the sensor's side, (..., 2).
        wavelength: Nanometres; None is the design wavelength.
    """
    surfaces = lens.surfaces_at(wavelength)
    start = (-place[..., 0], -place[..., 1], lens.sensor_position)
    beam = beam_between(start, (aim[..., 0], aim[..., 1], lens.paraxial.exit.position))
    sensor_slope = np.stack(beam.direction)
    heights, cores, stop = [], [], np.zeros(place.shape)
    for surface in reversed(surfaces):
        if surface.stop:
            # Entrance and exit pupil may be turned images of the stop; light passes left of the pupil's
            # middle, as the scene has it, where aperture coordinates say right.
            turn = -np.sign(lens.paraxial.entrance_per_stop) / surface.semi_diameter
            stop = turn * np.stack(beam.at(surface.vertex), -1)
        beam, height = _pass(replace(surface, inner_radius=0.0), beam)
        heights.append(height)
        if surface.inner_radius > 0:
            cores.append(height * surface.semi_diameter / surface.inner_radius)
    dx, dy, dt = beam.direction
    return StopRays(
        stop=stop,
        origin=np.stack(beam.at(lens.paraxial.entrance.position), -1),
        slope=np.stack([-dx / dt, -dy / dt], -1),
        heights=np.stack(heights[::-1]),
        sensor_slope=sensor_slope,
        cores=np.stack(cores[::-1]) if cores else np.ones((0, *place.shape[:-1])),
    )


def _pass(surface: Surface, beam: Beam) -> tuple[Beam, np.ndarray]:
    """Rays behind one surface, and their height over semi-diameter there."""
    clear = Beam(
        position=beam.position, direction=beam.direction, fill=0 * beam.fill, stop_fill=0 * beam.fill
    )
    passed = trace([surface], clear, backwards=True)
    return passed, np.maximum(passed.fill, passed.stop_fill)


def chief_rays(lens: PrescriptionLens, place: np.ndarray, wavelength: float | None = None) -> StopRays:
    """Trace the rays through the middle of the stop; arguments of :func:`stop_rays`."""
    step = np.sign(lens.paraxial.entrance_per_stop) * lens.paraxial.exit.radius
    aim = np.zeros(place.shape)
    for _ in range(_STEPS):
        aim = aim + step * stop_rays(lens, place, aim, wavelength).stop
    return stop_rays(lens, place, aim, wavelength)
