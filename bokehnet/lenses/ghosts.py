"""Ghosts: light that two surfaces of a lens reflect before it reaches the sensor.

A lamp sends a beam through the front element. Every pair of surfaces sends a little of it back and forth
once; where that falls, a bundle of rays tells, traced through the prescription.

Source:
    Hullin, Eisemann, Seidel and Lee, "Physically-based real-time lens flare rendering", SIGGRAPH 2011.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from bokehnet.lenses.prescription import PrescriptionLens
from bokehnet.lenses.stop_rays import chief_rays
from bokehnet.lenses.surface_trace import Beam, Met, Surface, meet, pass_surface
from bokehnet.optics.spectral.coating import Coating, reflectance

__all__ = ["Ghost", "trace_ghosts"]

# Rays start in a plane so many semi-diameters in front of the first surface, and span so many of it.
_BEFORE, _SPAN = 2.0, 1.08
_LOST = 1e6


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Ghost:
    """What one pair of surfaces makes of a lamp.

    Attributes:
        surfaces: Numbers of the two, the one that is met last first.
        place: Where rays of the grid fall, mm in the picture, right and down, (n, n, 2).
        fill: Their largest height over semi-diameter at any surface or the stop, (n, n); above 1 is clipped.
        flux: Light of each ray over that of the whole picture of the lamp, (n, n), clipped or not.
    """

    surfaces: tuple[int, int]
    place: np.ndarray
    fill: np.ndarray
    flux: np.ndarray

    @property
    def share(self) -> float:
        """Its light over that of the lamp's picture."""
        return float((self.flux * (self.fill <= 1)).sum())


def trace_ghosts(
    lens: PrescriptionLens,
    place: tuple[float, float],
    *,
    wavelength: float | None = None,
    coating: Coating = "single",
    side: int = 32,
) -> Iterator[Ghost]:
    """Yield the ghosts of a far lamp, from all pairs of surfaces.

    Args:
        lens: The lens, as it is focused and stopped down.
        place: Where the lamp's picture is, mm from the middle, right and down.
        wavelength: Nanometres; None is the design wavelength.
        coating: Of all surfaces between glass and air.
        side: Rays along each side of the grid, which spans the first surface.
    """
    light = lens.prescription.design_wavelength if wavelength is None else wavelength
    surfaces = lens.surfaces_at(wavelength)
    slope = chief_rays(lens, np.array(place), wavelength).slope
    start = _start(surfaces[0], slope, side)
    how = (light, coating)
    direct, power = start, np.ones((side, side))
    beams = []  # in front of each surface
    for surface in surfaces:
        crossing = _cross(surface, direct, 1.0, *how)
        beams.append((direct, power, crossing))
        direct, power = _pass(surface, direct, power, 1.0, crossing)
    whole = (power * direct.passes).sum()
    for far in range(1, len(surfaces)):
        arriving, arrived, crossing = beams[far]
        if crossing is None:
            continue
        back, power = _reflect(surfaces[far], arriving, arrived, 1.0, crossing)
        for near in range(far - 1, -1, -1):
            crossing = _cross(surfaces[near], back, -1.0, *how)
            if crossing is not None:
                beam, left = _reflect(surfaces[near], back, power, -1.0, crossing)
                for surface in surfaces[near + 1 :]:
                    beam, left = _pass(surface, beam, left, 1.0, _cross(surface, beam, 1.0, *how))
                x, y = beam.at(lens.sensor_position)
                yield Ghost(
                    surfaces=(near, far),
                    place=-np.stack([x, y], -1),
                    fill=np.maximum(beam.fill, beam.stop_fill),
                    flux=left / max(whole, 1e-300),
                )
            back, power = _pass(surfaces[near], back, power, -1.0, crossing)


def _start(first: Surface, slope: np.ndarray, side: int) -> Beam:
    """Parallel rays through a square grid over the first surface."""
    axis = ((np.arange(side) + 0.5) * (2 / side) - 1) * (_SPAN * float(first.semi_diameter))
    x, y = np.meshgrid(axis, axis)
    length = np.sqrt(1 + (slope**2).sum())
    direction = tuple(np.full_like(x, value / length) for value in (-slope[0], -slope[1], 1.0))
    back = -_BEFORE * float(first.semi_diameter)
    position = (x - slope[0] * back, y - slope[1] * back, np.full_like(x, first.vertex + back))
    nothing = np.zeros_like(x)
    return Beam(position=position, direction=direction, fill=nothing, stop_fill=nothing)  # type: ignore[arg-type]


def _reflects(surface: Surface) -> bool:
    return not surface.stop and bool(np.any(np.asarray(surface.before) != surface.behind))


@dataclass(frozen=True, slots=True, eq=False)
class _Crossing:
    """Rays at a surface between two media: what they meet, unit normals, and the share that is reflected."""

    met: Met
    normal: tuple[np.ndarray, ...]
    share: np.ndarray


def _cross(
    surface: Surface, beam: Beam, sign: float, wavelength: float, coating: Coating
) -> _Crossing | None:
    """The crossing, or None where nothing is reflected."""
    if not _reflects(surface):
        return None
    met = meet(surface, beam, sign)
    length = np.sqrt(sum(part * part for part in met[1]))
    normal = tuple(part / length for part in met[1])
    cosine = np.clip(abs(sum(a * b for a, b in zip(beam.direction, normal, strict=True))), 0, 1)
    sides = (float(surface.before), float(surface.behind))
    before, behind = sides if sign > 0 else sides[::-1]
    return _Crossing(met, normal, reflectance(before, behind, cosine, wavelength, coating))


def _pass(
    surface: Surface, beam: Beam, power: np.ndarray, sign: float, crossing: _Crossing | None
) -> tuple[Beam, np.ndarray]:
    """Rays behind a surface, and the light that they keep."""
    if crossing is None:
        return pass_surface(surface, beam, sign), power
    return pass_surface(surface, beam, sign, crossing.met), power * (1 - crossing.share)


def _reflect(
    surface: Surface, beam: Beam, power: np.ndarray, sign: float, crossing: _Crossing
) -> tuple[Beam, np.ndarray]:
    """Rays that a surface sends back, and their light."""
    point, _, hits = crossing.met
    along = sum(a * b for a, b in zip(beam.direction, crossing.normal, strict=True))
    direction = tuple(d - 2 * along * n for d, n in zip(beam.direction, crossing.normal, strict=True))
    height = np.hypot(point[0], point[1]) / surface.semi_diameter
    fill = np.where(hits & (sign * direction[2] < 0), np.maximum(beam.fill, height), _LOST)
    turned = Beam(position=point, direction=direction, fill=fill, stop_fill=beam.stop_fill)  # type: ignore[arg-type]
    return turned, power * crossing.share
