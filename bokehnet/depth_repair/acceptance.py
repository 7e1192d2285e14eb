"""How many steps of a map stand out of place; the repaired map taken where they do, place by place."""

from typing import NamedTuple

import numpy as np

from bokehnet.arrays.pyramid import pad_to_multiple
from bokehnet.depth_repair.network_tiles import BLOCK
from bokehnet.depth_repair.stages.edge_sharpening import STEP

__all__ = ["TakenMap", "count_misplaced", "misplaced_shares", "step_sizes", "take_misplaced"]

# Rows looked at together where the whole map is looked through.
_BLOCK_ROWS = 1024

# Part of a step from which on a pixel that changes by it stood out of place.
_PART = 0.25

# Blocks to either side that tell how right the map is at a place, 136 pixels a side in all.
_AROUND = 8

# Pixels at steps for which the share of the whole map counts, beside those around a place.
_PRIOR = 500

# Share of the pixels at steps that stand out of place from which on a place is repaired. Of maps that stand
# right the repair moves less than 0.6 % around any place.
_IMPERFECT = 0.01

# The same where the edge profile of the map is uncertain, so that the network alone decides. Of an accurate
# map by plane sweep the repair moves 2 %.
_IMPERFECT_UNCONFIRMED = 0.02


def step_sizes(disparity: np.ndarray) -> np.ndarray:
    """Span of a map, sides multiples of 8, in the 3x3 blocks of 8 pixels around each, (H / 8, W / 8)."""
    height, width = disparity.shape
    blocks = disparity.reshape(height // BLOCK, BLOCK, width // BLOCK, BLOCK)
    low, high = np.pad(blocks.min(1).min(2), 1, "edge"), np.pad(blocks.max(1).max(2), 1, "edge")
    rows, columns = blocks.shape[0], blocks.shape[2]
    windows = [(slice(y, y + rows), slice(x, x + columns)) for y in range(3) for x in range(3)]
    span: np.ndarray = np.max([high[w] for w in windows], 0) - np.min([low[w] for w in windows], 0)
    return span


def count_misplaced(
    disparity: np.ndarray, repaired: np.ndarray, least: float
) -> tuple[np.ndarray, np.ndarray]:
    """Pixels near steps by block, and how many of them changed by over a quarter of their step.

    Args:
        disparity: As it was, (H, W).
        repaired: As it is, (H, W).
        least: What makes a step, in the unit of the map.

    Returns:
        Both counts, (H / 8, W / 8), rounded up.
    """
    spans = step_sizes(pad_to_multiple(disparity, BLOCK))
    counts = np.zeros((2, *spans.shape))
    for top in range(0, len(disparity), _BLOCK_ROWS):
        rows, blocks = slice(top, top + _BLOCK_ROWS), slice(top // BLOCK, (top + _BLOCK_ROWS) // BLOCK)
        change = np.abs(repaired[rows] - disparity[rows])
        steps = spans[blocks].repeat(BLOCK, 0).repeat(BLOCK, 1)[: change.shape[0], : change.shape[1]]
        near = steps > least
        for count, where in zip(counts, (near, near & (change > _PART * steps)), strict=True):
            padded = np.zeros([BLOCK * side for side in spans[blocks].shape], bool)
            padded[: change.shape[0], : change.shape[1]] = where
            count[blocks] = padded.reshape(-1, BLOCK, padded.shape[1] // BLOCK, BLOCK).sum((1, 3))
    return counts[0], counts[1]


def misplaced_shares(near: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """Share of the pixels near steps around each block that stood out of place, drawn to the map's.

    Where few steps are around, those of the whole map tell how right it is: they count as 500 pixels more.

    Args:
        near: Pixels near steps, by block, (H / 8, W / 8).
        moved: How many of them stood out of place.
    """
    overall = moved.sum() / max(near.sum(), 1)
    shares: np.ndarray = (_around(moved) + _PRIOR * overall) / (_around(near) + _PRIOR)
    return shares


def _around(counts: np.ndarray) -> np.ndarray:
    """Sums over the blocks around each block."""
    size = 2 * _AROUND + 1
    sums = np.pad(np.pad(counts, _AROUND), ((1, 0), (1, 0))).cumsum(0).cumsum(1)
    rows = sums[size:] - sums[:-size]
    found: np.ndarray = rows[:, size:] - rows[:, :-size]
    return found


class TakenMap(NamedTuple):
    """A map that was repaired where it was wrong.

    Attributes:
        disparity: (H, W).
        part: Share of the picture that was repaired, 0 to 1.
        misplaced: Share, of all pixels near steps, that stood out of place, 0 to 1.
    """

    disparity: np.ndarray
    part: float
    misplaced: float


def take_misplaced(disparity: np.ndarray, repaired: np.ndarray, *, is_confirmed: bool = True) -> TakenMap:
    """Take the repaired map around steps that stood out of place; elsewhere the map stays as it was.

    Args:
        disparity: As it was, (H, W).
        repaired: As it is, (H, W); taken over where it can be.
        is_confirmed: Whether the edge profile is certain about the map; otherwise twice as many edges must
            stand out of place.
    """
    near, moved = count_misplaced(disparity, repaired, STEP * float(np.ptp(disparity)))
    misplaced = float(moved.sum() / max(near.sum(), 1))
    wanted = misplaced_shares(near, moved) >= (_IMPERFECT if is_confirmed else _IMPERFECT_UNCONFIRMED)
    part = float(wanted.mean())
    if part == 0:
        return TakenMap(disparity.copy(), part, misplaced)
    if part == 1:
        return TakenMap(repaired, part, misplaced)
    height, width = disparity.shape
    pixels = wanted.repeat(BLOCK, 0).repeat(BLOCK, 1)[:height, :width]
    return TakenMap(np.where(pixels, repaired, disparity), part, misplaced)
