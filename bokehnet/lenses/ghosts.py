"""Ghosts: light reflected by two surfaces of a lens before it reaches the sensor.

A lamp sends a beam through the front element. Every pair of surfaces reflects a small fraction of it back and
forth once; a bundle of rays, traced through the prescription, gives its distribution on the sensor.

Source:
    Hullin, Eisemann, Seidel and Lee, "Physically-based real-time lens flare rendering", SIGGRAPH 2011.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from bokehnet.lenses.prescription import PrescriptionLens
from bokehnet.lenses.stop_rays import chief_rays
from bokehnet.lenses.surface_trace import Beam, Intersection, Surface, intersect, pass_surface
from bokehnet.optics.spectral.coating import Coating, reflectance

__all__ = ["Ghost", "trace_ghosts"]

# Distance of the start plane in front of the first surface, and half-width of the grid, in semi-diameters.
_START_DISTANCE, _HALF_WIDTH = 2.0, 1.08
# Relative height that marks rays that a surface cannot pass on.
_LOST = 1e6


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Ghost:
    """Ghost of a lamp by one pair of surfaces.

    Attributes:
        surfaces: Indices of the two surfaces, that of the second reflection first.
        place: Arrival points of a grid of rays, mm in the picture, right and down, (n, n, 2).
        fill: Largest height over semi-diameter at any surface or the stop, (n, n); above 1 is clipped.
        flux: Light of each ray over that of the whole image of the lamp, (n, n), clipped or not.
    """

    surfaces: tuple[int, int]
    place: np.ndarray
    fill: np.ndarray
    flux: np.ndarray

    @property
    def relative_flux(self) -> float:
        """Light of the ghost over that of the image of the lamp."""
        return float((self.flux * (self.fill <= 1)).sum())


def trace_ghosts(
    lens: PrescriptionLens,
    place: tuple[float, float],
    *,
    wavelength: float | None = None,
    coating: Coating = "single",
    side: int = 32,
) -> Iterator[Ghost]:
    """Yield the ghosts of a distant lamp, from all pairs of surfaces.

    Args:
        lens: Lens, with its focus and iris as set.
        place: Image of the lamp, mm from the centre of the picture, right and down.
        wavelength: Wavelength, nm; None is the design wavelength.
        coating: Coating of all surfaces between glass and air.
        side: Number of rays along each side of the grid, which spans the first surface.
    """
    light = lens.prescription.design_wavelength if wavelength is None else wavelength
    surfaces = lens.surfaces_at(wavelength)
    slope = chief_rays(lens, np.array(place), wavelength).slope
    start = _start(surfaces[0], slope, side)
    optics = (light, coating)
    direct, power = start, np.ones((side, side))
    beams = []  # in front of each surface
    for surface in surfaces:
        crossing = _cross(surface, direct, 1.0, *optics)
        beams.append((direct, power, crossing))
        direct, power = _pass(surface, direct, power, 1.0, crossing)
    whole = (power * direct.passes).sum()
    for far in range(1, len(surfaces)):
        incident, incident_power, crossing = beams[far]
        if crossing is None:
            continue
        back, power = _reflect(surfaces[far], incident, incident_power, 1.0, crossing)
        for near in range(far - 1, -1, -1):
            crossing = _cross(surfaces[near], back, -1.0, *optics)
            if crossing is not None:
                beam, remaining = _reflect(surfaces[near], back, power, -1.0, crossing)
                for surface in surfaces[near + 1 :]:
                    beam, remaining = _pass(
                        surface, beam, remaining, 1.0, _cross(surface, beam, 1.0, *optics)
                    )
                x, y = beam.at(lens.sensor_position)
                yield Ghost(
                    surfaces=(near, far),
                    place=-np.stack([x, y], -1),
                    fill=np.maximum(beam.fill, beam.stop_fill),
                    flux=remaining / max(whole, 1e-300),
                )
            back, power = _pass(surfaces[near], back, power, -1.0, crossing)


def _start(first: Surface, slope: np.ndarray, side: int) -> Beam:
    """Return parallel rays through a square grid over the first surface."""
    axis = ((np.arange(side) + 0.5) * (2 / side) - 1) * (_HALF_WIDTH * float(first.semi_diameter))
    x, y = np.meshgrid(axis, axis)
    length = np.sqrt(1 + (slope**2).sum())
    direction = tuple(np.full_like(x, value / length) for value in (-slope[0], -slope[1], 1.0))
    back = -_START_DISTANCE * float(first.semi_diameter)
    position = (x - slope[0] * back, y - slope[1] * back, np.full_like(x, first.vertex + back))
    zeros = np.zeros_like(x)
    return Beam(position=position, direction=direction, fill=zeros, stop_fill=zeros)  # type: ignore[arg-type]


def _reflects(surface: Surface) -> bool:
    return not surface.stop and bool(np.any(np.asarray(surface.before) != surface.behind))


@dataclass(frozen=True, slots=True, eq=False)
class _Crossing:
    """Rays at a surface between two media: intersections, unit normals, and the reflected fraction."""

    intersection: Intersection
    normal: tuple[np.ndarray, ...]
    reflectance: np.ndarray


def _cross(
    surface: Surface, beam: Beam, sign: float, wavelength: float, coating: Coating
) -> _Crossing | None:
    """Return the crossing, or None if the surface reflects nothing."""
    if not _reflects(surface):
        return None
    intersection = intersect(surface, beam, sign)
    length = np.sqrt(sum(part * part for part in intersection[1]))
    normal = tuple(part / length for part in intersection[1])
    cosine = np.clip(abs(sum(a * b for a, b in zip(beam.direction, normal, strict=True))), 0, 1)
    sides = (float(surface.before), float(surface.behind))
    before, behind = sides if sign > 0 else sides[::-1]
    return _Crossing(intersection, normal, reflectance(before, behind, cosine, wavelength, coating))


def _pass(
    surface: Surface, beam: Beam, power: np.ndarray, sign: float, crossing: _Crossing | None
) -> tuple[Beam, np.ndarray]:
    """Return the rays behind a surface, and their remaining light."""
    if crossing is None:
        return pass_surface(surface, beam, sign), power
    return pass_surface(surface, beam, sign, crossing.intersection), power * (1 - crossing.reflectance)


def _reflect(
    surface: Surface, beam: Beam, power: np.ndarray, sign: float, crossing: _Crossing
) -> tuple[Beam, np.ndarray]:
    """Return the rays reflected by a surface, and their light."""
    point, _, hits = crossing.intersection
    along = sum(a * b for a, b in zip(beam.direction, crossing.normal, strict=True))
    direction = tuple(d - 2 * along * n for d, n in zip(beam.direction, crossing.normal, strict=True))
    height = np.hypot(point[0], point[1]) / surface.semi_diameter
    fill = np.where(hits & (sign * direction[2] < 0), np.maximum(beam.fill, height), _LOST)
    reflected = Beam(position=point, direction=direction, fill=fill, stop_fill=beam.stop_fill)  # type: ignore[arg-type]
    return reflected, power * crossing.reflectance
