"""How a lens darkens towards the corners of its picture: what its rims cut off, and how light slants."""

import numpy as np

from bokehnet.lenses.base import LensModel
from bokehnet.optics.sampling import disc_from_square, halton

__all__ = ["relative_illumination"]


def relative_illumination(
    lens: LensModel, half_diagonal: float, steps: int = 33, count: int = 2048
) -> np.ndarray:
    """Return the light on the sensor over that in its middle, (steps,), for an evenly bright scene.

    Mechanical and natural vignetting together: the mean weight of :meth:`LensModel.sample_rays`.

    Args:
        lens: The lens, as it is focused and stopped down.
        half_diagonal: From the middle of the picture to its corner, mm on the sensor.
        steps: Places, evenly from the middle to the corner.
        count: Rays from each place, the same for all.

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
