"""Position of an array in the displayed picture, from whose centre field positions are measured."""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from bokehnet.checks import Array, array_namespace, check_whole, constant_like

__all__ = ["Frame", "Viewport"]


class Frame(NamedTuple):
    """Centre and scale of the full-size picture, in array coordinates.

    Attributes:
        column: Column of the centre of the picture.
        row: Row of the centre, counted from the first row of the arrays.
        scale: Reciprocal of the half-diagonal in pixels, so that corners are at field position 1.
    """

    column: float
    row: float
    scale: float

    @classmethod
    def of(cls, height: int, width: int, above: int = 0, left: int = 0) -> "Frame":
        """Return the frame of a full-size picture without its first ``above`` rows and ``left`` columns."""
        return cls(0.5 * (width - 1) - left, 0.5 * (height - 1) - above, 2 / math.hypot(width, height))


@dataclass(frozen=True, kw_only=True, slots=True)
class Viewport:
    """Size of the displayed picture, whose centre is the optical axis, and position of an array in it.

    Attributes:
        left: Column of the displayed picture at which the array begins; negative with overscan.
        top: Row of the displayed picture at which the array begins; negative with overscan.
        width: Width of the displayed picture, pixels.
        height: Height of the displayed picture, pixels.

    Raises:
        ParameterError: A number is not whole, or the picture is empty.

    Examples:
        >>> Viewport(left=2, top=-1, width=8, height=6).below(3).as_tuple()
        (2, 2, 8, 6)
    """

    left: int = 0
    top: int = 0
    width: int
    height: int

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            check_whole(name, getattr(self, name), 1)
        for name in ("left", "top"):
            check_whole(name, getattr(self, name))

    @classmethod
    def whole(cls, height: int, width: int) -> "Viewport":
        """Return the position of an array (height, width) that is the whole displayed picture."""
        return cls(width=width, height=height)

    @classmethod
    def of(cls, image: Array) -> "Viewport":
        """Return the position of ``image`` (..., H, W, C) if all of it is displayed."""
        return cls.whole(image.shape[-3], image.shape[-2])

    def below(self, rows: int) -> "Viewport":
        """Return the position of the same array without its first ``rows`` rows."""
        return replace(self, top=self.top + rows)

    def as_tuple(self) -> tuple[int, int, int, int]:
        """Return left, top, width and height, as kernels take them."""
        return self.left, self.top, self.width, self.height

    @property
    def frame(self) -> Frame:
        """Centre and scale of the displayed picture, in coordinates of the array."""
        return Frame.of(self.height, self.width, self.top, self.left)

    @property
    def half_diagonal(self) -> float:
        """Distance from the centre to the corner, pixels."""
        return 0.5 * float(np.hypot(self.width, self.height))

    @property
    def aspect(self) -> float:
        """Width over height."""
        return self.width / self.height

    def field(self, rows: slice, columns: int, like: Array) -> Array:
        """Return the field positions of pixels of the array, (rows, columns, 2), float64, in half-diagonals.

        Args:
            rows: Rows of the array, a slice with both ends.
            columns: Number of columns, from its first.
            like: An array or a tensor: the result has its kind and device.
        """
        x = (np.arange(columns) + self.left + 0.5 - 0.5 * self.width) / self.half_diagonal
        y = (np.arange(rows.start, rows.stop) + self.top + 0.5 - 0.5 * self.height) / self.half_diagonal
        field = np.stack(np.meshgrid(x, y), -1)
        xp = array_namespace(like)
        return field if xp is np else like.new_tensor(field, dtype=xp.float64)

    def border(self, like: Array) -> Array:
        """Return the field positions of the outermost displayed pixels, (N, 2); ``like`` as in ``field``."""
        shown = Viewport.whole(self.height, self.width)
        rows = [shown.field(slice(y, y + 1), self.width, like)[0] for y in (0, self.height - 1)]
        column = shown.field(slice(0, self.height), 1, like)[:, 0]
        mirror = constant_like(np.array([-1.0, 1.0]), column)
        return array_namespace(like).concatenate([*rows, column, column * mirror])

    def places(self, field: Array) -> Array:
        """Return pixels of the array, x and y from the centre of its first, for field positions (..., 2)."""
        x = field[..., 0] * self.half_diagonal + (0.5 * self.width - 0.5 - self.left)
        y = field[..., 1] * self.half_diagonal + (0.5 * self.height - 0.5 - self.top)
        return array_namespace(field).stack([x, y], -1)

    def covers_display(self, height: int, width: int) -> bool:
        """Return whether an array of this size contains every displayed pixel."""
        across = self.left <= 0 and self.left + width >= self.width
        return across and self.top <= 0 and self.top + height >= self.height
