"""Aperture coordinates of uniform irradiance: equal areas of the unit disc send equal light to the sensor.

Points of the stop do not. Seen from the sensor the rim of the stop is denser or thinner than its centre,
and off the axis one side is denser than the other, by a tenth or two for fast lenses. Renderers distribute
their rays uniformly over the aperture, so the coordinates are chosen to make this correct. The rim
of the stop stays on the unit circle.
"""

from dataclasses import dataclass

import numpy as np

from bokehnet.checks import Array
from bokehnet.errors import LensError
from bokehnet.lenses.stop_rays import StopRays

__all__ = ["UniformIrradiancePupil", "fit_uniform_irradiance_pupil"]

# Relative height up to which rays are used for the fit; clipped rays near the rim are included.
_HEIGHT_RESERVE = 1.05


@dataclass(frozen=True, kw_only=True, slots=True)
class UniformIrradiancePupil:
    """Mapping from points b of the stop to coordinates a.

    On the axis the light through the zone up to |b| is the squared sine of its angle at the sensor, so
    ``|a|^2 = radial(|b|^2)``. Off the axis the light of these coordinates is 1 + tilt a.h; a displacement by
    the gradient of ``tilt (a.h) (a.a - 3) / 8``, which has this divergence and is tangential on the unit
    circle, makes it uniform, up to tilt^2.

    Attributes:
        radial: Coefficients of x, x^2, x^3; they sum to 1.
        tilt: Change of the light along the field, per unit of both.
    """

    radial: tuple[float, float, float]
    tilt: float

    def __call__(self, stop: Array, field: Array) -> Array:
        """Return coordinates a, (..., 2), of points of the stop (..., 2), for field positions h, (..., 2)."""
        return _aperture_coordinates(stop, field, self.radial, self.tilt)


def _aperture_coordinates(
    stop: Array, field: Array, radial: tuple[float, float, float], tilt: float
) -> Array:
    square = (stop * stop).sum(-1)[..., None]
    growth = radial[0] + square * (radial[1] + square * radial[2])
    # Far beyond the rim, where rays are unused, the polynomial may fall below 0.
    a = stop * (growth * (growth > 0)) ** 0.5
    aa, ah = (a * a).sum(-1)[..., None], (a * field).sum(-1)[..., None]
    return a + tilt / 8 * (field * (aa - 3) + 2 * a * ah)


def fit_uniform_irradiance_pupil(
    rays: StopRays, aim: np.ndarray, field: np.ndarray
) -> UniformIrradiancePupil:
    """Return the coordinates fitted to traced rays.

    Args:
        rays: Rays of a grid (fields, n, n); the first field is on the axis.
        aim: Aim points in the exit pupil, mm, (fields, n, n, 2).
        field: Field positions h, (fields, n, n, 2).

    Raises:
        LensError: Light does not increase with the radius in the stop, for example if hardly any ray meets
            glass.

    Source:
        Etendue: the irradiance at the sensor is the integral of the radiance over the products of the
        direction's cosines, Born and Wolf, "Principles of optics", 1999, 4.8.
    """
    used = rays.heights.max(axis=0) < _HEIGHT_RESERVE
    square = (rays.stop[0] ** 2).sum(-1)[used[0]]
    sine2 = (rays.sensor_slope[:2, 0] ** 2).sum(0)[used[0]]
    powers = np.stack([square, square**2, square**3], -1)
    coefficients = np.linalg.lstsq(powers, sine2, rcond=None)[0]
    one, two, three = (float(number) for number in coefficients / coefficients.sum())
    radial = (one, two, three)
    a = _aperture_coordinates(rays.stop, field, radial, 0.0)
    area = _area(a)
    if not area[used].all():
        raise LensError("rays through its stop miss a surface or cross; stop down or use a smaller field")
    # Cosines at the sensor change by cos^4 / distance^2 times the change of the aim point.
    light = rays.sensor_slope[2] ** 4 * np.abs(
        np.divide(_area(aim), area, out=np.zeros_like(area), where=used)
    )
    above = below = 0.0
    for i in range(1, len(field)):
        inside = used[i]
        if inside.sum() < 20:  # too few rays
            continue
        along = (a[i] * field[i]).sum(-1)[inside]
        line = np.stack([np.ones_like(along), along], -1)
        level, growth = np.linalg.lstsq(line, light[i][inside], rcond=None)[0]
        weight = (field[i, 0, 0] ** 2).sum()
        above, below = above + weight * growth / level, below + weight
    return UniformIrradiancePupil(radial=radial, tilt=float(above / below) if below else 0.0)


def _area(points: np.ndarray) -> np.ndarray:
    """Return the signed area of the cells of a grid (fields, n, n, 2)."""
    down, right = np.gradient(points, axis=1), np.gradient(points, axis=2)
    return np.asarray(down[..., 0] * right[..., 1] - down[..., 1] * right[..., 0])
