"""Wrong disparity, always the same way: what engines are given in place of the true map."""

import numpy as np
from scipy.ndimage import gaussian_filter, maximum_filter, minimum_filter

from bokehnet.checks import check_choice

__all__ = ["DEGRADATIONS", "DEGRADED", "EDGE_SHIFT", "degrade"]

DEGRADATIONS = ("clean", "blurred", "eroded", "dilated", "quantised")
DEGRADED = ("blurred", "eroded", "dilated")  # their mean is told as "degraded"
EDGE_SHIFT = 2  # a window of five pixels

_SIGMA = 3.0
_LEVELS = 256


def degrade(disparity: np.ndarray, name: str, edge_shift: int = EDGE_SHIFT) -> np.ndarray:
    """Return a copy of ``disparity`` that is wrong in one way.

    - ``clean``: as it is.
    - ``blurred``: by a Gaussian of 3 px.
    - ``eroded``: the least value of a square window; near things lose ``edge_shift`` pixels on every side.
    - ``dilated``: its largest value; near things gain as much.
    - ``quantised``: to 256 levels from the map's least to its largest value, as in an 8-bit file.

    All commute with a change of scale and of offset, so defocus, which is linear in disparity, may be given
    as well. The border is repeated.

    Args:
        disparity: Near is large, any scale, (H, W).
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
