"""Acceptance test of a repair: keep the repaired map only where the input had enough misplaced edges.

Method: count edge pixels that the repair changes by more than a quarter of the local edge height, per block
of 8x8 pixels; smooth the misplaced fraction over a window of 136x136 pixels and towards the fraction of the
whole map (additive smoothing with a pseudo-count of 500 pixels); accept the repair where the result reaches
1 %, or 2 % if the edge profile is uncertain.

In: the map before and after the repair, (H, W), in one unit. Out: an :class:`AcceptedMap`, in that unit.
"""

from typing import NamedTuple

import numpy as np

from bokehnet.arrays.pyramid import pad_to_multiple
from bokehnet.depth_repair.network_tiles import BLOCK_PX
from bokehnet.depth_repair.stages.edge_sharpening import MIN_EDGE_HEIGHT

__all__ = ["AcceptedMap", "accept_repair", "block_ranges", "count_misplaced", "misplaced_fractions"]

# Rows of the map compared per pass, which bounds memory; a multiple of 8.
_ROWS_PER_PASS = 1024

# Change of a pixel, as a fraction of the edge height, above which the pixel was misplaced.
_MIN_CHANGE = 0.25

# Half width of the smoothing window, blocks of 8 pixels; the window has sides of 136 pixels.
_WINDOW_RADIUS_BLOCKS = 8

# Pseudo-count of edge pixels with the misplaced fraction of the whole map, pixels.
_PRIOR_PIXELS = 500

# Minimum fraction of misplaced edge pixels at which the repair is accepted. On accurate maps the repair moves
# less than 0.6 % in any window.
_MIN_MISPLACED = 0.01

# The same where the edge profile is uncertain, so that only the network has evidence. On an accurate map from
# plane sweep the repair moves 2 %.
_MIN_MISPLACED_UNCONFIRMED = 0.02


def block_ranges(disparity: np.ndarray) -> np.ndarray:
    """Return the range of values in the 3x3 blocks of 8x8 pixels around each block, (H / 8, W / 8).

    Args:
        disparity: Map with sides that are multiples of 8, (H, W), any unit.
    """
    height, width = disparity.shape
    blocks = disparity.reshape(height // BLOCK_PX, BLOCK_PX, width // BLOCK_PX, BLOCK_PX)
    low, high = np.pad(blocks.min(1).min(2), 1, "edge"), np.pad(blocks.max(1).max(2), 1, "edge")
    rows, columns = blocks.shape[0], blocks.shape[2]
    windows = [(slice(y, y + rows), slice(x, x + columns)) for y in range(3) for x in range(3)]
    ranges: np.ndarray = np.max([high[w] for w in windows], 0) - np.min([low[w] for w in windows], 0)
    return ranges


def count_misplaced(
    disparity: np.ndarray, repaired: np.ndarray, min_height: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the number of edge pixels and of misplaced edge pixels in each block of 8x8 pixels.

    An edge pixel is misplaced if the repair changes it by more than a quarter of the edge height.

    Args:
        disparity: Map before the repair, (H, W), any unit.
        repaired: Map after the repair, (H, W), in the same unit.
        min_height: Minimum height of a depth edge, in the unit of the map.

    Returns:
        Both counts, (H / 8, W / 8), sides rounded up.
    """
    ranges = block_ranges(pad_to_multiple(disparity, BLOCK_PX))
    counts = np.zeros((2, *ranges.shape))
    for top in range(0, len(disparity), _ROWS_PER_PASS):
        rows, blocks = (
            slice(top, top + _ROWS_PER_PASS),
            slice(top // BLOCK_PX, (top + _ROWS_PER_PASS) // BLOCK_PX),
        )
        change = np.abs(repaired[rows] - disparity[rows])
        heights = ranges[blocks].repeat(BLOCK_PX, 0).repeat(BLOCK_PX, 1)[: change.shape[0], : change.shape[1]]
        edge_pixels = heights > min_height
        for count, mask in zip(
            counts, (edge_pixels, edge_pixels & (change > _MIN_CHANGE * heights)), strict=True
        ):
            padded = np.zeros([BLOCK_PX * side for side in ranges[blocks].shape], bool)
            padded[: change.shape[0], : change.shape[1]] = mask
            count[blocks] = padded.reshape(-1, BLOCK_PX, padded.shape[1] // BLOCK_PX, BLOCK_PX).sum((1, 3))
    return counts[0], counts[1]


def misplaced_fractions(edge_pixels: np.ndarray, misplaced_pixels: np.ndarray) -> np.ndarray:
    """Return the smoothed fraction of misplaced edge pixels around each block, (H / 8, W / 8), 0 to 1.

    The fraction of the whole map enters with a pseudo-count of 500 pixels, so that a few wrong changes near
    an isolated edge do not reach the threshold.

    Args:
        edge_pixels: Number of edge pixels per block, (H / 8, W / 8).
        misplaced_pixels: Number of misplaced edge pixels per block, (H / 8, W / 8).
    """
    global_fraction = misplaced_pixels.sum() / max(edge_pixels.sum(), 1)
    fractions: np.ndarray = (_window_sums(misplaced_pixels) + _PRIOR_PIXELS * global_fraction) / (
        _window_sums(edge_pixels) + _PRIOR_PIXELS
    )
    return fractions


def _window_sums(counts: np.ndarray) -> np.ndarray:
    """Return the sums of counts over the window around each block."""
    size = 2 * _WINDOW_RADIUS_BLOCKS + 1
    sums = np.pad(np.pad(counts, _WINDOW_RADIUS_BLOCKS), ((1, 0), (1, 0))).cumsum(0).cumsum(1)
    rows = sums[size:] - sums[:-size]
    sums_of_windows: np.ndarray = rows[:, size:] - rows[:, :-size]
    return sums_of_windows


class AcceptedMap(NamedTuple):
    """Map that is repaired where the repair was accepted.

    Attributes:
        disparity: Map, (H, W), in the unit of the input.
        repaired_fraction: Fraction of the blocks in which the repair was accepted, 0 to 1.
        misplaced_fraction: Fraction of all edge pixels that were misplaced, 0 to 1.
    """

    disparity: np.ndarray
    repaired_fraction: float
    misplaced_fraction: float


def accept_repair(disparity: np.ndarray, repaired: np.ndarray, *, is_confirmed: bool = True) -> AcceptedMap:
    """Return the repaired map around misplaced edges and the input elsewhere.

    Args:
        disparity: Map before the repair, (H, W), any unit.
        repaired: Map after the repair, (H, W); returned itself, without a copy, if accepted everywhere.
        is_confirmed: True if the edge profile of the map is certain. Otherwise the threshold on the misplaced
            fraction doubles.
    """
    edge_pixels, misplaced_pixels = count_misplaced(
        disparity, repaired, MIN_EDGE_HEIGHT * float(np.ptp(disparity))
    )
    misplaced_fraction = float(misplaced_pixels.sum() / max(edge_pixels.sum(), 1))
    accepted = misplaced_fractions(edge_pixels, misplaced_pixels) >= (
        _MIN_MISPLACED if is_confirmed else _MIN_MISPLACED_UNCONFIRMED
    )
    repaired_fraction = float(accepted.mean())
    if repaired_fraction == 0:
        return AcceptedMap(disparity.copy(), repaired_fraction, misplaced_fraction)
    if repaired_fraction == 1:
        return AcceptedMap(repaired, repaired_fraction, misplaced_fraction)
    height, width = disparity.shape
    pixels = accepted.repeat(BLOCK_PX, 0).repeat(BLOCK_PX, 1)[:height, :width]
    return AcceptedMap(np.where(pixels, repaired, disparity), repaired_fraction, misplaced_fraction)
