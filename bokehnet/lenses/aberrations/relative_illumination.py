"""Relative illumination of a lens: mechanical and natural vignetting towards the corners."""

import numpy as np

from bokehnet.lenses.base import LensModel
from bokehnet.optics.sampling import disc_from_square, halton

__all__ = ["relative_illumination"]


def relative_illumination(
    lens: LensModel, half_diagonal: float, steps: int = 33, count: int = 2048
) -> np.ndarray:
    """Return the illuminance on the sensor relative to its centre, (steps,), for a uniform scene.

    Mechanical and natural vignetting together: the mean weight of :meth:`LensModel.sample_rays`.

    Args:
        lens: Lens, with focus and iris as set.
        half_diagonal: Distance from the centre of the picture to its corner, mm on the sensor.
        steps: Number of positions, evenly spaced from the centre to the corner.
        count: Number of rays from each position, the same for all.

    Source:
        Kolb, Mitchell and Hanrahan, "A realistic camera model for computer graphics", SIGGRAPH 1995.
    """
    pupil_uv = disc_from_square(np.stack([halton(count, 2), halton(count, 3)], -1))
    radius = np.linspace(0, half_diagonal, steps)
    sensor_xy = np.stack([radius, 0 * radius], -1)[:, None, :]
    weight = lens.sample_rays(*np.broadcast_arrays(sensor_xy, pupil_uv)).weight
    if weight is None:
        return np.ones(steps)
    light = np.asarray(weight, float).mean(-1)
    return np.asarray(light / light[0])
