"""Tilted plane of focus, as of a lens that is tilted relative to its sensor.

Every plane of the scene has an inverse depth that is affine over the picture: with t the slopes of the
viewing directions of the pixels, ``n . (z t, z) = c`` is ``1 / z = n . (t, 1) / c``. So the disparity in
focus is an affine map, and blur stays linear in disparity. Pixel coordinates count from the centre of the
upper left pixel of the shown picture, to the right and down; depth is measured from the pupil along the
sensor normal.

The tilt of a lens is (about the x axis, about the y axis), degrees, with the signs of the sensor tilt of
:class:`bokehnet.lenses.TiltShift`: above 0 the focus is nearer in the upper half, and nearer on the right.

Source: Scheimpflug, British patent 1196, 1904; Merklinger, "Focusing the view camera", 1996, for the hinge.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from bokehnet.checks import Array, array_namespace, check_number, check_numbers, check_rank
from bokehnet.errors import LensError, ParameterError
from bokehnet.optics.aberrations.aberration_map import AberrationMap

__all__ = [
    "MAX_TILT_DEGREES",
    "FocusPlane",
    "check_tilt",
    "distance_to_sensor",
    "plane_aberration_map",
    "plane_defocus",
    "relative_plane",
    "tilted_aberration_map",
    "tilted_lens",
]

# Upper bound of both tilt angles, degrees; also that of a tilted sensor.
MAX_TILT_DEGREES = 80.0

# Iterations of Newton's method: each doubles the correct digits, or halves the error at a double root.
_MAX_ITERATIONS = 60


@dataclass(frozen=True, kw_only=True, slots=True)
class FocusPlane:
    """Disparity in focus as a function of the pixel: ``level + slope . (x, y)``.

    Attributes:
        level: Disparity in focus at the pixel (0, 0), in the unit of the disparity map.
        slope: Change per pixel to the right and down.

    Raises:
        ParameterError: A number is not finite.
    """

    level: float
    slope: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        check_number("level", self.level)
        check_numbers("slope", self.slope, 2)

    @classmethod
    def around(cls, pixel: tuple[float, float], disparity: float, slope: tuple[float, float]) -> "FocusPlane":
        """Return the plane of the given slope that has ``disparity`` in focus at ``pixel``."""
        return cls(level=disparity - slope[0] * pixel[0] - slope[1] * pixel[1], slope=slope)

    @classmethod
    def through(cls, pixels: Array, disparities: Array) -> "FocusPlane":
        """Return the plane that has three disparities (3,) in focus at three pixels (3, 2).

        Raises:
            ParameterError: The pixels lie on one line, so that the plane is not unique or does not exist.
        """
        pixels, disparities = np.asarray(pixels, float), np.asarray(disparities, float)
        edges = pixels[1:] - pixels[0]
        sides = np.linalg.norm([*edges, edges[1] - edges[0]], axis=-1)
        # Height of the triangle over its longest side, pixels.
        if not sides.max() > 0 or abs(np.linalg.det(edges)) < sides.max():
            places = ", ".join(f"{x:g},{y:g}" for x, y in pixels)
            raise ParameterError(
                "pixels", "three pixels off one line, by a pixel or more", pixels.tolist(), shown=places
            )
        slope = np.linalg.solve(edges, disparities[1:] - disparities[0])
        return cls.around(tuple(pixels[0]), float(disparities[0]), (float(slope[0]), float(slope[1])))

    def at(self, x: Array, y: Array) -> Array:
        """Return the disparity in focus at pixels (x, y): numbers, arrays or tensors."""
        return self.level + self.slope[0] * x + self.slope[1] * y


def plane_defocus(
    disparity: Array, blur: float, plane: FocusPlane, corner: tuple[int, int] = (0, 0)
) -> Array:
    """Return the signed blur radius in pixels: ``blur * (disparity - focus)``.

    The surface of zero defocus is the plane of focus. A tilted sensor also cuts the cone of light obliquely;
    :func:`plane_aberration_map` gives the resulting outline of discs.

    Args:
        disparity: Inverse depth, (H, W), array or tensor; 1/mm with a lens, else in any unit.
        blur: Blur radius of a point one unit of disparity away from focus, pixels.
        plane: Plane of focus.
        corner: Column and row of the first value of the map in the shown picture.

    Returns:
        Signed blur radius, pixels, (H, W), positive in front of the plane of focus.

    Raises:
        ShapeError: ``disparity`` is not (H, W).
    """
    check_rank("disparity", disparity, 2, "(H, W)")
    xp = array_namespace(disparity)
    columns, rows = (xp.cumsum(xp.ones_like(line), 0) - 1 for line in (disparity[0], disparity[:, 0]))
    return blur * (disparity - plane.at(columns + corner[0], rows[:, None] + corner[1]))


def plane_aberration_map(plane: FocusPlane, blur: float) -> AberrationMap:
    """Return the aberration map that makes the discs of :func:`plane_defocus` conic.

    All rays of the pixel p meet at its point in focus: at the disparity D the ray through a crosses the
    point ``q = p - s a`` of the picture with ``s = blur * (D - focus(p))``. The map expects the defocus d
    relative to the focus at q itself, ``d = s - blur * slope.(q - p) = s (1 + blur * slope.a)``; hence
    ``q = p - d a / (1 + tilt.a)`` with ``tilt = blur * slope``. Light of q with defocus d arrives at
    ``q + d a / (1 + tilt.a)``, which is the conic. Exact for an aperture parallel to the sensor; for an
    aperture that tilts with its lens see :func:`tilted_aberration_map`.
    """
    return replace(AberrationMap.perfect(), tilt=(blur * plane.slope[0], blur * plane.slope[1]))


def tilted_aberration_map(
    plane: FocusPlane,
    blur: float,
    *,
    focal_length: float,
    pixel_pitch: float,
    distance: float,
    size: tuple[int, int],
) -> AberrationMap:
    """Return the aberration map of a thin lens that tilts together with its aperture.

    With e the axes of the aperture, in the coordinates of the sensor, the ray of a leaves the point -R e.a,
    with R the pupil radius. All rays of the pixel p, of the direction (t, 1), meet at its point in focus; the
    line there from -R e.a crosses ``q = p - s a' / (1 + R e_z.a focus(p))`` with ``a' = e_xy.a - t e_z.a``.
    The defocus relative to the focus at q is ``d = s - blur * slope.(q - p)``. With the lens equation for
    focus(p) everything but the sensor distance cancels: ``q = p - d a' / (1 - R e_z.a / distance)``. A lens
    tilts about x first, then about y, as in :class:`bokehnet.lenses.TiltShift`.

    Args:
        plane: Plane of focus, 1/mm.
        blur: Blur radius of a point 1/mm away from focus, pixels.
        focal_length: Focal length, mm.
        pixel_pitch: Distance between the centres of two pixels, mm.
        distance: Distance from the lens to the sensor, mm, as from :func:`tilted_lens`.
        size: Width and height of the shown picture, pixels.
    """
    across = focal_length * distance / pixel_pitch
    sin_y = across * plane.slope[0]
    cos_y = math.sqrt(max(1 - sin_y**2, 0.0))
    sin_x = -across * plane.slope[1] / cos_y
    cos_x = math.sqrt(max(1 - sin_x**2, 0.0))
    along = -sin_y * cos_x, sin_x
    pupil_slope = blur * pixel_pitch / distance**2  # pupil radius over distance
    corner = 0.5 * math.hypot(*size) * pixel_pitch / distance
    return replace(
        AberrationMap.perfect(),
        tilt=(-pupil_slope * along[0], -pupil_slope * along[1]),
        aperture_axes=((cos_y, 0.0), (sin_x * sin_y, cos_x), (corner * along[0], corner * along[1])),
    )


def check_tilt(tilt: tuple[float, float]) -> None:
    """Raise ``ParameterError`` unless both angles are at most ``MAX_TILT_DEGREES`` degrees."""
    for name, angle in zip(("tilt_x", "tilt_y"), tilt, strict=True):
        check_number(name, angle)
        if abs(angle) > MAX_TILT_DEGREES:
            raise ParameterError(name, f"up to {MAX_TILT_DEGREES:g} degrees", angle)


def relative_plane(
    tilt: tuple[float, float], pixel: tuple[float, float], disparity: float, size: tuple[int, int]
) -> FocusPlane:
    """Return a tilted plane of focus for relative disparity, without a lens.

    Disparity from 0 to 1 is treated as a box as deep as the picture is high, or wide. At 45 degrees the
    focus passes through the whole depth of the box from one side of the picture to the other; in general
    through ``tan(tilt)`` of it.

    Args:
        tilt: Tilt about x and about y, degrees.
        pixel: Pixel (x, y) at which ``disparity`` is in focus.
        disparity: Disparity in focus at ``pixel``.
        size: Width and height of the shown picture, pixels.

    Raises:
        ParameterError: As :func:`check_tilt`.
    """
    check_tilt(tilt)
    about_x, about_y = (math.tan(math.radians(angle)) for angle in tilt)
    return FocusPlane.around(pixel, disparity, (about_y / size[0], -about_x / size[1]))


def tilted_lens(
    tilt: tuple[float, float],
    pixel: tuple[float, float],
    disparity: float,
    *,
    focal_length: float,
    pixel_pitch: float,
    centre: tuple[float, float],
) -> tuple[FocusPlane, float]:
    """Return the plane of focus of a thin lens turned about its centre, and the distance of its sensor.

    With m the axis of the lens and d the distance to the sensor, the thin lens equation along m for the
    pixel of slope t, ``1 / (z m.(t,1)) + 1 / (d m.(t,1)) = 1 / f``, is ``1 / z = m.(t,1) / f - 1 / d``,
    affine in t. One pixel changes the slope by ``pitch / d``.

    Args:
        tilt: Tilt about x and about y, degrees.
        pixel: Pixel (x, y) that the lens is focused by: ``disparity`` is sharp at it.
        disparity: Disparity in focus at ``pixel``, 1/mm.
        focal_length: Focal length, mm.
        pixel_pitch: Distance between the centres of two pixels, mm.
        centre: Pixel (x, y) on the sensor normal through the lens: the centre of the shown picture.

    Returns:
        The plane, in 1/mm, and the distance from the lens to the sensor, mm.

    Raises:
        ParameterError: As :func:`check_tilt`.
        LensError: The lens cannot focus at this disparity.
    """
    check_tilt(tilt)
    right, down, along = _axis(tilt)
    offset = right * (pixel[0] - centre[0]) + down * (pixel[1] - centre[1])
    vergence, scale = along / focal_length - disparity, 1 - offset * pixel_pitch / focal_length
    if not (vergence > 0 and scale > 0):
        raise LensError(
            f"tilted lens: cannot focus at {_distance(disparity)}: need more than "
            f"{focal_length / along:.4g} mm with this tilt, and a pixel not beyond its hinge"
        )
    distance = scale / vergence
    per_pixel = pixel_pitch / (focal_length * distance)
    return FocusPlane.around(pixel, disparity, (right * per_pixel, down * per_pixel)), distance


def distance_to_sensor(
    plane: FocusPlane, *, focal_length: float, pixel_pitch: float, centre: tuple[float, float]
) -> float:
    """Return the distance from a thin lens to its sensor, tilted so that ``plane`` is in focus, mm.

    With x the inverse of that distance, the axis of :func:`tilted_lens` is
    ``focal_length * slope / (pitch * x)`` across and ``focal_length * (focus + x)`` along the normal of the
    sensor, with the focus at the centre of the picture; its length is 1. At most two x solve this, and the
    larger one belongs to the smaller tilt. The function is concave, so Newton's method converges
    monotonically from the right.

    Args:
        plane: Plane of focus, 1/mm.
        focal_length: Focal length, mm.
        pixel_pitch: Distance between the centres of two pixels, mm.
        centre: Pixel (x, y) on the sensor normal through the lens.

    Raises:
        LensError: No tilt of this lens has the plane in focus: it passes too near the lens.
    """
    focus = plane.at(*centre)
    across = focal_length / pixel_pitch * math.hypot(*plane.slope)
    x = 1 / focal_length - focus
    for _ in range(_MAX_ITERATIONS):
        if not x > 0:
            break
        value = 1 - (across / x) ** 2 - (focal_length * (focus + x)) ** 2
        steepness = 2 * across**2 / x**3 - 2 * focal_length**2 * (focus + x)
        if not steepness < 0:
            break
        following = x - value / steepness
        if following >= x:  # at the root up to rounding
            return 1 / x
        x = following
    raise LensError(
        f"focus plane: no tilt of a lens of {focal_length:g} mm has it in focus, at "
        f"{_distance(focus)} in the middle: it is tilted too much for its distance"
    )


def _axis(tilt: tuple[float, float]) -> tuple[float, float, float]:
    """Return the axis of a tilted lens in sensor coordinates: to the right, down, along the sensor normal."""
    about_x, about_y = map(math.radians, tilt)
    return math.sin(about_y), -math.sin(about_x) * math.cos(about_y), math.cos(about_x) * math.cos(about_y)


def _distance(disparity: float) -> str:
    return f"{1 / disparity:.4g} mm" if disparity > 0 else "infinity"
