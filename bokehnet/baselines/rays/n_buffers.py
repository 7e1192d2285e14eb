"""Bounds of a map over squares around any pixel, by few look-ups: N-buffers.

They are like mip-maps, but all levels are of the map's own size, so that squares begin at any pixel.

Source: Decoret, "N-buffers for efficient depth map query", Eurographics 2005; thesis 001, 3.2.3.
"""

import numpy as np

from bokehnet.kernels import njit

__all__ = ["n_buffers", "radius_bounds"]


def n_buffers(values: np.ndarray, others: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Least of ``values`` and largest of ``others`` over squares of 1, 2, 4, ... pixels, (levels, H, W).

    Level i at (y, x) is of the square of side 2^i whose upper left corner is there; beyond the border the
    values at the border count.

    Args:
        values: (H, W).
        others: (H, W); default: the same.
    """
    height, width = values.shape
    low, high = [values], [values if others is None else others]
    step = 1
    while step < max(height, width):
        down, right = (
            np.minimum(np.arange(height) + step, height - 1),
            np.minimum(np.arange(width) + step, width - 1),
        )
        for kept, of in ((low, np.minimum), (high, np.maximum)):
            last = kept[-1]
            kept.append(of(of(last, last[down]), of(last[:, right], last[down][:, right])))
        step *= 2
    return np.stack(low), np.stack(high)


@njit(cache=True)
def radius_bounds(low, high, y, x, reach):  # type: ignore[no-untyped-def]
    """Least and largest value within ``reach`` pixels of (y, x), by four look-ups each; a little beyond."""
    height, width = low.shape[1], low.shape[2]
    side = 2 * reach + 1
    level = 0
    while 2 << level <= side and level + 1 < low.shape[0]:
        level += 1
    back = side - (1 << level)
    least, most = np.inf, -np.inf
    for j in (y - reach, y - reach + back):
        for i in (x - reach, x - reach + back):
            b, a = min(max(j, 0), height - 1), min(max(i, 0), width - 1)
            least, most = min(least, low[level, b, a]), max(most, high[level, b, a])
    return least, most
