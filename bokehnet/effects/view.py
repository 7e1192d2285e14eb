"""Position of the pixels of an array in the shown picture."""

from dataclasses import dataclass

import numpy as np

from bokehnet.checks import Array, array_namespace, check_whole, constant_like

__all__ = ["View", "cast_like"]


@dataclass(frozen=True, kw_only=True, slots=True)
class View:
    """Size of the shown picture, about whose centre effects are centred, and position of an array in it.

    Attributes:
        width: Width of the shown picture, pixels.
        height: Height of the shown picture, pixels.
        left: Column of the array's first pixel in it; below 0 with overscan.
        top: Row of the array's first pixel in it.

    Raises:
        ParameterError: A number is not whole, or the picture is empty.
    """

    width: int
    height: int
    left: int = 0
    top: int = 0

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            check_whole(name, getattr(self, name), 1)
        for name in ("left", "top"):
            check_whole(name, getattr(self, name))

    @classmethod
    def of(cls, image: Array) -> "View":
        """Return the view in which all of ``image`` (..., H, W, C) is shown."""
        return cls(width=image.shape[-2], height=image.shape[-3])

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
        """Return the field positions of the outermost shown pixels, (N, 2); ``like`` as for :meth:`field`."""
        shown = View(width=self.width, height=self.height)
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
        """Return whether an array of this size contains every shown pixel."""
        across = self.left <= 0 and self.left + width >= self.width
        return across and self.top <= 0 and self.top + height >= self.height


def cast_like(values: Array, image: Array) -> Array:
    """Return ``values`` in the precision of ``image``; both arrays, or both tensors."""
    return values.astype(image.dtype) if array_namespace(image) is np else values.to(image.dtype)
