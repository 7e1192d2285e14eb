"""Rounding to few levels without bands: each pixel rounds at a threshold of its own."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["quantise"]

# The plastic number p, p^3 = p + 1: multiples of (1/p, 1/p^2) fill the plane most evenly.
_P = 1.32471795724474602596
_STEP_X, _STEP_Y = 1 / _P, 1 / _P**2

# Below a half, so that a value within 0.001 of a level goes to that level.
_WIDTH = 0.998


def quantise(values: NDArray[Any], bits: int, *, top: int | None = None) -> NDArray[np.unsignedinteger[Any]]:
    """Round values in [0, 1] to unsigned integers.

    With ``top``, the threshold depends on the place of a pixel: over a few pixels the mean is that of the
    values, so that slopes show no bands. It is the same each time, and however the picture is cut into rows.
    What is on a level already stays there, and what is grey stays grey.

    Args:
        values: (rows, W, C).
        bits: 8 to 16.
        top: Row of the picture that is the first one here; None rounds to the nearest level.

    Source: Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018 (the thresholds);
        Ulichney, "Digital halftoning", 1987 (ordered dither).
    """
    most = 2**bits - 1
    if top is None:
        scaled = np.asarray(values, np.float64) * most
    else:
        rows, columns = values.shape[:2]
        scaled = np.multiply(values, most, dtype=np.float32)
        across = np.arange(columns) * _STEP_X % 1
        down = (np.arange(rows) + top) * _STEP_Y % 1
        threshold = down.astype(np.float32)[:, None] + across.astype(np.float32)
        threshold -= threshold >= 1
        threshold -= np.float32(0.5)
        threshold *= np.float32(_WIDTH)
        scaled += threshold[..., None]
    np.rint(scaled, out=scaled)
    return np.clip(scaled, 0, most, out=scaled).astype(np.uint8 if bits == 8 else np.uint16)
