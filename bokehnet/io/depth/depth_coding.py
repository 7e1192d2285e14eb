"""What the grey values of a stored depth map mean: one rule for every phone."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["DepthCoding", "StoredDepth"]


@dataclass(frozen=True, kw_only=True, slots=True)
class DepthCoding:
    """Stored values in [0, 1] as inverse depth.

    Attributes:
        ends: Inverse depth of the stored values 0 and 1, 1/unit; they differ.
        even: What rises evenly with the stored value: ``"disparity"`` or ``"depth"`` (then both ends are
            finite and above 0).
        unit: Length of the unit, mm; None when the photo does not tell, so that only the order and the
            proportions of the inverse depths are known.
    """

    ends: tuple[float, float]
    even: str = "disparity"
    unit: float | None = None

    def decode(self, stored: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return disparity, near is large: in 1/mm, or in [0, 1] between the ends where the unit is unknown.

        Args:
            stored: Grey values in [0, 1], any shape.
        """
        first, last = self.ends
        values = stored.astype(np.float64)
        if self.even == "disparity":
            disparity = first + (last - first) * values
        else:
            disparity = 1 / ((1 - values) / first + values / last)
        return self._in_unit(disparity).astype(np.float32)

    def focus(self, disparity: float) -> float | None:
        """Bring the inverse of a focus distance, 1/unit, to that of :meth:`decode`; None for nonsense."""
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
    """A depth map as a photo holds it, still encoded.

    Attributes:
        picture: A JPEG or PNG file, grey.
        coding: What its values mean.
        focus: Inverse of the distance in focus, 1/unit of the coding; None when the photo does not tell.
        original: The picture before the phone blurred it, a JPEG or PNG file, where the photo keeps it.
    """

    picture: bytes
    coding: DepthCoding
    focus: float | None = None
    original: bytes | None = None
