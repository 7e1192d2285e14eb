"""Enlargement: apply the changes of a repaired small map to the larger map, at the edges of its picture.

Method: changed pixels come from the enlarged small map, whose edges are sharpened; weighted medians
(:func:`bokehnet.depth_repair.stages.deblur.snap_soft_edges`) then move them to the colour edges of the larger
picture. The setting, a small map and a large picture, is that of Kopf, Cohen, Lischinski and Uyttendaele,
"Joint bilateral upsampling", ACM TOG 2007.

In: the picture, scene-linear (H, W, 3), the larger map (H, W) and the repaired map at half its size, in one
unit. Out: the larger map with the changes.
"""

import numpy as np

from bokehnet.arrays.pyramid import upsample2
from bokehnet.arrays.row_blocks import make_in_row_blocks
from bokehnet.arrays.square_windows import dilated
from bokehnet.depth_repair.config import BLOCK_PX, MIN_EDGE_HEIGHT, NEAR_PX
from bokehnet.depth_repair.filters import extend_rows, local_extremes
from bokehnet.depth_repair.stages.deblur import MEDIAN_HALO_PX, snap_soft_edges
from bokehnet.depth_repair.stages.sharpen import repair_soft_edges

__all__ = ["enlarge_changes"]


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
    span = float(np.ptp(disparity))
    min_height = MIN_EDGE_HEIGHT * span
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
    sharp = repair_soft_edges(joined)
    near: np.ndarray = np.broadcast_to(np.True_, disparity.shape)
    if not sharpen:
        near = dilated(moved_at, BLOCK_PX // 2)
        if allowed is not None:
            near &= allowed

    def align(rows: slice) -> np.ndarray:
        window, inner = extend_rows(rows, MEDIAN_HALO_PX)
        low, high = local_extremes(sharp[window], NEAR_PX)
        at_edges = near[window] & (high - low > min_height)
        aligned = sharp[window]
        if at_edges.any():
            aligned = snap_soft_edges(image[window], aligned, at_edges, span)
        return np.where(near[rows], aligned[inner], disparity[rows])

    return make_in_row_blocks(align, disparity.shape, np.float32)
