"""Fraction of the sampled rays that pass a lens."""

import numpy as np

from bokehnet.lenses.base import LensModel
from bokehnet.optics.sampling import disc_from_square, halton

__all__ = ["unvignetted_fraction"]


def unvignetted_fraction(lens: LensModel, sensor_radius: float, count: int = 4096) -> float:
    """Return the fraction of rays with a weight above 0.

    Args:
        lens: Any lens.
        sensor_radius: Distance of the sensor point from the axis, mm.
        count: Number of rays, uniform over the unit disc.
    """
    pupil_uv = disc_from_square(np.stack([halton(count, 2), halton(count, 3)], -1))
    rays = lens.sample_rays(np.tile([sensor_radius, 0.0], (count, 1)), pupil_uv)
    return 1.0 if rays.weight is None else float((rays.weight > 0).mean())
