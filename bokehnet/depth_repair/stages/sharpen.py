"""Soft depth edges: their pixels, the fraction of them, and their sharpening.

Method: the toggle mapping of Kramer and Bruckner, "Iterations of a non-linear transformation for enhancement
of digital images", Pattern Recognition 1975, in two passes: each value becomes the nearer of the extremes in
its window. Slopes, such as the ground, are excluded: a pixel lies on a slope if the map continues on both
sides with the same gradient.

In: a map (H, W), any unit. Out: the map with sharp edges, in the same unit.
"""

import numpy as np

from bokehnet.arrays.row_blocks import make_in_row_blocks
from bokehnet.arrays.square_windows import dilated
from bokehnet.depth_repair.config import (
    MAX_SLOPE_CHANGE,
    MIN_DISTANCE_FROM_EXTREMES,
    MIN_EDGE_HEIGHT,
    NEAR_PX,
    SHARPENING_RADII_PX,
    SLOPE_STRIDE_PX,
)
from bokehnet.depth_repair.filters import extend_rows, local_extremes

__all__ = [
    "repair_soft_edges",
    "slope_mask",
    "soft_edge_fraction",
    "soft_mask",
    "soft_pixels",
]

_SLOPE_HALO_PX = 3 * SLOPE_STRIDE_PX


def slope_mask(disparity: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Return which of some pixels lie on slopes: surfaces inclined to the image plane.

    Args:
        disparity: Map, (H, W), any unit.
        mask: Pixels to test, (H, W), bool.

    Returns:
        Pixels on slopes, (H, W), bool.
    """
    rows, columns = np.nonzero(mask)
    # Odd reflection continues slopes beyond the border.
    padded = np.pad(disparity, _SLOPE_HALO_PX, "reflect", reflect_type="odd")
    change, rise = np.zeros(len(rows), np.float32), np.zeros(len(rows), np.float32)
    for axis in (0, 1):
        line = []
        for position in (0, 2, 4, 6):
            shift = [_SLOPE_HALO_PX, _SLOPE_HALO_PX]
            shift[axis] = position * SLOPE_STRIDE_PX
            line.append(padded[rows + shift[0], columns + shift[1]])
        before, rise_at, after = np.diff(line, axis=0)
        change += np.abs(rise_at - before) + np.abs(rise_at - after)
        rise += np.abs(rise_at)
    on_slope = np.zeros(disparity.shape, bool)
    on_slope[rows, columns] = change < MAX_SLOPE_CHANGE * rise
    return on_slope


def soft_pixels(disparity: np.ndarray, min_height: float) -> np.ndarray:
    """Return the pixels between both sides of their edge, without slopes, (H, W) bool.

    Args:
        disparity: Map, (H, W), any unit.
        min_height: Minimum height of a depth edge, in the unit of the map.
    """

    def make(rows: slice) -> np.ndarray:
        window, inner = extend_rows(rows, _SLOPE_HALO_PX)
        values = disparity[window]
        low, high = local_extremes(values, NEAR_PX)
        nearer = np.minimum(high - values, values - low)
        soft = (nearer > MIN_DISTANCE_FROM_EXTREMES * (high - low)) & (high - low > min_height)
        soft &= ~slope_mask(values, soft)
        return soft[inner]

    return make_in_row_blocks(make, disparity.shape, np.bool_)


def soft_mask(disparity: np.ndarray, span: float) -> np.ndarray:
    """Return the surroundings of soft pixels, in which the position of an edge is uncertain, (H, W) bool.

    Args:
        disparity: Map, (H, W), any unit.
        span: Range of values that defines the minimum edge height.
    """
    return dilated(soft_pixels(disparity, MIN_EDGE_HEIGHT * span), NEAR_PX)


def soft_edge_fraction(disparity: np.ndarray, by_height: bool = True) -> float:
    """Return the fraction of edge pixels between both sides of their edge, 0 (all sharp) to 1.

    Args:
        disparity: Map, (H, W), any unit.
        by_height: True to weight pixels by the square of the edge height. Otherwise round and inclined
            surfaces make a map with few edges seem soft, although blur affects all edges, and so does noise
            that is as high as edges.
    """
    span = float(np.ptp(disparity))

    def make(rows: slice) -> np.ndarray:
        window, inner = extend_rows(rows, _SLOPE_HALO_PX)
        low, high = local_extremes(disparity[window], NEAR_PX)
        edges = high - low > MIN_EDGE_HEIGHT * span
        edges &= ~slope_mask(disparity[window], edges)
        return np.where(edges, ((high - low) / (span or 1)) ** (2 * by_height), 0)[inner]

    weights = make_in_row_blocks(make, disparity.shape, np.float32)
    total = float(weights.sum(dtype=float))
    soft = float(weights[soft_pixels(disparity, MIN_EDGE_HEIGHT * span)].sum(dtype=float))
    return soft / total if total else 0.0


def repair_soft_edges(disparity: np.ndarray, span: float | None = None) -> np.ndarray:
    """Return the map with soft edges made sharp at the middle between both sides, (H, W).

    Slopes do not change.

    Args:
        disparity: Map, (H, W), any unit.
        span: Range of values that defines the minimum edge height; default: the range of the map.

    Source:
        Kramer and Bruckner, "Iterations of a non-linear transformation for enhancement of digital images",
        Pattern Recognition 1975.
    """
    min_height = MIN_EDGE_HEIGHT * (np.ptp(disparity) if span is None else span)

    def make(rows: slice) -> np.ndarray:
        window, inner = extend_rows(rows, _SLOPE_HALO_PX + sum(SHARPENING_RADII_PX))
        sharp = values = disparity[window]
        for radius in SHARPENING_RADII_PX:
            low, high = local_extremes(sharp, radius)
            nearer = np.where(high - sharp < sharp - low, high, low)
            changed = (high - low > min_height) & (nearer != sharp)
            sharp = np.where(changed & ~slope_mask(values, changed), nearer, sharp)
        return sharp[inner]

    return make_in_row_blocks(make, disparity.shape, np.float32)
