"""A plane of focus that leans, as behind a lens that is tilted against its sensor.

Every plane of the scene has an inverse depth that is affine over the picture: with t the slopes of the
directions that pixels see, ``n . (z t, z) = c`` is ``1 / z = n . (t, 1) / c``. So what is in focus is one
affine map, and blur stays linear in the disparity. Pixels are counted from the middle of the upper left one
of the shown picture, to the right and down; depth counts along the normal of the sensor, from the pupil.

A lens leans by its tilt (about the x axis, about the y axis), degrees, signed as the sensor's in
:class:`bokehnet.lenses.TiltShift`: above 0 the focus is nearer at the upper side, and nearer on the right.

Source: Scheimpflug, British patent 1196, 1904; Merklinger, "Focusing the view camera", 1996, for the hinge.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from bokehnet.checks import Array, array_namespace, check_number, check_numbers, check_rank
from bokehnet.errors import LensError, ParameterError
from bokehnet.optics.aberrations.aberration_map import AberrationMap

__all__ = [
    "STEEPEST",
    "FocusPlane",
    "check_tilt",
    "distance_to_sensor",
    "plane_aberration_map",
    "plane_defocus",
    "relative_plane",
    "tilted_aberration_map",
    "tilted_lens",
]

# Degrees; what a tilted sensor can do, too.
STEEPEST = 80.0

# Of Newton's method: each doubles the right digits, or halves what is wrong where two solutions meet.
_STEPS = 60


@dataclass(frozen=True, kw_only=True, slots=True)
class FocusPlane:
    """What disparity is in focus where: ``level + slope . (x, y)`` at the pixel (x, y).

    Attributes:
        level: At the pixel (0, 0), in the unit of the disparity map.
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
        """Return the plane of a slope that has ``disparity`` in focus at ``pixel``."""
        return cls(level=disparity - slope[0] * pixel[0] - slope[1] * pixel[1], slope=slope)

    @classmethod
    def through(cls, pixels: Array, disparities: Array) -> "FocusPlane":
        """Return the plane that has three disparities (3,) in focus at three pixels (3, 2).

        Raises:
            ParameterError: The pixels lie on one line, where many planes go through or none.
        """
        pixels, disparities = np.asarray(pixels, float), np.asarray(disparities, float)
        edges = pixels[1:] - pixels[0]
        sides = np.linalg.norm([*edges, edges[1] - edges[0]], axis=-1)
        # The height of the triangle over its longest side, in pixels.
        if not sides.max() > 0 or abs(np.linalg.det(edges)) < sides.max():
            places = ", ".join(f"{x:g},{y:g}" for x, y in pixels)
            raise ParameterError(
                "pixels", "three pixels off one line, by a pixel or more", pixels.tolist(), shown=places
            )
        slope = np.linalg.solve(edges, disparities[1:] - disparities[0])
        return cls.around(tuple(pixels[0]), float(disparities[0]), (float(slope[0]), float(slope[1])))

    def at(self, x: Array, y: Array) -> Array:
        """Disparity in focus at pixels, numbers, arrays or tensors."""
        return self.level + self.slope[0] * x + self.slope[1] * y


def plane_defocus(
    disparity: Array, blur: float, plane: FocusPlane, corner: tuple[int, int] = (0, 0)
) -> Array:
    """Signed blur radius in pixels, positive in front of the plane of focus: ``blur * (disparity - focus)``.

    The plane for which it is 0 is the one in focus. Behind a lens a disc is cut out of a cone by a sensor
    that leans, too: its outline is that of :func:`plane_aberration_map`.

    Args:
        disparity: Inverse depth, (H, W), array or tensor; 1/mm with a lens, else in any unit.
        blur: Radius in pixels of a point one unit of disparity away from focus.
        plane: What is in focus.
        corner: Column and row of the first value of the map in the shown picture.

    Raises:
        ShapeError: ``disparity`` is not (H, W).
    """
    check_rank("disparity", disparity, 2, "(H, W)")
    xp = array_namespace(disparity)
    columns, rows = (xp.cumsum(xp.ones_like(line), 0) - 1 for line in (disparity[0], disparity[:, 0]))
    return blur * (disparity - plane.at(columns + corner[0], rows[:, None] + corner[1]))


def plane_aberration_map(plane: FocusPlane, blur: float) -> AberrationMap:
    """Return the aberration map that makes the discs of :func:`plane_defocus` conic.

    All rays of the pixel p meet where it is in focus: at the disparity D the ray through a runs over the
    place ``q = p - s a`` of the picture with ``s = blur * (D - focus(p))``. The map tells the defocus d
    against the focus at q itself, ``d = s - blur * slope.(q - p) = s (1 + blur * slope.a)``; hence
    ``q = p - d a / (1 + tilt.a)`` with ``tilt = blur * slope``. Light of q with defocus d arrives at
    ``q + d a / (1 + tilt.a)``, which is the conic. Exact for an aperture parallel to the sensor; for one that
    leans with its lens see :func:`tilted_aberration_map`.
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
    """Return the same where a thin lens leans together with its aperture, as in front of a tilted sensor.

    With e the axes of the aperture, as the sensor sees them, the ray of a leaves the point -R e.a, with R the
    pupil radius. All rays of the pixel p, of the direction (t, 1), meet where it is in focus; the line there
    from that point runs over ``q = p - s a' / (1 + R e_z.a focus(p))`` with ``a' = e_xy.a - t e_z.a``. The
    defocus against the focus at q is ``d = s - blur * slope.(q - p)``. With the lens equation for focus(p)
    all but the sensor's distance falls out of it: ``q = p - d a' / (1 - R e_z.a / distance)``. A lens leans
    about x first, then about y, as :class:`bokehnet.lenses.TiltShift`.

    Args:
        plane: In focus, 1/mm.
        blur: Radius in pixels of a point 1/mm away from focus.
        focal_length: mm.
        pixel_pitch: mm.
        distance: From the lens to the sensor, mm; as from :func:`tilted_lens`.
        size: Width and height of the shown picture, pixels.
    """
    across = focal_length * distance / pixel_pitch
    sin_y = across * plane.slope[0]
    cos_y = math.sqrt(max(1 - sin_y**2, 0.0))
    sin_x = -across * plane.slope[1] / cos_y
    cos_x = math.sqrt(max(1 - sin_x**2, 0.0))
    along = -sin_y * cos_x, sin_x
    nearness = blur * pixel_pitch / distance**2  # pupil radius over distance
    corner = 0.5 * math.hypot(*size) * pixel_pitch / distance
    return replace(
        AberrationMap.perfect(),
        tilt=(-nearness * along[0], -nearness * along[1]),
        aperture_axes=((cos_y, 0.0), (sin_x * sin_y, cos_x), (corner * along[0], corner * along[1])),
    )


def check_tilt(tilt: tuple[float, float]) -> None:
    """Raise ``ParameterError`` unless both angles are at most ``STEEPEST`` degrees."""
    for name, angle in zip(("tilt_x", "tilt_y"), tilt, strict=True):
        check_number(name, angle)
        if abs(angle) > STEEPEST:
            raise ParameterError(name, f"up to {STEEPEST:g} degrees", angle)


def relative_plane(
    tilt: tuple[float, float], pixel: tuple[float, float], disparity: float, size: tuple[int, int]
) -> FocusPlane:
    """Return a leaning plane of focus where no lens is known.

    Disparity from 0 to 1 is taken as a box as deep as the picture is high, or wide. At 45 degrees the
    focus runs through all of it from one side of the picture to the other, in general through ``tan(tilt)``.

    Args:
        tilt: About x and about y, degrees.
        pixel: Where the plane goes through ``disparity``, (x, y).
        disparity: In focus there.
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
    """Return the plane of focus of a thin lens that is turned about its middle, and where its sensor stands.

    With m the axis of the lens and d the distance to the sensor, the thin lens equation along m for the
    pixel of slope t, ``1 / (z m.(t,1)) + 1 / (d m.(t,1)) = 1 / f``, is ``1 / z = m.(t,1) / f - 1 / d``,
    affine in t. A pixel more is ``pitch / d`` of slope.

    Args:
        tilt: About x and about y, degrees.
        pixel: What the lens is focused by, (x, y): ``disparity`` is sharp there.
        disparity: 1/mm.
        focal_length: mm.
        pixel_pitch: Distance between the centres of two pixels, mm.
        centre: Pixel in front of which the lens stands, the middle of the shown picture.

    Returns:
        The plane, in 1/mm, and the distance from the lens to the sensor, mm.

    Raises:
        ParameterError: As :func:`check_tilt`.
        LensError: The lens cannot focus there.
    """
    check_tilt(tilt)
    right, down, along = _axis(tilt)
    aside = right * (pixel[0] - centre[0]) + down * (pixel[1] - centre[1])
    nearness, share = along / focal_length - disparity, 1 - aside * pixel_pitch / focal_length
    if not (nearness > 0 and share > 0):
        raise LensError(
            f"tilted lens: cannot focus at {_distance(disparity)}: need more than "
            f"{focal_length / along:.4g} mm with this tilt, and a pixel not beyond its hinge"
        )
    distance = share / nearness
    scale = pixel_pitch / (focal_length * distance)
    return FocusPlane.around(pixel, disparity, (right * scale, down * scale)), distance


def distance_to_sensor(
    plane: FocusPlane, *, focal_length: float, pixel_pitch: float, centre: tuple[float, float]
) -> float:
    """Return the distance from a thin lens, tilted so that ``plane`` is in focus, to its sensor, mm.

    With x the inverse of that distance, the axis of :func:`tilted_lens` is
    ``focal_length * slope / (pitch * x)`` across and ``focal_length * (focus + x)`` along the normal of the
    sensor, focus in the middle of the picture; its length is 1. At most two x solve that, and the larger one
    is that of the smaller tilt. The function is concave: from the right, Newton's method goes straight to it.

    Args:
        plane: In 1/mm.
        focal_length: mm.
        pixel_pitch: mm.
        centre: Pixel in front of which the lens stands.

    Raises:
        LensError: No tilt of this lens has that plane in focus: it passes too near the lens.
    """
    focus = plane.at(*centre)
    across = focal_length / pixel_pitch * math.hypot(*plane.slope)
    x = 1 / focal_length - focus
    for _ in range(_STEPS):
        if not x > 0:
            break
        value = 1 - (across / x) ** 2 - (focal_length * (focus + x)) ** 2
        steepness = 2 * across**2 / x**3 - 2 * focal_length**2 * (focus + x)
        if not steepness < 0:
            break
        following = x - value / steepness
        if following >= x:  # only rounding keeps it from the root
            return 1 / x
        x = following
    raise LensError(
        f"focus plane: no tilt of a lens of {focal_length:g} mm has it in focus, at "
        f"{_distance(focus)} in the middle: it leans too much for its distance"
    )


def _axis(tilt: tuple[float, float]) -> tuple[float, float, float]:
    """Axis of a lens as its tilted sensor sees it: to the right, down, along the sensor's normal."""
    about_x, about_y = map(math.radians, tilt)
    return math.sin(about_y), -math.sin(about_x) * math.cos(about_y), math.cos(about_x) * math.cos(about_y)


def _distance(disparity: float) -> str:
    return f"{1 / disparity:.4g} mm" if disparity > 0 else "infinity"
