"""Edge bias: number of pixels by which foreground regions are too large or too small everywhere in a map.

Method: grey-scale dilation or erosion of the map (Serra, "Image Analysis and Mathematical Morphology", 1982)
by a radius that is found by bracketing and bisection: the radius doubles until the votes of the repair
network change sign, then the interval is halved. The network votes for each pixel beside a depth edge whether
it belongs to the other side.

In: the map (H, W), any unit, rising towards the camera, and a function that returns votes. Out: a signed
radius in pixels, positive where foreground regions must grow.
"""

from collections.abc import Callable, Iterator

import numpy as np

from bokehnet.arrays.row_blocks import make_in_row_blocks
from bokehnet.depth_repair.stages.edge_sharpening import extend_rows, local_extremes

__all__ = [
    "Votes",
    "find_edge_bias",
    "is_unbiased",
    "shift_edges",
    "vote_fractions",
    "windows_with_most_edges",
]

# Votes of the network in a window, (4,): number of far-side pixels that should become near, number of
# far-side pixels, number of near-side pixels that should become far, number of near-side pixels.
Votes = Callable[[tuple[slice, slice], np.ndarray], np.ndarray]

# Maximum number of windows in which the network votes, and their side in pixels.
_MAX_WINDOWS = 4
_WINDOW_SIDE_PX = 256

# Upper bound of the shift, pixels.
_MAX_SHIFT_PX = 7

# Fraction of far-side pixels that vote to become near, minus the fraction of near-side pixels that vote to
# become far, on accurate maps.
_UNBIASED_DIFFERENCE = 0.1

# Maximum deviation from that difference at which a map counts as unbiased.
_MAX_DEVIATION = 0.2


def shift_edges(disparity: np.ndarray, pixels: int) -> np.ndarray:
    """Return the map with foreground regions grown by some pixels (dilation), or shrunk (erosion).

    Args:
        disparity: Map, (H, W), any unit, rising towards the camera.
        pixels: Half width of the square window, pixels; negative to shrink.
    """
    if pixels == 0:
        return disparity
    radius = abs(pixels)

    def make(rows: slice) -> np.ndarray:
        window, inner = extend_rows(rows, radius)
        return local_extremes(disparity[window], radius)[pixels > 0][inner]

    return make_in_row_blocks(make, disparity.shape, np.float32)


def is_unbiased(votes: np.ndarray) -> bool:
    """Return whether about as many votes (4,) are for growing as for shrinking."""
    return abs(_bias_and_total(votes)[0]) < _MAX_DEVIATION


def vote_fractions(votes: np.ndarray) -> tuple[float, float]:
    """Return the fractions of far-side and of near-side pixels that vote to change sides."""
    far_votes, far_pixels, near_votes, near_pixels = (float(vote) for vote in votes)
    return far_votes / max(far_pixels, 1), near_votes / max(near_pixels, 1)


def _bias_and_total(votes: np.ndarray) -> tuple[float, float]:
    """Return the bias of the votes towards growing, 0 if unbiased, and the sum of both vote fractions."""
    growing, shrinking = vote_fractions(votes)
    return growing - shrinking - _UNBIASED_DIFFERENCE, growing + shrinking


def find_edge_bias(disparity: np.ndarray, busy: np.ndarray, votes: Votes) -> int:
    """Return the number of pixels by which foreground regions should grow, negative to shrink.

    The network sees the direction of an edge error, but hardly its size. The map is therefore shifted until
    votes for growing and shrinking balance: the shift doubles until the sign of the bias changes, then the
    interval is bisected. Of all shifts tried, including 0, the function returns the one with the fewest votes
    for any change. Only windows whose votes on the input are biased take part.

    Args:
        disparity: Map with sides that are multiples of 8, (H, W), any unit.
        busy: Blocks of 8x8 pixels that contain depth edges, (H / 8, W / 8) bool.
        votes: Function that returns the votes (4,) for a window and the disparity in it.

    Returns:
        Shift in pixels, -7 to 7; 0 if there are no edges, the votes are balanced, or no shift is better.
    """
    window_votes = [(window, votes(window, disparity[window])) for window in windows_with_most_edges(busy)]
    if not window_votes:
        return 0
    overall_bias = _bias_and_total(np.sum([vote for _, vote in window_votes], 0))[0]
    if abs(overall_bias) < _MAX_DEVIATION:
        return 0
    sign = 1 if overall_bias > 0 else -1
    # If only a part of the map is biased, the other windows would pull the estimate towards 0.
    biased = [
        entry for entry in window_votes if sign * _bias_and_total(entry[1])[0] >= _MAX_DEVIATION
    ] or window_votes
    windows = [window for window, _ in biased]
    initial = _bias_and_total(np.sum([vote for _, vote in biased], 0))
    bias_at, total_at = {0: initial[0]}, {0: initial[1]}

    def measure_bias(shift: int) -> float:
        if shift not in bias_at:
            shifted_windows = [(window, shift_edges(disparity[window], shift)) for window in windows]
            bias_at[shift], total_at[shift] = _bias_and_total(
                np.sum([votes(*entry) for entry in shifted_windows], 0)
            )
        return bias_at[shift]

    low, high = 0, 2
    while sign * measure_bias(sign * high) > 0 and high < _MAX_SHIFT_PX:
        low, high = high, min(2 * high, _MAX_SHIFT_PX)
    while high - low > 1:
        middle = (low + high) // 2
        if sign * measure_bias(sign * middle) > 0:
            low = middle
        else:
            high = middle
    return min(total_at, key=lambda shift: total_at[shift])


def windows_with_most_edges(busy: np.ndarray, side: int = _WINDOW_SIDE_PX) -> Iterator[tuple[slice, slice]]:
    """Yield up to four disjoint windows of at most 256x256 pixels, those with the most depth edges first.

    Args:
        busy: Blocks of 8x8 pixels that contain depth edges, (H / 8, W / 8) bool.
        side: Side of the windows, pixels; a multiple of 8.
    """
    size = side // 8
    remaining = busy.astype(np.float64)
    for _ in range(_MAX_WINDOWS):
        sums = _window_sums(remaining, size)
        row, column = np.unravel_index(int(sums.argmax()), sums.shape)
        if sums[row, column] <= 0:
            return
        window = slice(int(row), int(row) + size), slice(int(column), int(column) + size)
        remaining[window] = 0
        yield tuple(slice(8 * x.start, 8 * x.stop) for x in window)  # type: ignore[misc]


def _window_sums(values: np.ndarray, size: int) -> np.ndarray:
    """Return the sum over each square window of ``size`` blocks, clipped to the sides of the map."""
    total = np.pad(values, ((1, 0), (1, 0))).cumsum(0).cumsum(1)
    rows, columns = (min(size, side) for side in values.shape)
    strips = total[rows:] - total[:-rows]
    sums: np.ndarray = strips[:, columns:] - strips[:, :-columns]
    return sums
