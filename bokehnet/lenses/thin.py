"""Thin lens: no thickness and no aberrations; every point has a point image."""

import math
from dataclasses import dataclass

from bokehnet.checks import Array
from bokehnet.errors import LensError
from bokehnet.lenses.base import Rays, check_lens_number
from bokehnet.optics.coc import coc_radius
from bokehnet.optics.paraxial import focused_rays, image_points

__all__ = ["ThinLens"]


@dataclass(frozen=True, kw_only=True, slots=True)
class ThinLens:
    """Ideal lens in the plane z = 0; the scene lies at z > 0. Lengths in millimetres.

    Attributes:
        focal_length: Focal length, mm.
        f_number: Focal length over pupil diameter.
        focus_distance: Depth in focus, mm, measured from the lens; may be infinite.

    Raises:
        LensError: The lens cannot focus at this distance, or its pupil has no area.
    """

    focal_length: float
    f_number: float
    focus_distance: float = math.inf

    def __post_init__(self) -> None:
        focal_length = check_lens_number("focal_length", self.focal_length)
        f_number = check_lens_number("f_number", self.f_number)
        focus_distance = check_lens_number("focus_distance", self.focus_distance)
        if not (math.isfinite(focal_length) and focus_distance > focal_length > 0):
            raise LensError(
                f"need focus distance > focal length > 0, got {focus_distance:g} mm and {focal_length:g} mm",
                parameter="focus_distance" if 0 < focal_length < math.inf else "focal_length",
            )
        if not (math.isfinite(f_number) and f_number > 0):
            raise LensError(f"need a positive f-number, got {f_number:g}", parameter="f_number")

    @property
    def pupil_radius(self) -> float:
        """Radius of the entrance pupil, mm."""
        return self.focal_length / self.f_number / 2

    @property
    def sensor_distance(self) -> float:
        """Distance from lens to sensor, mm, by the thin-lens equation."""
        return 1 / (1 / self.focal_length - 1 / self.focus_distance)

    def coc_radius(self, disparity: Array) -> Array:
        """Return the signed blur radius on the sensor, mm; positive in front of focus; disparity in 1/mm."""
        return coc_radius(disparity, 1 / self.focus_distance, self.pupil_radius, self.sensor_distance)

    def sample_rays(
        self,
        sensor_xy: Array,
        pupil_uv: Array,
        wavelength: Array | None = None,
        sensor_offset: Array | None = None,
    ) -> Rays:
        """Return rays from sensor points (..., 2), mm, through points (..., 2) of the unit disc.

        Args:
            sensor_xy: Points of the sensor, mm, (..., 2).
            pupil_uv: Points of the unit disc, (..., 2).
            wavelength: Ignored; a thin lens has no dispersion.
            sensor_offset: Distance of each point behind the sensor plane, mm; None is 0.

        Source:
            Cook, Porter and Carpenter, "Distributed ray tracing", SIGGRAPH 1984: all rays of one sensor
            point intersect in the focal plane, on the central ray.
        """
        origin = pupil_uv * self.pupil_radius
        if sensor_offset is None:
            return Rays(origin=origin, slope=-sensor_xy / self.sensor_distance - origin / self.focus_distance)
        distance = self.sensor_distance + sensor_offset
        distance = distance if isinstance(distance, int | float) else distance[..., None]
        return Rays(origin=origin, slope=focused_rays(sensor_xy, origin, self.focal_length, 0.0, distance))

    def image_of(self, points: Array) -> tuple[Array, Array]:
        """Return the images of points (..., 3), mm: xy (..., 2), and mm behind the sensor (...,)."""
        xy, distance = image_points(points, self.focal_length, 0.0)
        return xy, distance - self.sensor_distance
