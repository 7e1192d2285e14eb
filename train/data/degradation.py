"""Deterministic degradations of a disparity map, for evaluation with wrong depth."""

import numpy as np
from scipy.ndimage import gaussian_filter, maximum_filter, minimum_filter

from bokehnet.checks import check_choice

__all__ = ["DEGRADATIONS", "DEGRADED", "EDGE_SHIFT", "degrade"]

DEGRADATIONS = ("clean", "blurred", "eroded", "dilated", "quantised")
DEGRADED = ("blurred", "eroded", "dilated")  # their mean is reported as "degraded"
EDGE_SHIFT = 2  # a window of five pixels

_SIGMA = 3.0
_LEVELS = 256


def degrade(disparity: np.ndarray, name: str, edge_shift: int = EDGE_SHIFT) -> np.ndarray:
    """Return a degraded copy of ``disparity``.

    - ``clean``: unchanged.
    - ``blurred``: Gaussian blur, sigma 3 px.
    - ``eroded``: minimum over a square window; near objects lose ``edge_shift`` pixels on every side.
    - ``dilated``: maximum over the same window; near objects gain as many pixels.
    - ``quantised``: 256 levels between the map's minimum and maximum, as in an 8-bit file.

    All commute with a change of scale and offset, so the function also accepts defocus, which is linear in
    disparity. The border is repeated.

    Args:
        disparity: Disparity or defocus on any scale, larger is nearer, (H, W).
        name: One of ``DEGRADATIONS``.
        edge_shift: Pixels by which edges move; the window's side is ``2 * edge_shift + 1``.

    Returns:
        Map (H, W) of the same type.

    Raises:
        ParameterError: Unknown name.
    """
    check_choice("name", name, DEGRADATIONS)
    side = 2 * edge_shift + 1
    if name == "blurred":
        changed = gaussian_filter(disparity, _SIGMA, mode="nearest")
    elif name == "eroded":
        changed = minimum_filter(disparity, side, mode="nearest")
    elif name == "dilated":
        changed = maximum_filter(disparity, side, mode="nearest")
    elif name == "quantised":
        low, high = float(disparity.min()), float(disparity.max())
        step = (high - low) / (_LEVELS - 1) or 1.0
        changed = low + step * np.rint((disparity - low) / step)
    else:
        changed = disparity.copy()
    return np.asarray(changed, disparity.dtype)
