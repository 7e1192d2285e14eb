"""The thin lens: no thickness, no aberrations, every point images to a point."""

import math
from dataclasses import dataclass

from bokehnet.checks import Array
from bokehnet.errors import LensError
from bokehnet.lenses.base import Rays
from bokehnet.optics.coc import coc_radius

__all__ = ["ThinLens"]


@dataclass(frozen=True, kw_only=True, slots=True)
class ThinLens:
    """An ideal lens in the plane z = 0; the scene lies at z > 0. Lengths in millimetres.

    Attributes:
        focal_length: Focal length, mm.
        f_number: Focal length over pupil diameter.
        focus_distance: Depth that images sharply, mm, measured from the lens; may be infinite.

    Raises:
        LensError: The lens cannot focus there, or its pupil has no area.
    """

    focal_length: float
    f_number: float
    focus_distance: float = math.inf

    def __post_init__(self) -> None:
        if not (math.isfinite(self.focal_length) and self.focus_distance > self.focal_length > 0):
            raise LensError(
                f"need focus distance > focal length > 0, "
                f"got {self.focus_distance:g} mm and {self.focal_length:g} mm"
            )
        if not (math.isfinite(self.f_number) and self.f_number > 0):
            raise LensError(f"need a positive f-number, got {self.f_number:g}")

    @property
    def pupil_radius(self) -> float:
        """Radius of the entrance pupil, mm."""
        return self.focal_length / self.f_number / 2

    @property
    def sensor_distance(self) -> float:
        """Distance from lens to sensor, mm, by the thin-lens equation."""
        return 1 / (1 / self.focal_length - 1 / self.focus_distance)

    def coc_radius(self, disparity: Array) -> Array:
        """Signed blur radius on the sensor, mm, for inverse depth in 1/mm; positive in front of focus."""
        return coc_radius(disparity, 1 / self.focus_distance, self.pupil_radius, self.sensor_distance)

    def sample_rays(self, sensor_xy: Array, pupil_uv: Array) -> Rays:
        """Rays from sensor points (..., 2), mm, through points (..., 2) of the unit disc.

        Source:
            Cook, Porter and Carpenter, "Distributed ray tracing", SIGGRAPH 1984: all rays of one sensor
            point meet where the central ray pierces the focal plane.
        """
        origin = pupil_uv * self.pupil_radius
        return Rays(origin=origin, slope=-sensor_xy / self.sensor_distance - origin / self.focus_distance)
