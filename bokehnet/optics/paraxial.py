"""Gaussian optics: paraxial rays as matrices, and the cardinal points and pupils of a lens.

A ray is (y, n u): height in mm, slope times refractive index. ``t`` is the position along the axis, mm,
positive in the direction of light, from the scene to the sensor. Elements may be numbers, arrays or tensors,
for example one per wavelength.
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
    """Ray transfer matrix of (y, n u): ``y' = a y + b n u``, ``n' u' = c y + d n u``; ad - bc = 1."""

    a: Array = 1.0
    b: Array = 0.0
    c: Array = 0.0
    d: Array = 1.0

    def refract(self, power: Array) -> "RayMatrix":
        """Return the matrix followed by a surface of ``power`` (n' - n) / radius, 1/mm."""
        return RayMatrix(self.a, self.b, self.c - power * self.a, self.d - power * self.b)

    def travel(self, reduced: Array) -> "RayMatrix":
        """Return the matrix followed by a gap of ``reduced`` length, mm over index."""
        return RayMatrix(self.a + reduced * self.c, self.b + reduced * self.d, self.c, self.d)


@dataclass(frozen=True, kw_only=True, slots=True)
class CardinalPoints:
    """Focal length, principal planes and focal points of a lens in air.

    Positions are ``t``, mm from the first surface towards the sensor.

    Attributes:
        focal_length: Effective focal length, mm.
        front_principal: Position of the front principal plane, mm.
        rear_principal: Position of the rear principal plane, mm.
        front_focus: Position of the front focal point, mm.
        rear_focus: Position of the rear focal point, mm.
    """

    focal_length: Array
    front_principal: Array
    rear_principal: Array
    front_focus: Array
    rear_focus: Array


@dataclass(frozen=True, kw_only=True, slots=True)
class Pupil:
    """Image of the aperture stop. A negative radius means that the image is inverted.

    Attributes:
        position: Position ``t``, mm.
        radius: Signed radius, mm.
    """

    position: Array
    radius: Array


def cardinal_points(system: RayMatrix, length: Array) -> CardinalPoints:
    """Return the cardinal points of a lens in air.

    Args:
        system: Matrix from the first to the last surface.
        length: Distance between these surfaces, mm.

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
    """Return the image of the stop through the elements in front of it.

    A ray (y, u) in front of the lens meets the stop at ``a y + b u``: a ray to the centre of the stop crosses
    the axis at ``t = b / a``, and a ray parallel to the axis meets the rim at the height ``stop_radius / a``.

    Args:
        before: Matrix from the first surface to the stop.
        stop_radius: Radius of the stop, mm.
    """
    return Pupil(position=before.b / before.a, radius=stop_radius / before.a)


def exit_pupil(behind: RayMatrix, length: Array, stop_radius: Array) -> Pupil:
    """Return the image of the stop through the elements behind it.

    A ray from the centre of the stop leaves at height ``b w`` with slope ``d w``, as if from ``b / d`` in
    front of the last surface, where the rim of the stop appears at ``(ad - bc) / d`` of its radius.

    Args:
        behind: Matrix from the stop to the last surface.
        length: Position of the last surface, mm.
        stop_radius: Radius of the stop, mm.
    """
    return Pupil(position=length - behind.b / behind.d, radius=stop_radius / behind.d)


def focused_rays(
    sensor_xy: Array,
    origin: Array,
    focal_length: Array,
    principal_depth: Array,
    image_distance: Array,
) -> Array:
    """Return the slopes in the scene of rays from a sensor point through the pupil of a perfect lens.

    With P the principal depth and v the image distance, the conjugate of the sensor lies s in front of
    the principal plane, ``1 / s = 1 / f - 1 / v``, hence at the depth z = s + P. The lens images a sensor
    point to ``-xy s / v`` in that plane. Divided by z, ``s / (v z)`` becomes ``1 / (v + P v / s)``, where
    ``v / s = v / f - 1``; and ``1 / z = (1 / s) / (1 + P / s)`` also holds for infinite s.

    Args:
        sensor_xy: Points on the sensor, mm, (..., 2).
        origin: Points of the entrance pupil, the plane z = 0 of the scene, mm, (..., 2).
        focal_length: Focal length, mm.
        principal_depth: Depth z of the front principal plane, mm; 0 in a thin lens.
        image_distance: Distance from the rear principal plane to the sensor point, mm, a number or (..., 1).

    Returns:
        Lateral displacement per unit of depth, (..., 2).
    """
    vergence = 1 / focal_length - 1 / image_distance
    scale = image_distance + principal_depth * (image_distance / focal_length - 1)
    return -sensor_xy / scale - origin * (vergence / (1 + principal_depth * vergence))


def image_points(points: Array, focal_length: Array, principal_depth: Array) -> tuple[Array, Array]:
    """Return the images of scene points by a perfect lens.

    Args:
        points: Points of the scene, mm, (..., 3); z counts from the entrance pupil.
        focal_length: Focal length, mm.
        principal_depth: Depth z of the front principal plane, mm.

    Returns:
        Position xy of the image, mm, (..., 2), and its distance from the rear principal plane, mm, (...,).
    """
    vergence = 1 / (points[..., 2] - principal_depth)
    image_distance = 1 / (1 / focal_length - vergence)
    return -points[..., :2] * (image_distance * vergence)[..., None], image_distance
