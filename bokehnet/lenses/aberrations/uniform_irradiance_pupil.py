"""Aperture coordinates that are evenly lit: equal areas of the unit disc send equal light to the sensor.

Places in the stop are not. Seen from the sensor the stop's rim looks denser or thinner than its middle,
and away from the axis one side denser than the other, by a tenth or two for fast lenses. Renderers spread
their rays evenly over the aperture, so coordinates are chosen in which that is right. They leave the rim
of the stop where it is, on the unit circle.
"""

from dataclasses import dataclass

import numpy as np

from bokehnet.checks import Array
from bokehnet.errors import LensError
from bokehnet.lenses.stop_rays import StopRays

__all__ = ["UniformIrradiancePupil", "fit_uniform_irradiance_pupil"]

# Rays count for the fit while they pass, and a little beyond.
_RESERVE = 1.05


@dataclass(frozen=True, kw_only=True, slots=True)
class UniformIrradiancePupil:
    """From places b in the stop to coordinates a.

    On the axis the light through the zone up to |b| is the squared sine of its angle at the sensor, so
    ``|a|^2 = radial(|b|^2)``. Away from it the light of these coordinates is 1 + tilt a.h; moving them by the
    gradient of ``tilt (a.h) (a.a - 3) / 8``, whose divergence is that and which has no part across the unit
    circle, makes it even, but for tilt^2.

    Attributes:
        radial: Coefficients of x, x^2, x^3; they sum to 1.
        tilt: Growth of the light along the field, per unit of both.
    """

    radial: tuple[float, float, float]
    tilt: float

    def __call__(self, stop: Array, field: Array) -> Array:
        """Coordinates a, (..., 2), of places in the stop (..., 2), for field positions h, (..., 2)."""
        return _even(stop, field, self.radial, self.tilt)


def _even(stop: Array, field: Array, radial: tuple[float, float, float], tilt: float) -> Array:
    square = (stop * stop).sum(-1)[..., None]
    growth = radial[0] + square * (radial[1] + square * radial[2])
    # Far beyond the rim, where rays are of no use, the polynomial may fall below 0.
    a = stop * (growth * (growth > 0)) ** 0.5
    aa, ah = (a * a).sum(-1)[..., None], (a * field).sum(-1)[..., None]
    return a + tilt / 8 * (field * (aa - 3) + 2 * a * ah)


def fit_uniform_irradiance_pupil(
    rays: StopRays, aim: np.ndarray, field: np.ndarray
) -> UniformIrradiancePupil:
    """Find the coordinates from traced rays.

    Args:
        rays: Of a grid (fields, n, n); the first field is on the axis.
        aim: Where they were aimed at in the exit pupil, mm, (fields, n, n, 2).
        field: Field positions h, (fields, n, n, 2).

    Raises:
        LensError: Light does not grow with the radius in the stop, as where hardly any ray meets glass.

    Source:
        Etendue: the irradiance at the sensor is the integral of the radiance over the products of the
        direction's cosines, Born and Wolf, "Principles of optics", 1999, 4.8.
    """
    used = rays.heights.max(axis=0) < _RESERVE
    square = (rays.stop[0] ** 2).sum(-1)[used[0]]
    sine2 = (rays.sensor_slope[:2, 0] ** 2).sum(0)[used[0]]
    powers = np.stack([square, square**2, square**3], -1)
    found = np.linalg.lstsq(powers, sine2, rcond=None)[0]
    one, two, three = (float(number) for number in found / found.sum())
    radial = (one, two, three)
    a = _even(rays.stop, field, radial, 0.0)
    area = _area(a)
    if not area[used].all():
        raise LensError("rays through its stop miss a surface or cross; stop down or use a smaller field")
    # Cosines at the sensor change by cos^4 / distance^2 of what the aim does.
    light = rays.sensor_slope[2] ** 4 * np.abs(
        np.divide(_area(aim), area, out=np.zeros_like(area), where=used)
    )
    above = below = 0.0
    for i in range(1, len(field)):
        inside = used[i]
        if inside.sum() < 20:  # dark
            continue
        along = (a[i] * field[i]).sum(-1)[inside]
        line = np.stack([np.ones_like(along), along], -1)
        level, growth = np.linalg.lstsq(line, light[i][inside], rcond=None)[0]
        weight = (field[i, 0, 0] ** 2).sum()
        above, below = above + weight * growth / level, below + weight
    return UniformIrradiancePupil(radial=radial, tilt=float(above / below) if below else 0.0)


def _area(points: np.ndarray) -> np.ndarray:
    """Area of the cells of a grid (fields, n, n, 2), signed."""
    down, right = np.gradient(points, axis=1), np.gradient(points, axis=2)
    return np.asarray(down[..., 0] * right[..., 1] - down[..., 1] * right[..., 0])
