"""How far all steps of a map stand out of place together: near things too large or too small everywhere."""

from collections.abc import Callable, Iterator

import numpy as np

from bokehnet.arrays.row_blocks import make_in_row_blocks
from bokehnet.depth_repair.stages.edge_sharpening import extremes, with_halo

__all__ = ["Votes", "busiest_windows", "find_edge_bias", "shift_edges", "stands_right", "vote_shares"]

# Votes of the network on a part of the picture, 4 values: pixels of the far side of steps that should become
# near, how many there are, and both numbers of the near side.
Votes = Callable[[tuple[slice, slice], np.ndarray], np.ndarray]

# Where the busiest parts of the picture are looked for: at most so many windows, of so many pixels a side.
_WINDOWS = 4
_SIDE = 256

# A shift by more is not looked for, pixels.
_FARTHEST = 7

# Share of the far sides that votes to become near, less the share of the near sides that votes to become far,
# on maps that stand right.
_RIGHT = 0.1

# Difference from that up to which a map counts as right.
_CLOSE = 0.2


def shift_edges(disparity: np.ndarray, pixels: int) -> np.ndarray:
    """Let whatever is near grow by so many pixels, or shrink where negative; (H, W), any unit."""
    if pixels == 0:
        return disparity
    radius = abs(pixels)

    def make(rows: slice) -> np.ndarray:
        window, inner = with_halo(rows, radius)
        return extremes(disparity[window], radius)[pixels > 0][inner]

    return make_in_row_blocks(make, disparity.shape, np.float32)


def stands_right(votes: np.ndarray) -> bool:
    """Whether about as many steps ask to grow as to shrink, by the votes of the network, (4,)."""
    return abs(_count(votes)[0]) < _CLOSE


def vote_shares(votes: np.ndarray) -> tuple[float, float]:
    """Shares of the far sides that ask to become near, and of the near sides that ask to become far."""
    grow, far, shrink, near = (float(vote) for vote in votes)
    return grow / max(far, 1), shrink / max(near, 1)


def _count(votes: np.ndarray) -> tuple[float, float]:
    """By how much more steps ask to grow than to shrink, and how many ask for either; shares."""
    out, back = vote_shares(votes)
    return out - back - _RIGHT, out + back


def find_edge_bias(disparity: np.ndarray, busy: np.ndarray, votes: Votes) -> int:
    """Pixels by which the near sides of all steps should grow, negative where they should shrink.

    A network sees whether a step stands too far in or out, but hardly how far. So the map is shifted until as
    many of its steps ask to grow as to shrink: twice as far each time until the answer turns, then halfway
    between the last two. Of the shifts tried, and none at all, the one that fewest pixels object to is taken.
    Only those parts are asked that object to the map as it is.

    Args:
        disparity: (H, W), sides multiples of 8.
        busy: Which blocks of 8x8 pixels hold steps, (H / 8, W / 8).
        votes: Of the network, for a window and the disparity there.

    Returns:
        At most 7 either way; 0 where there are no steps, as many ask for either, or no shift is better.
    """
    asked = [(window, votes(window, disparity[window])) for window in busiest_windows(busy)]
    if not asked:
        return 0
    overall = _count(np.sum([vote for _, vote in asked], 0))[0]
    if abs(overall) < _CLOSE:
        return 0
    way = 1 if overall > 0 else -1
    # Where a part of the map alone is off, the others have no say in how far.
    objecting = [part for part in asked if way * _count(part[1])[0] >= _CLOSE] or asked
    windows = [window for window, _ in objecting]
    start = _count(np.sum([vote for _, vote in objecting], 0))
    biases, objections = {0: start[0]}, {0: start[1]}

    def bias(shift: int) -> float:
        if shift not in biases:
            moved = [(window, shift_edges(disparity[window], shift)) for window in windows]
            biases[shift], objections[shift] = _count(np.sum([votes(*part) for part in moved], 0))
        return biases[shift]

    before, after = 0, 2
    while way * bias(way * after) > 0 and after < _FARTHEST:
        before, after = after, min(2 * after, _FARTHEST)
    while after - before > 1:
        middle = (before + after) // 2
        if way * bias(way * middle) > 0:
            before = middle
        else:
            after = middle
    return min(objections, key=lambda shift: objections[shift])


def busiest_windows(busy: np.ndarray, side: int = _SIDE) -> Iterator[tuple[slice, slice]]:
    """Up to four windows of at most 256x256 pixels that do not overlap, those with the most steps first.

    Args:
        busy: Which blocks of 8x8 pixels hold steps, (H / 8, W / 8) bool.
        side: Of the windows, if not 256; a multiple of 8.
    """
    size = side // 8
    left_over = busy.astype(np.float64)
    for _ in range(_WINDOWS):
        sums = _window_sums(left_over, size)
        row, column = np.unravel_index(int(sums.argmax()), sums.shape)
        if sums[row, column] <= 0:
            return
        window = slice(int(row), int(row) + size), slice(int(column), int(column) + size)
        left_over[window] = 0
        yield tuple(slice(8 * x.start, 8 * x.stop) for x in window)  # type: ignore[misc]


def _window_sums(values: np.ndarray, size: int) -> np.ndarray:
    """Sum over each square window that fits, or over all of a side that is smaller."""
    total = np.pad(values, ((1, 0), (1, 0))).cumsum(0).cumsum(1)
    rows, columns = (min(size, side) for side in values.shape)
    strips = total[rows:] - total[:-rows]
    sums: np.ndarray = strips[:, columns:] - strips[:, :-columns]
    return sums
