"""By how many pixels a map lies beside its picture: all its steps out of place together, one way.

Maps of another camera, of another crop, or enlarged from the corners of their pixels lie so. Near things are
as large as they should be, so that as many steps ask to grow as to shrink: those on one side of them and
those on the other. A place is sought where few ask for either.
"""

import math
from collections.abc import Sequence
from itertools import islice

import numpy as np

from bokehnet.depth_repair.edge_bias import Votes, busiest_windows, shift_edges, vote_shares

__all__ = ["find_map_offset", "move_map"]

# Side of the part of the map that is asked, pixels.
_SIDE = 192

# Side of the smallest map that is moved, pixels: less shows too little of its steps.
_SMALLEST = 64

# Steps in pixels by which places are tried, one after the other, and the farthest place.
_STRIDES, _FARTHEST = (4, 2, 1), 7

# Most objections to a new place, over those to the old one. Maps that lie right, but are wrong otherwise,
# have 0.75 and more at their best place.
_BETTER = 0.7

# Least share of objections that goes, for each pixel of the way.
_LEAST_GAIN = 0.05

# Most objections to a new place, over those to the old one, for a larger part of the map to be asked.
_WORTH_ASKING = 0.85

# Times as many objections to all places two pixels away as to the map's own, from which on no other is tried.
_CLEARLY = 1.4


def move_map(disparity: np.ndarray, offset: tuple[int, int]) -> np.ndarray:
    """Move a map (H, W) down and to the right by so many pixels; its border fills what is left open."""
    if offset == (0, 0):
        return disparity
    rows, columns = (
        np.clip(np.arange(side) - pixels, 0, side - 1)
        for side, pixels in zip(disparity.shape, offset, strict=True)
    )
    return disparity[np.ix_(rows, columns)]


def find_map_offset(disparity: np.ndarray, shift: int, busy: np.ndarray, votes: Votes) -> tuple[int, int]:
    """Pixels down and to the right by which a map should be moved.

    A map that lies beside its picture by much may seem to have near things of another size. So it is moved
    both as it is and with these shifted, and the first is believed where far fewer object.

    Args:
        disparity: (H, W), sides multiples of 8.
        shift: Pixels by which near things seem to have to grow.
        busy: Which blocks of 8x8 pixels hold steps, (H / 8, W / 8).
        votes: Of the network, for a window and the disparity there.

    Returns:
        At most 7 either way; 0 and 0 where no place is much better.
    """
    windows, part = list(busiest_windows(busy)), list(islice(busiest_windows(busy, _SIDE), 1))
    if not windows or min(disparity.shape) < _SMALLEST:
        return 0, 0
    grown = shift_edges(disparity, shift)
    best = _best_place(grown, part, windows, votes)
    if shift == 0:
        return best
    plain = _best_place(disparity, part, windows, votes)
    limit = _BETTER * sum(_objections(grown, best, windows, votes))
    return plain if sum(_objections(disparity, plain, windows, votes)) <= limit else best


def _objections(
    disparity: np.ndarray, offset: tuple[int, int], windows: Sequence[tuple[slice, slice]], votes: Votes
) -> tuple[float, float]:
    """Shares of the far and of the near sides of steps in some windows that object to a place of the map."""
    moved = move_map(disparity, offset)
    return vote_shares(np.sum([votes(window, moved[window]) for window in windows], 0))


def _is_better(offset: tuple[int, int], there: tuple[float, float], here: tuple[float, float]) -> bool:
    """Whether far fewer object there than here, of both sides of steps.

    What only one side asks for is that near things be larger or smaller.
    """
    after, before = sum(there), sum(here)
    none_loses = there[0] <= here[0] and there[1] <= here[1]
    return none_loses and after <= _BETTER * before and before - after >= _LEAST_GAIN * math.hypot(*offset)


def _best_place(
    disparity: np.ndarray,
    part: Sequence[tuple[slice, slice]],
    windows: Sequence[tuple[slice, slice]],
    votes: Votes,
) -> tuple[int, int]:
    """The place to which fewest object.

    A busy part of the map is asked where it should lie: from where it is by steps of 4, then 2, then 1, as
    long as fewer object. Larger windows have to agree.
    """
    told: dict[tuple[int, int], tuple[float, float]] = {}

    def ask_around(place: tuple[int, int], stride: int) -> list[float]:
        steps = ((0, 0), (0, stride), (0, -stride), (stride, 0), (-stride, 0))
        around = [(place[0] + down, place[1] + right) for down, right in steps]
        around = [offset for offset in around if max(map(abs, offset)) <= _FARTHEST]
        for offset in around:
            if offset not in told:
                told[offset] = _objections(disparity, offset, part, votes)
        return [sum(told[offset]) for offset in around]

    here = best = (0, 0)
    own, *beside = ask_around(here, 2)
    if min(beside) >= _CLEARLY * own:
        return here
    for stride in _STRIDES:
        before = None
        while best != before:
            before = best
            ask_around(best, stride)
            best = min(told, key=lambda offset: sum(told[offset]))
    sides = told[best], told[here]
    for asked in (windows[:1], windows):
        if best == here or sum(sides[0]) > _WORTH_ASKING * sum(sides[1]):
            return here
        sides = _objections(disparity, best, asked, votes), _objections(disparity, here, asked, votes)
    return best if _is_better(best, *sides) else here
