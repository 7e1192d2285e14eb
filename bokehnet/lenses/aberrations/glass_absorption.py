"""Lengths of rays in the glass of a lens, and the light that the glass absorbs."""

from dataclasses import replace

import numpy as np

from bokehnet.lenses.base import Rays
from bokehnet.lenses.prescription import PrescriptionLens
from bokehnet.lenses.surface_trace import beam_between, pass_surface
from bokehnet.optics.spectral.absorption import internal_transmittance

__all__ = ["absorbed_rays", "glass_paths"]

# Index above which a medium is glass, not air.
_MIN_GLASS_INDEX = 1.2

# Start of the rays before the first surface, mm.
_START_MM = 10.0


def glass_paths(lens: PrescriptionLens, rays: Rays) -> tuple[np.ndarray, np.ndarray]:
    """Return the length of each ray in glass, mm, and the mask of rays that pass, both (N,).

    Args:
        lens: Lens at its design wavelength.
        rays: Rays in front of the lens, origins (N, 2) at z = 0, the entrance pupil, as of ``sample_rays``.
    """
    origin, slope = np.asarray(rays.origin, np.float64), np.asarray(rays.slope, np.float64)
    # z of rays runs from the lens to the scene, t of surfaces from the scene to the sensor.
    pupil = float(lens.paraxial.entrance.position)
    start = min(pupil, 0.0) - _START_MM

    def at(t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        z = pupil - t
        x, y = (origin[:, i] + slope[:, i] * z for i in (0, 1))
        return x, y, np.full(len(origin), t)

    beam = beam_between(at(start - 1), at(start))
    total, inside = np.zeros(len(origin)), False
    position = np.stack(at(start), -1)
    for surface in lens.surfaces:
        beam = pass_surface(surface, beam, 1.0)
        reached = np.stack([np.broadcast_to(part, len(origin)) for part in beam.position], -1)
        if inside:
            total += np.linalg.norm(reached - position, axis=-1)
        position = reached
        if not surface.stop:
            inside = float(np.max(surface.behind)) > _MIN_GLASS_INDEX
    return total, np.asarray(beam.passes)


def absorbed_rays(lens: PrescriptionLens, rays: Rays, reference: float) -> Rays:
    """Return rays whose weights include the absorption of glass.

    Args:
        lens: Lens.
        rays: Rays of :meth:`PrescriptionLens.sample_rays` at one sensor point each, (N,).
        reference: Internal transmittance of 10 mm of its glass, 0 to 1.
    """
    path, _ = glass_paths(lens, rays)
    return replace(rays, weight=rays.weight * internal_transmittance(reference, path))
