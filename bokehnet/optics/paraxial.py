"""Gaussian optics: rays near the axis, as matrices, and the points of a lens that follow from them.

A ray is (y, n u): height in mm, slope times refractive index. ``t`` is the place along the axis, mm, positive
in the direction of light, from the scene to the sensor. Elements may be numbers, arrays or tensors, for
example one per wavelength.
"""

from dataclasses import dataclass

from bokehnet.checks import Array

__all__ = [
    "CardinalPoints",
    "Pupil",
    "RayMatrix",
    "cardinal_points",
    "entrance_pupil",
    "exit_pupil",
    "focused_rays",
    "image_points",
]


@dataclass(frozen=True, slots=True)
class RayMatrix:
    """What happens to (y, n u) on the way: ``y' = a y + b n u``, ``n' u' = c y + d n u``; ad - bc = 1."""

    a: Array = 1.0
    b: Array = 0.0
    c: Array = 0.0
    d: Array = 1.0

    def refract(self, power: Array) -> "RayMatrix":
        """Add a surface of ``power`` (n' - n) / radius, 1/mm, behind."""
        return RayMatrix(self.a, self.b, self.c - power * self.a, self.d - power * self.b)

    def travel(self, reduced: Array) -> "RayMatrix":
        """Add a gap of ``reduced`` length, mm over index, behind."""
        return RayMatrix(self.a + reduced * self.c, self.b + reduced * self.d, self.c, self.d)


@dataclass(frozen=True, kw_only=True, slots=True)
class CardinalPoints:
    """Where a lens in air focuses; places are ``t``, mm from the first surface towards the sensor.

    Attributes:
        focal_length: Effective focal length.
        front_principal: Front principal plane.
        rear_principal: Rear principal plane.
        front_focus: Front focal point.
        rear_focus: Rear focal point.
    """

    focal_length: Array
    front_principal: Array
    rear_principal: Array
    front_focus: Array
    rear_focus: Array


@dataclass(frozen=True, kw_only=True, slots=True)
class Pupil:
    """Image of the aperture stop. A negative radius means that it is upside down.

    Attributes:
        position: Place ``t``, mm.
        radius: Radius, mm, signed.
    """

    position: Array
    radius: Array


def cardinal_points(system: RayMatrix, length: Array) -> CardinalPoints:
    """Cardinal points of a lens in air.

    Args:
        system: From the first to the last surface.
        length: Distance between them, mm.

    Source:
        Hecht, "Optics", 2017, 6.2. The transfer matrix printed in some texts with ``-d / n`` has the
        wrong sign.
    """
    focal_length = -1 / system.c
    return CardinalPoints(
        focal_length=focal_length,
        front_principal=(1 - system.d) * focal_length,
        rear_principal=length + (system.a - 1) * focal_length,
        front_focus=-system.d * focal_length,
        rear_focus=length + system.a * focal_length,
    )


def entrance_pupil(before: RayMatrix, stop_radius: Array) -> Pupil:
    """Image of the stop through what is in front of it.

    Args:
        before: From the first surface to the stop.
        stop_radius: Radius of the stop, mm.

    A ray (y, u) in front meets the stop at ``a y + b u``: aimed at its middle it crosses the axis at
    ``t = b / a``, and parallel to the axis it meets its rim when it comes at ``stop_radius / a``.
    """
    return Pupil(position=before.b / before.a, radius=stop_radius / before.a)


def exit_pupil(behind: RayMatrix, length: Array, stop_radius: Array) -> Pupil:
    """Image of the stop through what is behind it.

    Args:
        behind: From the stop to the last surface.
        length: Place of the last surface, mm.
        stop_radius: Radius of the stop, mm.

    A ray from the middle of the stop leaves at height ``b w`` with slope ``d w``, as if from ``b / d`` in
    front of the last surface, where the rim of the stop appears at ``(ad - bc) / d`` of its radius.
    """
    return Pupil(position=length - behind.b / behind.d, radius=stop_radius / behind.d)


def focused_rays(
    sensor_xy: Array,
    origin: Array,
    focal_length: Array,
    principal_depth: Array,
    image_distance: Array,
) -> Array:
    """Slopes into the scene of the rays that a perfect lens sends from a sensor point through its pupil.

    Args:
        sensor_xy: Points on the sensor, mm, (..., 2).
        origin: Where the rays cross the entrance pupil, which is the plane z = 0 of the scene, mm, (..., 2).
        focal_length: mm.
        principal_depth: Depth z of the front principal plane, mm; 0 in a thin lens.
        image_distance: From the rear principal plane to the sensor point, mm, a number or (..., 1).

    Returns:
        Lateral travel per unit of depth, (..., 2).

    With P the principal depth and v the image distance, the conjugate of the sensor lies s in front of
    the principal plane, ``1 / s = 1 / f - 1 / v``, hence at the depth z = s + P. A sensor point is imaged
    there at ``-xy s / v``. Divided by z, ``s / (v z)`` becomes ``1 / (v + P v / s)``, where
    ``v / s = v / f - 1``; and ``1 / z = (1 / s) / (1 + P / s)`` holds for s at infinity, too.
    """
    vergence = 1 / focal_length - 1 / image_distance
    scale = image_distance + principal_depth * (image_distance / focal_length - 1)
    return -sensor_xy / scale - origin * (vergence / (1 + principal_depth * vergence))


def image_points(points: Array, focal_length: Array, principal_depth: Array) -> tuple[Array, Array]:
    """Where a perfect lens images points of the scene.

    Args:
        points: (..., 3), mm; z counts from the entrance pupil.
        focal_length: mm.
        principal_depth: Depth z of the front principal plane, mm.

    Returns:
        Place xy of the image, mm, (..., 2), and its distance from the rear principal plane, mm, (...,).
    """
    vergence = 1 / (points[..., 2] - principal_depth)
    image_distance = 1 / (1 / focal_length - vergence)
    return -points[..., :2] * (image_distance * vergence)[..., None], image_distance
