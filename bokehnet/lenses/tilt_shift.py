"""Sensor that is shifted and tilted relative to its lens, as in a view camera."""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from bokehnet.checks import Array, array_namespace, number_of
from bokehnet.errors import LensError
from bokehnet.lenses.base import LensModel, Rays

__all__ = ["ImagingLens", "TiltShift"]

_MAX_TILT_DEGREES = 80.0


class ImagingLens(LensModel, Protocol):
    """Lens with known ideal images; all lenses of this package are."""

    def image_of(self, points: Array) -> tuple[Array, Array]:
        """Return the images of points (..., 3), mm: xy (..., 2), and mm behind the sensor (...,)."""
        ...


@dataclass(frozen=True, kw_only=True, slots=True)
class TiltShift:
    """Any lens with its sensor moved; points of the sensor keep their coordinates on it.

    With w the distance behind the sensor plane of the lens itself, the sensor point (a, b) lies at
    ``(shift, offset) + Ry Rx (a, b, 0)`` in (x, y, w), x and y as in the scene: to the right and down. A tilt
    about x moves the lower side of the sensor away from the lens, a tilt about y its left side.
    Illumination is that of an untilted sensor: the cosine between ray and tilted sensor is ignored.

    Attributes:
        lens: Lens in front of the sensor.
        shift: Shift of the sensor centre from the axis, (x, y), mm; the image is turned, so a picture that
            shows more of the upper side of the scene (y < 0) needs a shift down, y > 0.
        tilt: Tilt about the x axis and about the y axis, degrees.
        offset: Distance of the sensor centre behind the sensor plane of the lens, mm.

    Raises:
        LensError: A tilt exceeds 80 degrees, or a number is not finite.
    """

    lens: ImagingLens
    shift: tuple[float, float] = (0.0, 0.0)
    tilt: tuple[float, float] = (0.0, 0.0)
    offset: float = 0.0

    def __post_init__(self) -> None:
        for name in ("shift", "tilt"):
            pair = getattr(self, name)
            if not isinstance(pair, tuple | list) or len(pair) != 2:
                raise LensError(f"tilt-shift: {name}: expected two numbers, got {pair!r}", parameter=name)
        numbers = [number_of(value) for value in (*self.shift, *self.tilt, self.offset)]
        if not (all(map(math.isfinite, numbers)) and max(map(abs, numbers[2:4])) <= _MAX_TILT_DEGREES):
            too_steep = not all(abs(angle) <= _MAX_TILT_DEGREES for angle in numbers[2:4])
            raise LensError(
                f"tilt-shift: expected tilts up to {_MAX_TILT_DEGREES:g} degrees and finite shifts, "
                f"got tilt {self.tilt}, shift {self.shift}, offset {self.offset}",
                parameter="tilt"
                if too_steep
                else "offset"
                if all(map(math.isfinite, numbers[:2]))
                else "shift",
            )

    @classmethod
    def focused_on(
        cls, lens: ImagingLens, points: Array, shift: tuple[float, float] = (0.0, 0.0)
    ) -> "TiltShift":
        """Return the lens with its sensor tilted to focus on the plane through three points of the scene.

        A lens images planes to planes, so the sensor passes through the three image points.

        Args:
            lens: Lens in front of the sensor; its focus is only the origin of the offset.
            points: Three points of the scene, mm, (3, 3).
            shift: Shift of the sensor centre, as the attribute.

        Raises:
            LensError: The points lie on a line, or no sensor position makes them sharp.
        """
        points = np.asarray(points, float)
        xy, distance = lens.image_of(points)
        equations = np.concatenate([xy, np.ones((3, 1))], 1)
        if not np.isfinite(equations).all() or np.linalg.cond(equations) > 1e9:
            raise LensError(
                f"cannot focus on one plane through {points.tolist()}: need three points off one line"
            )
        gx, gy, base = np.linalg.solve(equations, distance)
        return cls(
            lens=lens,
            shift=shift,
            tilt=(
                math.degrees(math.atan2(gy, math.hypot(1, gx))),
                math.degrees(math.atan(-gx)),
            ),
            offset=float(base + gx * shift[0] + gy * shift[1]),
        )

    def coc_radius(self, disparity: Array) -> Array:
        """Return the signed blur radius of the untilted lens, mm; exact where the sensor meets its plane."""
        return self.lens.coc_radius(disparity)

    def place(self, sensor_xy: Array) -> tuple[Array, Array]:
        """Return the positions of sensor points (..., 2): xy, mm, and mm behind the lens's sensor plane."""
        alpha, beta = map(math.radians, self.tilt)
        a, b = sensor_xy[..., 0], sensor_xy[..., 1]
        lifted = b * math.sin(alpha)
        x = self.shift[0] + a * math.cos(beta) + lifted * math.sin(beta)
        y = self.shift[1] + b * math.cos(alpha)
        behind = self.offset - a * math.sin(beta) + lifted * math.cos(beta)
        return array_namespace(sensor_xy).stack([x, y], -1), behind

    def sample_rays(
        self,
        sensor_xy: Array,
        pupil_uv: Array,
        wavelength: Array | None = None,
        sensor_offset: Array | None = None,
    ) -> Rays:
        """Return rays from sensor points, as :class:`LensModel`; ``sensor_offset`` is along the axis."""
        xy, behind = self.place(sensor_xy)
        if sensor_offset is not None:
            behind = behind + sensor_offset
        return self.lens.sample_rays(xy, pupil_uv, wavelength, behind)
