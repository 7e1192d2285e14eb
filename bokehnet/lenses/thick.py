"""Thick lens: no aberrations, with its own principal planes and pupils."""

import math
from dataclasses import dataclass

from bokehnet.checks import Array
from bokehnet.errors import LensError
from bokehnet.lenses.base import Rays, check_lens_number
from bokehnet.optics.coc import coc_radius
from bokehnet.optics.paraxial import focused_rays, image_points

__all__ = ["ThickLens"]


@dataclass(frozen=True, kw_only=True, slots=True)
class ThickLens:
    """Ideal lens with a separate stop; lengths in millimetres.

    The plane z = 0 is the entrance pupil. Focal length and :attr:`principal_depth` determine all rays in the
    scene; the exit pupil is the image of the entrance pupil, and the gap between the principal planes
    only affects the position of the sensor. With both 0 this is the thin lens.

    Attributes:
        focal_length: Focal length, mm.
        f_number: Focal length over diameter of the entrance pupil.
        focus_distance: Depth z in focus, mm; may be infinite.
        principal_depth: Depth z of the front principal plane, mm; negative if it lies behind the pupil.
        principal_gap: Distance from the front to the rear principal plane, mm towards the sensor.

    Raises:
        LensError: The lens cannot focus at this distance, or its pupil has no area.
    """

    focal_length: float
    f_number: float
    focus_distance: float = math.inf
    principal_depth: float = 0.0
    principal_gap: float = 0.0

    def __post_init__(self) -> None:
        focal_length = check_lens_number("focal_length", self.focal_length)
        f_number = check_lens_number("f_number", self.f_number)
        focus_distance = check_lens_number("focus_distance", self.focus_distance)
        principal_depth = check_lens_number("principal_depth", self.principal_depth, finite=True)
        check_lens_number("principal_gap", self.principal_gap, finite=True)
        if not 0 < focal_length < math.inf:
            raise LensError(f"need a focal length above 0, got {focal_length:g} mm", "focal_length")
        if not 0 < f_number < math.inf:
            raise LensError(f"need a positive f-number, got {f_number:g}", "f_number")
        nearest = max(principal_depth + focal_length, 0.0)
        if not focus_distance > nearest:
            raise LensError(
                f"cannot focus at {focus_distance:g} mm: need more than {nearest:g} mm, "
                f"the front focal point counted from the entrance pupil",
                parameter="focus_distance",
            )

    @property
    def pupil_radius(self) -> float:
        """Radius of the entrance pupil, mm."""
        return self.focal_length / self.f_number / 2

    @property
    def image_distance(self) -> float:
        """Distance from the rear principal plane to the sensor, mm."""
        return 1 / (1 / self.focal_length - 1 / (self.focus_distance - self.principal_depth))

    @property
    def sensor_distance(self) -> float:
        """Distance from lens to sensor of the thin lens with the same picture and blur, mm.

        A thin lens in z = 0 images the focal plane at the scale s' / z_f; this lens at v / (z_f - P).
        The form used here also holds for infinite focus.
        """
        image_distance = self.image_distance
        return image_distance + self.principal_depth * (image_distance / self.focal_length - 1)

    @property
    def exit_pupil_distance(self) -> float:
        """Distance from the exit pupil to the sensor, mm."""
        return self.image_distance - self.principal_depth * self.exit_magnification

    @property
    def exit_magnification(self) -> float:
        """Size of the exit pupil over that of the entrance pupil."""
        return self.focal_length / (self.focal_length + self.principal_depth)

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
        """Return rays from sensor points through the pupil, as :class:`LensModel`; ignores ``wavelength``."""
        origin = pupil_uv * self.pupil_radius
        distance: Array = self.image_distance
        if sensor_offset is not None:
            distance = distance + sensor_offset
            distance = distance if isinstance(distance, int | float) else distance[..., None]
        slope = focused_rays(sensor_xy, origin, self.focal_length, self.principal_depth, distance)
        return Rays(origin=origin, slope=slope)

    def image_of(self, points: Array) -> tuple[Array, Array]:
        """Return the images of points of the scene.

        Args:
            points: Points of the scene, mm, (..., 3).

        Returns:
            Image xy, mm, (..., 2), and its distance behind the sensor plane, mm, (...,).
        """
        xy, distance = image_points(points, self.focal_length, self.principal_depth)
        return xy, distance - self.image_distance
