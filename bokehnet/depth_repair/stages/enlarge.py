"""Enlargement: apply the changes of a repaired small map to the larger map, at the edges of its picture.

Method: changed pixels come from the enlarged small map, whose edges are sharpened; a two-class colour test
beside each edge then moves it by up to two pixels. The mean colours of the near and the far side in a window
define two classes; the evidence of a pixel is its relative distance from both means. A pixel changes sides if
the mean evidence of its 3x3 window is clear. The setting, a small map and a large picture, is that of Kopf,
Cohen, Lischinski and Uyttendaele, "Joint bilateral upsampling", ACM TOG 2007; the choice between two sides is
ours.

In: the picture, scene-linear (H, W, 3), the larger map (H, W) and the repaired map at half its size, in one
unit. Out: the larger map with the changes.
"""

import math

import numpy as np
from numba import prange

from bokehnet.arrays.pyramid import upsample2
from bokehnet.arrays.row_blocks import make_in_row_blocks
from bokehnet.classical.parallel import parallel_region
from bokehnet.depth_repair.config import MIN_EDGE_HEIGHT
from bokehnet.depth_repair.filters import local_extremes
from bokehnet.depth_repair.stages.sharpen import repair_soft_edges
from bokehnet.kernels import njit

__all__ = ["align_edges", "enlarge_changes"]

# Half width of the window beside an edge in which a pixel may change sides, pixels: the uncertainty of a map
# after doubling its size.
_MAX_SHIFT_PX = 2

# Half width of the window for the mean colours of both sides, pixels.
_COLOR_RADIUS_PX = 6

# Minimum mean evidence of a pixel and its neighbours for a change of sides; evidence ranges from -1 to 1.
_MIN_EVIDENCE = 0.2

# Distance from a change within which edges are sharpened and aligned, pixels.
_NEAR_CHANGE_PX = 5

# Rows per pass, which bounds the memory of the evidence.
_ROWS_PER_PASS = 512


@njit(cache=True)
def _local_range(disparity, y, x):  # type: ignore[no-untyped-def]
    """Return the lowest and highest value in the window of a pixel."""
    low = high = disparity[y, x]
    for v in range(max(0, y - _MAX_SHIFT_PX), min(disparity.shape[0], y + _MAX_SHIFT_PX + 1)):
        for u in range(max(0, x - _MAX_SHIFT_PX), min(disparity.shape[1], x + _MAX_SHIFT_PX + 1)):
            low, high = min(low, disparity[v, u]), max(high, disparity[v, u])
    return low, high


@njit(cache=True)
def _is_at_edge(disparity, y, x, middle):  # type: ignore[no-untyped-def]
    """Return whether a 4-neighbour lies on the other side of ``middle``, so that colours may be mixed."""
    near = disparity[y, x] > middle
    return (
        (y > 0 and (disparity[y - 1, x] > middle) != near)
        or (y + 1 < disparity.shape[0] and (disparity[y + 1, x] > middle) != near)
        or (x > 0 and (disparity[y, x - 1] > middle) != near)
        or (x + 1 < disparity.shape[1] and (disparity[y, x + 1] > middle) != near)
    )


@njit(cache=True, parallel=True)
def _gather_evidence(image, disparity, min_height, first, evidence):  # type: ignore[no-untyped-def]
    """Fill ``evidence`` from row ``first``: 1 for the colour of the near side, -1 for the far side."""
    height, width = disparity.shape
    for row in prange(evidence.shape[0]):
        y = first + row
        sums = np.empty((2, 4))
        for x in range(width):
            evidence[row, x] = 0.0
            low, high = _local_range(disparity, y, x)
            if high - low <= min_height:
                continue
            middle = 0.5 * (low + high)
            sums[:] = 0.0
            for v in range(max(0, y - _COLOR_RADIUS_PX), min(height, y + _COLOR_RADIUS_PX + 1)):
                for u in range(max(0, x - _COLOR_RADIUS_PX), min(width, x + _COLOR_RADIUS_PX + 1)):
                    if not _is_at_edge(disparity, v, u, middle):
                        side = 1 if disparity[v, u] > middle else 0
                        for c in range(3):
                            sums[side, c] += math.sqrt(image[v, u, c])
                        sums[side, 3] += 1.0
            if sums[0, 3] == 0.0 or sums[1, 3] == 0.0:
                continue
            far_distance = near = 1e-6
            for c in range(3):
                value = math.sqrt(image[y, x, c])
                far_distance += (value - sums[0, c] / sums[0, 3]) ** 2
                near += (value - sums[1, c] / sums[1, 3]) ** 2
            evidence[row, x] = (far_distance - near) / (far_distance + near)


@njit(cache=True, parallel=True)
def _change_sides(disparity, evidence, first, top, bottom, result):  # type: ignore[no-untyped-def]
    """Fill rows ``top`` to ``bottom`` with the value of the side that the evidence supports."""
    width = disparity.shape[1]
    for y in prange(top, bottom):
        for x in range(width):
            result[y, x] = disparity[y, x]
            if evidence[y - first, x] == 0.0:
                continue
            total, count = 0.0, 0
            for v in range(max(0, y - first - 1), min(evidence.shape[0], y - first + 2)):
                for u in range(max(0, x - 1), min(width, x + 2)):
                    total += evidence[v, u]
                    count += evidence[v, u] != 0.0
            low, high = _local_range(disparity, y, x)
            near = disparity[y, x] > 0.5 * (low + high)
            if near and total < -_MIN_EVIDENCE * count:
                result[y, x] = low
            elif not near and total > _MIN_EVIDENCE * count:
                result[y, x] = high


def align_edges(image: np.ndarray, disparity: np.ndarray, min_height: float) -> np.ndarray:
    """Return the map with its edges moved by up to two pixels to the colour edges of the picture.

    The mean colours of both sides exclude the pixels at the edge itself, which may be mixed.

    Args:
        image: All-in-focus picture, scene-linear, not negative, (H, W, 3).
        disparity: Map with sharp edges, (H, W), any unit.
        min_height: Minimum height of a depth edge, in the unit of the map.

    Returns:
        New map, (H, W).

    Source:
        Kopf, Cohen, Lischinski and Uyttendaele, "Joint bilateral upsampling", ACM TOG 2007, for a small
        map brought to the edges of a large picture; the choice between two sides is ours.
    """
    disparity = np.ascontiguousarray(disparity)
    height, width = disparity.shape
    result = np.empty_like(disparity)
    for top in range(0, height, _ROWS_PER_PASS):
        bottom = min(top + _ROWS_PER_PASS, height)
        first, last = max(0, top - 1), min(height, bottom + 1)
        evidence = np.empty((last - first, width), np.float32)
        with parallel_region:
            _gather_evidence(image, disparity, min_height, first, evidence)
            _change_sides(disparity, evidence, first, top, bottom, result)
    return result


def enlarge_changes(
    image: np.ndarray,
    disparity: np.ndarray,
    repaired_small: np.ndarray,
    change: np.ndarray,
    allowed: np.ndarray | None,
    *,
    sharpen: bool,
) -> np.ndarray:
    """Return a map with the changes of the repair at half its size, at the edges of the larger picture.

    Args:
        image: Picture, scene-linear, not negative, (H, W, 3).
        disparity: Map, (H, W).
        repaired_small: Repaired map at half the size, (H / 2, W / 2), rounded up.
        change: Change by the repair at half the size, of the same shape.
        allowed: Pixels that may change, (H, W) bool; None for all.
        sharpen: True to sharpen and align all edges, not only those near changes, as in soft maps. In sharp
            maps this degrades accurately placed thin structures in front of others.
    """
    min_height = MIN_EDGE_HEIGHT * float(np.ptp(disparity))
    moved_at = np.zeros(disparity.shape, np.bool_)

    def make(rows: slice) -> np.ndarray:
        top = max(0, rows.start // 2 - 1)
        window = slice(top, -(-rows.stop // 2) + 1)
        inner = slice(rows.start - 2 * top, rows.stop - 2 * top)
        coarse, moved = (upsample2(x[window])[inner, : disparity.shape[1]] for x in (repaired_small, change))
        moved_at[rows] = np.abs(moved) > min_height
        return np.where(moved_at[rows], coarse, disparity[rows])

    joined = make_in_row_blocks(make, disparity.shape, np.float32)
    if not sharpen and not moved_at.any():
        return disparity
    result = align_edges(image, repair_soft_edges(joined), min_height)
    if not sharpen:
        near = local_extremes(moved_at, _NEAR_CHANGE_PX)[1]
        if allowed is not None:
            near &= allowed
        np.copyto(result, disparity, where=~near)
    return result
