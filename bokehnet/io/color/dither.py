"""Quantisation without bands: each pixel has its own rounding threshold."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["quantise"]

# The plastic number p, p^3 = p + 1: multiples of (1/p, 1/p^2) have low discrepancy in the plane.
_P = 1.32471795724474602596
_STEP_X, _STEP_Y = 1 / _P, 1 / _P**2

# Threshold range in levels, below 1, so that a value within 0.001 of a level is rounded to that level.
_THRESHOLD_RANGE = 0.998


def quantise(values: NDArray[Any], bits: int, *, top: int | None = None) -> NDArray[np.unsignedinteger[Any]]:
    """Round values in [0, 1] to unsigned integers.

    With ``top``, the threshold depends on the pixel position: over a few pixels the mean is that of the
    values, so that gradients show no bands. It is deterministic and independent of the division into row
    bands. Values on a level are unchanged, and grey remains grey.

    Args:
        values: Values in [0, 1], (rows, W, C).
        bits: 8 to 16.
        top: Row of the picture of the first row in ``values``; None rounds to the nearest level.

    Source: Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018 (the thresholds);
        Ulichney, "Digital halftoning", 1987 (ordered dither).
    """
    max_level = 2**bits - 1
    if top is None:
        scaled = np.asarray(values, np.float64) * max_level
    else:
        rows, columns = values.shape[:2]
        scaled = np.multiply(values, max_level, dtype=np.float32)
        across = np.arange(columns) * _STEP_X % 1
        down = (np.arange(rows) + top) * _STEP_Y % 1
        threshold = down.astype(np.float32)[:, None] + across.astype(np.float32)
        threshold -= threshold >= 1
        threshold -= np.float32(0.5)
        threshold *= np.float32(_THRESHOLD_RANGE)
        scaled += threshold[..., None]
    np.rint(scaled, out=scaled)
    return np.clip(scaled, 0, max_level, out=scaled).astype(np.uint8 if bits == 8 else np.uint16)
