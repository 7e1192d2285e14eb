"""Conversion of the grey values of a stored depth map to disparity, shared by all phones."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["DepthCoding", "StoredDepth"]


@dataclass(frozen=True, kw_only=True, slots=True)
class DepthCoding:
    """Mapping of stored values in [0, 1] to inverse depth.

    Attributes:
        ends: Inverse depth of the stored values 0 and 1, 1/unit; they differ.
        linear_in: Quantity that is linear in the stored value: ``"disparity"`` or ``"depth"`` (then both
            ends are finite and above 0).
        unit: Length of the unit, mm; None if the photo does not state it, so that only the order and the
            proportions of the inverse depths are known.
    """

    ends: tuple[float, float]
    linear_in: str = "disparity"
    unit: float | None = None

    def decode(self, stored: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return disparity, larger is nearer: in 1/mm, or in [0, 1] between the ends if the unit is unknown.

        Args:
            stored: Grey values in [0, 1], any shape.
        """
        first, last = self.ends
        values = stored.astype(np.float64)
        if self.linear_in == "disparity":
            disparity = first + (last - first) * values
        else:
            disparity = 1 / ((1 - values) / first + values / last)
        return self._in_unit(disparity).astype(np.float32)

    def focus(self, disparity: float) -> float | None:
        """Convert an inverse focus distance, 1/unit, to the scale of :meth:`decode`; None if invalid."""
        if not (math.isfinite(disparity) and disparity >= 0):
            return None
        value = float(self._in_unit(np.float64(disparity)))
        return value if self.unit is not None else min(max(value, 0.0), 1.0)

    def _in_unit(self, disparity: NDArray[np.float64] | np.float64) -> NDArray[np.float64]:
        if self.unit is not None:
            return np.asarray(disparity / self.unit)
        low, high = min(self.ends), max(self.ends)
        return np.asarray((disparity - low) / (high - low))


@dataclass(frozen=True, kw_only=True, slots=True)
class StoredDepth:
    """Encoded depth map of a photo.

    Attributes:
        picture: JPEG or PNG file, grey.
        coding: Mapping of its values to inverse depth.
        focus: Inverse of the distance in focus, 1/unit of the coding; None if the photo does not state it.
        original: Picture before the phone blurred it, a JPEG or PNG file, or None.
    """

    picture: bytes
    coding: DepthCoding
    focus: float | None = None
    original: bytes | None = None
