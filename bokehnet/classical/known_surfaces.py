"""Both surfaces of pixels at edges, known beforehand: what an alpha, deep samples or a finer picture tell.

They take the place of what :mod:`bokehnet.classical.layered.boundaries.unmixing` would estimate there.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from bokehnet.checks import check_finite
from bokehnet.errors import ParameterError, ShapeError

__all__ = ["KnownSurfaces", "joined_surfaces"]

_ARRAYS = ("rows", "columns", "near", "far", "coverage", "front", "back")

Array = npt.NDArray[np.float32]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class KnownSurfaces:
    """What is known of the two surfaces of some pixels.

    Attributes:
        rows: Of the pixels, from the top of the picture, (N,), rising.
        columns: Of the same, (N,), rising along each row; no pixel comes twice.
        near: Of the nearer surface, (N,), float32: its signed defocus in pixels, + in front of focus. In a
            scene that nobody has focused yet, its value in the map of the scene.
        far: The same of the farther one, (N,), never above ``near``.
        coverage: Share of the pixel that the nearer surface covers, (N,), in [0, 1].
        front: Colours of the nearer surface, scene-linear, (N, 3); None where only the coverage is known.
        back: Of the farther one, (N, 3); None where ``front`` is.
        complete: Whether every other pixel is known to show one surface.

    Raises:
        ShapeError: The arrays do not fit together.
        ParameterError: NaN or infinity, coverage outside [0, 1], pixels out of order or twice, or a far
            surface before the near one.

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
            places = np.asarray(getattr(self, name))
            if places.shape != (count,) or places.dtype.kind not in "iu":
                raise ShapeError(f"known {name}: expected {count} whole numbers, got {_described(places)}")
            object.__setattr__(self, name, places.astype(np.int32, copy=False))
        for name in ("near", "far", "coverage", "front", "back"):
            values = getattr(self, name)
            if values is None and name in ("front", "back"):
                continue
            values = np.asarray(values)
            wanted = (count, 3) if name in ("front", "back") else (count,)
            if values.shape != wanted:
                raise ShapeError(f"known {name}: expected shape {wanted}, got {values.shape}")
            check_finite(f"known {name}", values)
            object.__setattr__(self, name, np.ascontiguousarray(values, np.float32))
        self._check_values()

    def _check_values(self) -> None:
        if (self.front is None) != (self.back is None):
            raise ParameterError("known front", "colours of both surfaces or of none", shown="those of one")
        if not len(self.rows):
            return
        low, high = float(self.coverage.min()), float(self.coverage.max())
        if low < 0 or high > 1:
            raise ParameterError("known coverage", "0 to 1", shown=f"{low:g} to {high:g}")
        if (self.far > self.near).any():
            found = f"{int((self.far > self.near).sum())} that are nearer"
            raise ParameterError("known far", "values not above `near`", shown=found)
        if self.rows.min() < 0 or self.columns.min() < 0:
            raise ParameterError("known rows", "rows and columns from 0 up", shown="one below 0")
        step, along = np.diff(self.rows), np.diff(self.columns)
        if (step < 0).any() or ((step == 0) & (along <= 0)).any():
            way_out = "sort them by row, then by column, each once"
            raise ParameterError("known rows", "pixels row by row", shown="others", remedy=way_out)

    @property
    def nbytes(self) -> int:
        """Bytes that it takes."""
        arrays = (getattr(self, name) for name in _ARRAYS)
        return sum(array.nbytes for array in arrays if isinstance(array, np.ndarray))

    def check_within(self, height: int, width: int) -> None:
        """Raise ``ParameterError`` unless all pixels are of a picture of that size."""
        if len(self.rows) and (self.rows[-1] >= height or self.columns.max() >= width):
            found = f"row {self.rows[-1]}, column {self.columns.max()}"
            raise ParameterError("known rows", f"pixels of a picture of {width}x{height}", shown=found)

    def in_rows(self, first: int, last: int) -> "KnownSurfaces":
        """Those in the rows from ``first`` up to ``last``, which count from ``first`` then."""
        found = slice(*np.searchsorted(self.rows, (first, last)))
        return replace(self._chosen(found), rows=self.rows[found] - np.int32(first))

    def below(self, rows: int) -> "KnownSurfaces":
        """The same where so many rows are put above the picture."""
        return replace(self, rows=self.rows + np.int32(rows))

    def taken(self, wanted: npt.NDArray[np.bool_]) -> "KnownSurfaces":
        """Those for which ``wanted``, (N,), is true."""
        return self._chosen(wanted)

    def _chosen(self, chosen: Any) -> "KnownSurfaces":
        arrays: dict[str, Any] = {
            name: None if getattr(self, name) is None else getattr(self, name)[chosen] for name in _ARRAYS
        }
        return replace(self, **arrays)

    def at_most(self, radius: float) -> "KnownSurfaces":
        """The same with no surface blurred more than that."""
        return replace(self, near=np.clip(self.near, -radius, radius), far=np.clip(self.far, -radius, radius))

    def laid_over(self, values: Array) -> tuple[Array, Array]:
        """A map (H, W) with the nearer surfaces laid over it, and with the farther ones."""
        nearest, farthest = values.copy(), values.copy()
        nearest[self.rows, self.columns], farthest[self.rows, self.columns] = self.near, self.far
        return nearest, farthest

    def in_light(self, formula: Callable[[Array], Array]) -> "KnownSurfaces":
        """The same with ``formula`` applied to all colours, (N, 3)."""
        if self.front is None or self.back is None or not len(self.rows):
            return self
        return replace(self, front=formula(self.front), back=formula(self.back))

    def without_colors(self) -> "KnownSurfaces":
        """The same where colours are not known, as for another picture of the same surfaces."""
        return replace(self, front=None, back=None)


def joined_surfaces(parts: Sequence[KnownSurfaces]) -> KnownSurfaces | None:
    """The pixels of several parts, each below the one before it, as one; None where there are no parts."""
    if not parts:
        return None
    arrays: dict[str, Any] = {
        name: None if getattr(parts[0], name) is None else np.concatenate([getattr(p, name) for p in parts])
        for name in _ARRAYS
    }
    return replace(parts[0], **arrays)


def _described(array: npt.NDArray[Any]) -> str:
    return f"{array.dtype} of shape {array.shape}"
