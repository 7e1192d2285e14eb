"""A sensor that is shifted and tilted against its lens, as in a view camera."""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from bokehnet.checks import Array, array_namespace, number_of
from bokehnet.errors import LensError
from bokehnet.lenses.base import LensModel, Rays

__all__ = ["ImagingLens", "TiltShift"]

_STEEPEST = 80.0  # degrees


class ImagingLens(LensModel, Protocol):
    """A lens that also tells where its ideal images are; all lenses here do."""

    def image_of(self, points: Array) -> tuple[Array, Array]:
        """Where points (..., 3), mm, are imaged: xy (..., 2), and mm behind the sensor (...,)."""
        ...


@dataclass(frozen=True, kw_only=True, slots=True)
class TiltShift:
    """Any lens with its sensor moved; points of the sensor keep their coordinates on it.

    With w the distance behind the lens's own sensor plane, the sensor point (a, b) lies at
    ``(shift, offset) + Ry Rx (a, b, 0)`` in (x, y, w), x and y as in the scene: to the right and down. A tilt
    about x moves the lower side of the sensor away from the lens, one about y its left side.
    The light falls as on an upright sensor: the cosine between ray and tilted sensor is left out.

    Attributes:
        lens: The lens.
        shift: Sensor centre against the axis, (x, y), mm; the image is turned, so a picture that
            shall show more of the scene's upper side (y < 0) needs a shift down, y > 0.
        tilt: About the x axis and about the y axis, degrees.
        offset: Sensor centre behind the lens's sensor plane, mm.

    Raises:
        LensError: A tilt is steeper than 80 degrees.
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
        if not (all(map(math.isfinite, numbers)) and max(map(abs, numbers[2:4])) <= _STEEPEST):
            steep = not all(abs(angle) <= _STEEPEST for angle in numbers[2:4])
            raise LensError(
                f"tilt-shift: expected tilts up to {_STEEPEST:g} degrees and finite shifts, "
                f"got tilt {self.tilt}, shift {self.shift}, offset {self.offset}",
                parameter="tilt" if steep else "offset" if all(map(math.isfinite, numbers[:2])) else "shift",
            )

    @classmethod
    def focused_on(
        cls, lens: ImagingLens, points: Array, shift: tuple[float, float] = (0.0, 0.0)
    ) -> "TiltShift":
        """Tilt the sensor so that the plane through three points of the scene is sharp.

        A lens images planes to planes, so the sensor goes through the three image points.

        Args:
            lens: The lens; its own focus only tells from where the offset counts.
            points: (3, 3), mm.
            shift: As above.

        Raises:
            LensError: The points lie on a line, or no sensor can stand where they are sharp.
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
        """Signed blur radius of the untilted lens, mm; where the sensor crosses its own place it is exact."""
        return self.lens.coc_radius(disparity)

    def place(self, sensor_xy: Array) -> tuple[Array, Array]:
        """Where points (..., 2) of the sensor are: xy, mm, and mm behind the lens's own sensor plane."""
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
        """Rays from sensor points, as in :class:`LensModel`; ``sensor_offset`` is along the axis."""
        xy, behind = self.place(sensor_xy)
        if sensor_offset is not None:
            behind = behind + sensor_offset
        return self.lens.sample_rays(xy, pupil_uv, wavelength, behind)
