"""Display matrices of videos: rotation by quarter turns, and flips."""

import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["IDENTITY", "DisplayMatrix"]

# One in the first six numbers, 16.16 fixed point, and in the last one, 2.30.
_ONE, _LAST_ONE = 1 << 16, 1 << 30

# Largest deviation of a coefficient from 0, 1 and -1.
_TOLERANCE = 0.01


@dataclass(frozen=True, kw_only=True, slots=True)
class DisplayMatrix:
    """Transformation from stored to shown pictures: exchange of axes, then flips.

    Attributes:
        transposed: True if stored columns are shown as rows.
        flipped_rows: True if rows are then shown from the last to the first.
        flipped_columns: True if columns are then shown from the last to the first.

    Source: ISO/IEC 14496-12, "ISO base media file format", 2022, 6.2.2 and 8.3.2: a stored point (p, q) is
    shown at (a p + c q + x, b p + d q + y).

    Examples:
        >>> phone = DisplayMatrix.parsed((0, 65536, 0, -65536, 0, 0, 0, 0, 1 << 30))  # clockwise
        >>> phone.shown(np.array([[1, 2], [3, 4]])).tolist()
        [[3, 1], [4, 2]]
        >>> phone.stored(phone.shown(np.array([[1, 2], [3, 4]]))).tolist()
        [[1, 2], [3, 4]]
    """

    transposed: bool = False
    flipped_rows: bool = False
    flipped_columns: bool = False

    @classmethod
    def parsed(cls, numbers: tuple[int, ...]) -> "DisplayMatrix | None":
        """Return the transformation of nine stored numbers; None unless it is of quarter turns and flips."""
        a, b, c, d = (numbers[index] / _ONE for index in (0, 1, 3, 4))
        straight, crossed = (abs(a), abs(d)), (abs(b), abs(c))
        if np.allclose((*straight, *crossed), (1, 1, 0, 0), atol=_TOLERANCE):
            return cls(flipped_rows=d < 0, flipped_columns=a < 0)
        if np.allclose((*straight, *crossed), (0, 0, 1, 1), atol=_TOLERANCE):
            return cls(transposed=True, flipped_rows=b < 0, flipped_columns=c < 0)
        return None

    @classmethod
    def of_frame(cls, frame: Any) -> "DisplayMatrix | None":
        """Return the transformation of a decoded frame; None as for :meth:`parsed`."""
        for data in frame.side_data:
            if data.type.name == "DISPLAYMATRIX":
                return cls.parsed(struct.unpack("=9i", bytes(data)[:36]))
        return IDENTITY

    @property
    def numbers(self) -> list[int]:
        """Nine numbers as stored in files, without a translation."""
        row, column = (-_ONE if flipped else _ONE for flipped in (self.flipped_rows, self.flipped_columns))
        if self.transposed:
            return [0, row, 0, column, 0, 0, 0, 0, _LAST_ONE]
        return [column, 0, 0, 0, row, 0, 0, 0, _LAST_ONE]

    def shown(self, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return a stored picture or map, (H, W) or (H, W, C), as shown."""
        values = values.swapaxes(0, 1) if self.transposed else values
        values = values[::-1] if self.flipped_rows else values
        return np.ascontiguousarray(values[:, ::-1] if self.flipped_columns else values)

    def stored(self, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return a shown picture or map as stored: the inverse of :meth:`shown`."""
        values = values[:, ::-1] if self.flipped_columns else values
        values = values[::-1] if self.flipped_rows else values
        return np.ascontiguousarray(values.swapaxes(0, 1) if self.transposed else values)


IDENTITY = DisplayMatrix()
