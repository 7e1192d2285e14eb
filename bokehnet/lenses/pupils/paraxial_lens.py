"""Principal planes and pupils of a sequence of surfaces, by paraxial imaging and by real rays."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bokehnet.errors import LensError
from bokehnet.lenses.surface_trace import Surface, beam_between, trace
from bokehnet.optics.paraxial import (
    CardinalPoints,
    Pupil,
    RayMatrix,
    cardinal_points,
    entrance_pupil,
    exit_pupil,
)

__all__ = ["ParaxialLens", "paraxial_lens", "traced_focal_length", "traced_pupils"]


@dataclass(frozen=True, kw_only=True, slots=True)
class ParaxialLens:
    """Gaussian optics of a lens; positions ``t`` in mm from the first surface towards the sensor.

    Attributes:
        cardinal: Focal length, principal planes, focal points.
        entrance: Entrance pupil.
        exit: Exit pupil.
        length: Distance from the first to the last surface, mm.
        stop_magnification: Radius of the entrance pupil over that of the stop, signed.
    """

    cardinal: CardinalPoints
    entrance: Pupil
    exit: Pupil
    length: float
    stop_magnification: float


def paraxial_lens(surfaces: Sequence[Surface]) -> ParaxialLens:
    """Return the Gaussian optics of surfaces, by matrices; for one wavelength, or arrays of them.

    Source:
        Hecht, "Optics", 2017, 6.2.
    """
    before = behind = system = RayMatrix()
    stop_radius = 0.0
    place, index = surfaces[0].vertex, surfaces[0].before
    for surface in surfaces:
        gap = (surface.vertex - place) / index
        system, behind = system.travel(gap), behind.travel(gap)
        if surface.stop:
            before, behind, stop_radius = system, RayMatrix(), surface.semi_diameter
        system, behind = system.refract(surface.power), behind.refract(surface.power)
        place, index = surface.vertex, surface.behind
    return ParaxialLens(
        cardinal=cardinal_points(system, place),
        entrance=entrance_pupil(before, stop_radius),
        exit=exit_pupil(behind, place, stop_radius),
        length=place,
        stop_magnification=1 / before.a,
    )


def traced_focal_length(surfaces: Sequence[Surface], height: float) -> float:
    """Return the focal length of a real ray parallel to the axis at ``height``, mm: height over slope."""
    beam = trace(surfaces, beam_between((height, 0.0, -1.0), (height, 0.0, np.float64(0.0))))
    dx, _, dt = beam.direction
    return float(-height * dt / dx)


def traced_pupils(
    surfaces: Sequence[Surface], zone: float = 1.0, chief_slope: float = 0.01
) -> tuple[Pupil, Pupil]:
    """Return entrance and exit pupil by a chief ray and a marginal ray.

    The chief ray starts at the centre of the stop in both directions; the pupils are at the intersections of
    its extended ends with the axis. The marginal ray enters parallel to the axis and passes the rim of the
    stop; its heights in the planes of the pupils are the radii.

    Args:
        surfaces: Surfaces of the lens.
        zone: Fraction of the radius of the stop at which the marginal ray passes; the radii are divided by
            it.
        chief_slope: Slope of the chief ray in the stop.

    Raises:
        LensError: No ray parallel to the axis passes the stop at this zone.

    Source:
        Wu et al., "Rendering realistic spectral bokeh due to lens stops and aberrations", 2013.
    """
    middle = next(i for i, surface in enumerate(surfaces) if surface.stop)
    stop = surfaces[middle]
    positions = []
    for backwards, part in ((True, surfaces[:middle]), (False, surfaces[middle + 1 :])):
        end = stop.vertex + (-1.0 if backwards else 1.0)
        chief = trace(
            part, beam_between((0.0, 0.0, stop.vertex), (np.float64(chief_slope), 0.0, end)), backwards
        )
        (x, _, t), (dx, _, dt) = chief.position, chief.direction
        positions.append(float(t - x * dt / dx))
    stop_height = zone * stop.semi_diameter
    height = stop_height * paraxial_lens(surfaces).stop_magnification
    for _ in range(50):
        ray = beam_between((height, 0.0, -1.0), (height, 0.0, np.float64(0.0)))
        actual_height = float(trace(surfaces[:middle], ray).at(stop.vertex)[0])
        if abs(actual_height - stop_height) < 1e-12 * stop_height:
            break
        height *= stop_height / actual_height
    else:
        raise LensError(f"no ray parallel to the axis passes the stop at {zone:g} of its radius")
    leaving = trace(surfaces, ray)
    return (
        Pupil(position=positions[0], radius=height / zone),
        Pupil(position=positions[1], radius=float(leaving.at(positions[1])[0]) / zone),
    )
