"""Both surfaces of pixels at edges, known from an alpha channel, deep samples or a finer picture.

They replace the estimates of :mod:`bokehnet.classical.layered.boundaries.unmixing`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from bokehnet.checks import check_finite
from bokehnet.deprecation import earlier_name
from bokehnet.errors import ParameterError, ShapeError

__all__ = ["KnownSurfaces", "concatenate_surfaces"]

_ARRAYS = ("rows", "columns", "near", "far", "coverage", "front", "back")

Array = npt.NDArray[np.float32]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class KnownSurfaces:
    """Known surfaces of some pixels.

    Attributes:
        rows: Rows of the pixels, (N,), ascending.
        columns: Columns of the pixels, (N,), ascending in each row; every pixel occurs once.
        near: Signed defocus of the nearer surface in pixels, (N,), float32, + in front of focus. In a scene
            that is not focused yet, its value in the depth map of the scene.
        far: Signed defocus of the farther surface, (N,), never above ``near``.
        coverage: Fraction of the pixel that the nearer surface covers, (N,), in [0, 1].
        front: Colors of the nearer surface, scene-linear, (N, 3); None if only the coverage is known.
        back: Colors of the farther surface, (N, 3); None if ``front`` is None.
        complete: True if every other pixel is known to show one surface.

    Raises:
        ShapeError: The arrays do not fit together.
        ParameterError: NaN or infinity, coverage outside [0, 1], pixels out of order or repeated, or a far
            surface in front of the near one.

    Examples:
        >>> wire = KnownSurfaces(
        ...     rows=np.array([3]), columns=np.array([5]), near=np.array([6.0]), far=np.array([-2.0]),
        ...     coverage=np.array([0.25]), front=np.array([[0.1, 0.1, 0.1]]), back=np.array([[0.2, 0.6, 0.1]])
        ... )
        >>> wire.in_rows(2, 8).rows, len(wire.in_rows(4, 8).rows)
        (array([1], dtype=int32), 0)
    """

    rows: npt.NDArray[np.integer[Any]]
    columns: npt.NDArray[np.integer[Any]]
    near: Array
    far: Array
    coverage: Array
    front: Array | None = None
    back: Array | None = None
    complete: bool = False

    def __post_init__(self) -> None:
        count = len(np.atleast_1d(self.rows))
        for name in ("rows", "columns"):
            indices = np.asarray(getattr(self, name))
            if indices.shape != (count,) or indices.dtype.kind not in "iu":
                raise ShapeError(f"known {name}: expected {count} whole numbers, got {_describe(indices)}")
            object.__setattr__(self, name, indices.astype(np.int32, copy=False))
        for name in ("near", "far", "coverage", "front", "back"):
            values = getattr(self, name)
            if values is None and name in ("front", "back"):
                continue
            values = np.asarray(values)
            shape = (count, 3) if name in ("front", "back") else (count,)
            if values.shape != shape:
                raise ShapeError(f"known {name}: expected shape {shape}, got {values.shape}")
            check_finite(f"known {name}", values)
            object.__setattr__(self, name, np.ascontiguousarray(values, np.float32))
        self._check_values()

    def _check_values(self) -> None:
        if (self.front is None) != (self.back is None):
            raise ParameterError("known front", "colors of both surfaces or of none", shown="those of one")
        if not len(self.rows):
            return
        low, high = float(self.coverage.min()), float(self.coverage.max())
        if low < 0 or high > 1:
            raise ParameterError("known coverage", "0 to 1", shown=f"{low:g} to {high:g}")
        if (self.far > self.near).any():
            shown = f"{int((self.far > self.near).sum())} that are nearer"
            raise ParameterError("known far", "values not above `near`", shown=shown)
        if self.rows.min() < 0 or self.columns.min() < 0:
            raise ParameterError("known rows", "rows and columns from 0 up", shown="one below 0")
        step, along = np.diff(self.rows), np.diff(self.columns)
        if (step < 0).any() or ((step == 0) & (along <= 0)).any():
            remedy = "sort them by row, then by column, and list each pixel once"
            raise ParameterError("known rows", "pixels in row order", shown="another order", remedy=remedy)

    @property
    def nbytes(self) -> int:
        """Memory of the arrays, bytes."""
        arrays = (getattr(self, name) for name in _ARRAYS)
        return sum(array.nbytes for array in arrays if isinstance(array, np.ndarray))

    def check_within(self, height: int, width: int) -> None:
        """Raise ``ParameterError`` unless all pixels are inside a picture of this size."""
        if len(self.rows) and (self.rows[-1] >= height or self.columns.max() >= width):
            shown = f"row {self.rows[-1]}, column {self.columns.max()}"
            raise ParameterError("known rows", f"pixels of a picture of {width}x{height}", shown=shown)

    def in_rows(self, first: int, last: int) -> "KnownSurfaces":
        """Return the pixels of rows ``first`` to ``last``, exclusive; rows count from ``first``."""
        selection = slice(*np.searchsorted(self.rows, (first, last)))
        return replace(self._subset(selection), rows=self.rows[selection] - np.int32(first))

    def below(self, rows: int) -> "KnownSurfaces":
        """Return the same surfaces after ``rows`` rows are added above the picture."""
        return replace(self, rows=self.rows + np.int32(rows))

    def in_columns(self, first: int, last: int, offset: int = 0) -> "KnownSurfaces":
        """Return the pixels of columns ``first`` to ``last``, exclusive, with ``offset`` added to columns."""
        part = self.select((self.columns >= first) & (self.columns < last))
        return replace(part, columns=part.columns + np.int32(offset))

    def part(self, rows: slice, columns: slice) -> "KnownSurfaces":
        """Return the pixels of some rows and columns, slices with both ends, and counted from their first."""
        part = self.in_rows(rows.start, rows.stop)
        return part.in_columns(columns.start, columns.stop, -columns.start)

    def select(self, mask: npt.NDArray[np.bool_]) -> "KnownSurfaces":
        """Return the pixels for which ``mask``, (N,), is True."""
        return self._subset(mask)

    def _subset(self, selection: Any) -> "KnownSurfaces":
        arrays: dict[str, Any] = {
            name: None if getattr(self, name) is None else getattr(self, name)[selection] for name in _ARRAYS
        }
        return replace(self, **arrays)

    def with_radius_limit(self, radius: float) -> "KnownSurfaces":
        """Return the same surfaces with the blur radius clipped to ``radius`` pixels."""
        return replace(self, near=np.clip(self.near, -radius, radius), far=np.clip(self.far, -radius, radius))

    def near_and_far_maps(self, values: Array) -> tuple[Array, Array]:
        """Return a map (H, W) with the nearer surfaces inserted, and one with the farther ones."""
        nearest, farthest = values.copy(), values.copy()
        nearest[self.rows, self.columns], farthest[self.rows, self.columns] = self.near, self.far
        return nearest, farthest

    def with_mapped_colors(self, formula: Callable[[Array], Array]) -> "KnownSurfaces":
        """Return the same surfaces with ``formula`` applied to all colors, (N, 3)."""
        if self.front is None or self.back is None or not len(self.rows):
            return self
        return replace(self, front=formula(self.front), back=formula(self.back))

    def without_colors(self) -> "KnownSurfaces":
        """Return the same surfaces without colors, for another picture of the same surfaces."""
        return replace(self, front=None, back=None)

    in_light = earlier_name("KnownSurfaces", "in_light")


def concatenate_surfaces(parts: Sequence[KnownSurfaces]) -> KnownSurfaces | None:
    """Return the pixels of several parts in the order of rows and columns; None if there are no parts."""
    if not parts:
        return None
    arrays: dict[str, Any] = {
        name: None if getattr(parts[0], name) is None else np.concatenate([getattr(p, name) for p in parts])
        for name in _ARRAYS
    }
    rows, columns = arrays["rows"], arrays["columns"]
    if (np.diff(rows) < 0).any() or ((np.diff(rows) == 0) & (np.diff(columns) < 0)).any():
        order = np.lexsort((columns, rows))
        arrays = {name: None if array is None else array[order] for name, array in arrays.items()}
    return replace(parts[0], **arrays)


def _describe(array: npt.NDArray[Any]) -> str:
    return f"{array.dtype} of shape {array.shape}"
