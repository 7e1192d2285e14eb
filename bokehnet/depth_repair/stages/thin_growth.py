"""Growth of thin structures: blades, twigs and spokes of which a map has kept only the thick end.

Method: seeded region growing (Adams and Bischof, "Seeded region growing", IEEE TPAMI 1994) from the near side
of all depth edges. A pixel beside a near one joins it if its colour is that of near pixels around it and not
that of far ones. Growth starts at the ends of pieces, not at the sides of surfaces, and only growth that is
thin stays. As growth follows colours, the acceptance of the repair says little about it. Hence only maps
without any thin structure (:func:`thin_fraction`) are grown.

In: the picture, scene-linear (H, W, 3), and the map (H, W), any unit, rising towards the camera. Out: the map
in the same unit, nowhere farther away.
"""

import numpy as np
from numba import prange

from bokehnet.arrays.square_windows import dilated, reduce_windows
from bokehnet.classical.parallel import parallel_region
from bokehnet.depth_repair.config import (
    COLOR_SIGMA,
    GROWTH_RADIUS_PX,
    MAX_HALF_WIDTH_PX,
    MAX_NEAR_FRACTION,
    MIN_WEIGHT,
    MIN_WEIGHT_RATIO,
    NEAR_PX,
)
from bokehnet.depth_repair.filters import local_extremes, shift_edges
from bokehnet.kernels import njit
from bokehnet.optics.encoding import encode

__all__ = ["grow_thin_structures", "thin_fraction"]


@njit(cache=True, parallel=True)
def _joined(colors, disparity, ys, xs, min_height, values):  # type: ignore[no-untyped-def]
    """Fill ``values`` with the disparity of the near side that each pixel joins, or with its own."""
    height, width = disparity.shape
    factor = 1.0 / (COLOR_SIGMA * COLOR_SIGMA)
    for i in prange(len(ys)):
        y, x = ys[i], xs[i]
        own = near = disparity[y, x]
        for v in range(max(0, y - 1), min(height, y + 2)):
            for u in range(max(0, x - 1), min(width, x + 2)):
                near = max(near, disparity[v, u])
        values[i] = own
        if near <= own + min_height:
            continue
        middle = 0.5 * (near + own)
        near_sum = far_sum = highest = 0.0
        near_count = far_count = 0
        for v in range(max(0, y - GROWTH_RADIUS_PX), min(height, y + GROWTH_RADIUS_PX + 1)):
            for u in range(max(0, x - GROWTH_RADIUS_PX), min(width, x + GROWTH_RADIUS_PX + 1)):
                value = disparity[v, u]
                if value >= near + min_height or (v == y and u == x):
                    continue
                distance_squared = 0.0
                for c in range(3):
                    distance_squared += (colors[v, u, c] - colors[y, x, c]) ** 2
                weight = 1.0 / (1.0 + factor * distance_squared) ** 2
                if value > middle:
                    near_sum, near_count = near_sum + weight, near_count + 1
                    highest = max(highest, weight)
                else:
                    far_sum, far_count = far_sum + weight, far_count + 1
        if (
            near_count <= MAX_NEAR_FRACTION * (near_count + far_count)
            and near_sum * far_count > MIN_WEIGHT_RATIO * far_sum * near_count
            and highest > MIN_WEIGHT
        ):
            values[i] = near


def grow_thin_structures(image: np.ndarray, disparity: np.ndarray, min_height: float) -> np.ndarray:
    """Return the map with its thin structures grown along their colours.

    Args:
        image: All-in-focus picture, scene-linear, not negative, (H, W, 3).
        disparity: Map, (H, W), float32, any unit, rising towards the camera.
        min_height: Minimum height of a depth edge, in the unit of the map.

    Returns:
        New map, (H, W), nowhere farther away than the input; each new value is that of a near pixel.
    """
    colors = np.asarray(encode(np.minimum(image, 1.0)), np.float32)
    result = disparity.copy()
    border = reduce_windows(disparity, 1, np.maximum) > disparity + min_height
    while border.any():
        ys, xs = np.nonzero(border)
        values = np.empty(len(ys), np.float32)
        with parallel_region:
            _joined(colors, result, ys, xs, min_height, values)
        joined = values > result[ys, xs]
        result[ys[joined], xs[joined]] = values[joined]
        new = np.zeros(border.shape, bool)
        new[ys[joined], xs[joined]] = True
        border = dilated(new, 1) & ~new
    return np.where(_thin_pixels(result, MAX_HALF_WIDTH_PX, min_height), result, disparity)


def thin_fraction(disparity: np.ndarray, min_height: float) -> float:
    """Return the number of pixels on structures at most 4 pixels wide per pixel next to a depth edge.

    Args:
        disparity: Map with sharp edges, (H, W), any unit, rising towards the camera.
        min_height: Minimum height of a depth edge, in the unit of the map.
    """
    low, high = local_extremes(disparity, NEAR_PX)
    edges = int((high - low > min_height).sum())
    return float(_thin_pixels(disparity, NEAR_PX, min_height).sum()) / max(edges, 1)


def _thin_pixels(disparity: np.ndarray, half_width: int, min_height: float) -> np.ndarray:
    """Return the pixels that a morphological opening removes, (H, W) bool (top-hat transform)."""
    opened = shift_edges(shift_edges(disparity, -half_width), half_width)
    return np.asarray(disparity > opened + min_height)
