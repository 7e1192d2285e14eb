"""Overshoots of a soft map at depth edges (ringing, Gibbs phenomenon): removal.

Depth networks and interpolation filters overshoot at edges: the near side rises before it falls, and the far
side falls below its surface. Sharpening spreads these extremes, so that a head gets a rim with another blur
than its centre.

Method: clamp values at edges to the range of nearby flat regions. A region is flat if its local range is
small compared with the range of the surroundings. Only excesses of 1.5 % to 12 % of the edge height are
clamped: larger ones are separate objects. Slopes are flat up to their end, and a wire has no flat region at
its own height.

In: a soft map (H, W), any unit and offset. Out: the map in the same unit.
"""

import numpy as np

from bokehnet.arrays.row_blocks import make_in_row_blocks
from bokehnet.depth_repair.config import MIN_EDGE_HEIGHT
from bokehnet.depth_repair.filters import extend_rows, local_extremes

__all__ = ["overshoot_fraction", "remove_overshoots"]

# Half widths of the flatness window and of the search window for flat regions, pixels; maximum side of a map
# at this scale, pixels. Larger maps were enlarged together with their overshoots and are subsampled.
_FLAT_RADIUS_PX, _SEARCH_RADIUS_PX, _MAX_SIDE_PX = 2, 8, 1024

# Minimum and maximum overshoot, as fractions of the edge height; the minimum is also the flatness threshold.
# The Gibbs phenomenon has 0.09.
_MIN_OVERSHOOT, _MAX_OVERSHOOT = 0.015, 0.12


def remove_overshoots(disparity: np.ndarray) -> np.ndarray:
    """Return the map without overshoots at its edges, (H, W), float32.

    Args:
        disparity: Map with soft edges, (H, W), any unit and offset.
    """
    stride = max(disparity.shape) // _MAX_SIDE_PX
    if stride > 1:
        return _with_subsampled_changes(disparity, stride)
    min_height = MIN_EDGE_HEIGHT * float(np.ptp(disparity))

    def make(rows: slice) -> np.ndarray:
        window, inner = extend_rows(rows, 3 * _SEARCH_RADIUS_PX)
        values = np.asarray(disparity[window], np.float32)
        low, high = local_extremes(values, _SEARCH_RADIUS_PX)
        height, middle = high - low, (low + high) / 2
        lowest, highest = local_extremes(values, _FLAT_RADIUS_PX)
        wide_range = local_extremes(high, _SEARCH_RADIUS_PX)[1] - local_extremes(low, _SEARCH_RADIUS_PX)[0]
        uneven = highest - lowest > _MIN_OVERSHOOT * wide_range
        near_level = local_extremes(np.where(uneven, -np.inf, values), _SEARCH_RADIUS_PX)[1]
        far_level = local_extremes(np.where(uneven, np.inf, values), _SEARCH_RADIUS_PX)[0]

        def overshoots(excess: np.ndarray) -> np.ndarray:
            return (
                (height > min_height)
                & (excess > _MIN_OVERSHOOT * height)
                & (excess < _MAX_OVERSHOOT * height)
            )

        values = np.where(overshoots(values - near_level) & (near_level > middle), near_level, values)
        values = np.where(overshoots(far_level - values) & (far_level < middle), far_level, values)
        return np.asarray(values[inner], np.float32)

    return make_in_row_blocks(make, disparity.shape, np.float32)


def overshoot_fraction(disparity: np.ndarray, flat: np.ndarray) -> float:
    """Return the fraction of the pixels near depth edges that overshoot, 0 to 1.

    Args:
        disparity: Map, (H, W), any unit and offset.
        flat: The same map from :func:`remove_overshoots`.
    """
    stride = max(1, max(disparity.shape) // _MAX_SIDE_PX)
    disparity, flat = disparity[::stride, ::stride], flat[::stride, ::stride]
    low, high = local_extremes(disparity, _SEARCH_RADIUS_PX)
    near_edges = high - low > MIN_EDGE_HEIGHT * float(np.ptp(disparity))
    return float((near_edges & (flat != disparity)).sum() / max(near_edges.sum(), 1))


def _with_subsampled_changes(disparity: np.ndarray, stride: int) -> np.ndarray:
    """Return a map (H, W) with the changes of the map subsampled by ``stride``, enlarged by repetition."""
    subsampled = disparity[stride // 2 :: stride, stride // 2 :: stride]
    changes = remove_overshoots(subsampled) - subsampled
    columns = np.minimum(np.arange(disparity.shape[1]) // stride, changes.shape[1] - 1)

    def make(rows: slice) -> np.ndarray:
        source_rows = np.minimum(np.arange(*rows.indices(len(disparity))) // stride, len(changes) - 1)
        return np.asarray(disparity[rows] + changes[source_rows][:, columns], np.float32)

    return make_in_row_blocks(make, disparity.shape, np.float32)
