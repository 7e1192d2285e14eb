"""N-buffers: bounds of a map over squares around any pixel, by few lookups.

Like mip-maps, but all levels have the size of the map, so that squares can start at any pixel.

Source: Decoret, "N-buffers for efficient depth map query", Eurographics 2005; thesis 001, 3.2.3.
"""

import numpy as np

from bokehnet.kernels import njit

__all__ = ["n_buffers", "radius_bounds"]


def n_buffers(values: np.ndarray, others: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Return minima of ``values`` and maxima of ``others`` over squares of 2^i pixels, (levels, H, W).

    Level i at (y, x) covers the square of side 2^i with its upper left corner at (y, x); border values extend
    outside the map.

    Args:
        values: Map of the minima, (H, W).
        others: Map of the maxima, (H, W); default: ``values``.
    """
    height, width = values.shape
    low, high = [values], [values if others is None else others]
    step = 1
    while step < max(height, width):
        down, right = (
            np.minimum(np.arange(height) + step, height - 1),
            np.minimum(np.arange(width) + step, width - 1),
        )
        for pyramid, extreme in ((low, np.minimum), (high, np.maximum)):
            last = pyramid[-1]
            pyramid.append(extreme(extreme(last, last[down]), extreme(last[:, right], last[down][:, right])))
        step *= 2
    return np.stack(low), np.stack(high)


@njit(cache=True)
def radius_bounds(low, high, y, x, reach):
    """Return minimum and maximum within at least ``reach`` pixels of (y, x), by four lookups each."""
    height, width = low.shape[1], low.shape[2]
    side = 2 * reach + 1
    level = 0
    while 2 << level <= side and level + 1 < low.shape[0]:
        level += 1
    back = side - (1 << level)
    minimum, maximum = np.inf, -np.inf
    for j in (y - reach, y - reach + back):
        for i in (x - reach, x - reach + back):
            b, a = min(max(j, 0), height - 1), min(max(i, 0), width - 1)
            minimum, maximum = min(minimum, low[level, b, a]), max(maximum, high[level, b, a])
    return minimum, maximum
