"""Map offset: translation between a map and its picture, in pixels.

A map has an offset if it comes from another camera or crop, or if it was enlarged with pixel corners aligned
instead of centres. Foreground regions then have the right size, so that votes for growing (on one side of a
region) and for shrinking (on the opposite side) balance, but both are frequent.

Method: compass search with step halving (pattern search; Hooke and Jeeves, ""Direct search" solution of
numerical and statistical problems", Journal of the ACM 1961) for the translation with the fewest votes of the
repair network.

In: the map (H, W), any unit, and a function that returns votes. Out: an integer translation (down, right) in
pixels.
"""

import math
from collections.abc import Sequence
from itertools import islice

import numpy as np

from bokehnet.depth_repair.edge_bias import Votes, shift_edges, vote_fractions, windows_with_most_edges

__all__ = ["find_map_offset", "translate_map"]

# Side of the window in which translations are searched, pixels.
_SEARCH_SIDE_PX = 192

# Minimum side of a map that is translated, pixels: smaller maps contain too few edges.
_MIN_SIDE_PX = 64

# Strides of the search, one after the other, and upper bound of the translation per axis, pixels.
_STRIDES_PX, _MAX_OFFSET_PX = (4, 2, 1), 7

# Maximum ratio of the vote fractions at the new and the old translation. Maps without an offset, but with
# other errors, have 0.75 and more at their best translation.
_MAX_VOTE_RATIO = 0.7

# Minimum decrease of the vote fraction per pixel of translation.
_MIN_GAIN_PER_PX = 0.05

# Maximum ratio of the vote fractions at which a candidate is verified in larger windows.
_MAX_CANDIDATE_RATIO = 0.85

# Minimum ratio of the vote fractions two pixels away, in all four directions, and at the input, at which the
# search ends at once.
_MIN_REJECTION_RATIO = 1.4


def translate_map(disparity: np.ndarray, offset: tuple[int, int]) -> np.ndarray:
    """Return the map translated by whole pixels, with its border repeated.

    Args:
        disparity: Map, (H, W), any unit.
        offset: Translation down and to the right, pixels.
    """
    if offset == (0, 0):
        return disparity
    rows, columns = (
        np.clip(np.arange(side) - pixels, 0, side - 1)
        for side, pixels in zip(disparity.shape, offset, strict=True)
    )
    return disparity[np.ix_(rows, columns)]


def find_map_offset(disparity: np.ndarray, shift: int, busy: np.ndarray, votes: Votes) -> tuple[int, int]:
    """Return the translation that aligns a map with its picture, pixels down and to the right.

    A large offset can look like an edge bias. The function therefore searches for the map both with and
    without the estimated shift, and prefers the result without it if that has far fewer votes.

    Args:
        disparity: Map with sides that are multiples of 8, (H, W), any unit.
        shift: Estimated edge bias: pixels by which foreground regions should grow.
        busy: Blocks of 8x8 pixels that contain depth edges, (H / 8, W / 8) bool.
        votes: Function that returns the votes (4,) for a window and the disparity in it.

    Returns:
        Translation per axis, -7 to 7; (0, 0) if no translation is much better.
    """
    windows, search_window = (
        list(windows_with_most_edges(busy)),
        list(islice(windows_with_most_edges(busy, _SEARCH_SIDE_PX), 1)),
    )
    if not windows or min(disparity.shape) < _MIN_SIDE_PX:
        return 0, 0
    grown = shift_edges(disparity, shift)
    best = _search(grown, search_window, windows, votes)
    if shift == 0:
        return best
    plain = _search(disparity, search_window, windows, votes)
    limit = _MAX_VOTE_RATIO * sum(_votes_against(grown, best, windows, votes))
    return plain if sum(_votes_against(disparity, plain, windows, votes)) <= limit else best


def _votes_against(
    disparity: np.ndarray, offset: tuple[int, int], windows: Sequence[tuple[slice, slice]], votes: Votes
) -> tuple[float, float]:
    """Return the vote fractions of the far and the near sides of edges in some windows for a translation."""
    translated = translate_map(disparity, offset)
    return vote_fractions(np.sum([votes(window, translated[window]) for window in windows], 0))


def _is_better(
    offset: tuple[int, int], candidate_votes: tuple[float, float], input_votes: tuple[float, float]
) -> bool:
    """Return whether a translation has far fewer votes than the input, and no more on either side of edges.

    A change of the votes on one side alone indicates an edge bias, not an offset.
    """
    total_after, total_before = sum(candidate_votes), sum(input_votes)
    neither_grows = candidate_votes[0] <= input_votes[0] and candidate_votes[1] <= input_votes[1]
    return (
        neither_grows
        and total_after <= _MAX_VOTE_RATIO * total_before
        and total_before - total_after >= _MIN_GAIN_PER_PX * math.hypot(*offset)
    )


def _search(
    disparity: np.ndarray,
    search_window: Sequence[tuple[slice, slice]],
    windows: Sequence[tuple[slice, slice]],
    votes: Votes,
) -> tuple[int, int]:
    """Return the translation with the fewest votes, (0, 0) unless it is clearly better than the input.

    The compass search runs in one small window, with strides of 4, 2 and 1 pixels. Larger windows verify its
    result.
    """
    fractions: dict[tuple[int, int], tuple[float, float]] = {}

    def evaluate_around(centre: tuple[int, int], stride: int) -> list[float]:
        directions = ((0, 0), (0, stride), (0, -stride), (stride, 0), (-stride, 0))
        candidates = [(centre[0] + down, centre[1] + right) for down, right in directions]
        candidates = [offset for offset in candidates if max(map(abs, offset)) <= _MAX_OFFSET_PX]
        for offset in candidates:
            if offset not in fractions:
                fractions[offset] = _votes_against(disparity, offset, search_window, votes)
        return [sum(fractions[offset]) for offset in candidates]

    start = best = (0, 0)
    votes_here, *votes_around = evaluate_around(start, 2)
    if min(votes_around) >= _MIN_REJECTION_RATIO * votes_here:
        return start
    for stride in _STRIDES_PX:
        previous = None
        while best != previous:
            previous = best
            evaluate_around(best, stride)
            best = min(fractions, key=lambda offset: sum(fractions[offset]))
    comparison = fractions[best], fractions[start]
    for checked in (windows[:1], windows):
        if best == start or sum(comparison[0]) > _MAX_CANDIDATE_RATIO * sum(comparison[1]):
            return start
        comparison = (
            _votes_against(disparity, best, checked, votes),
            _votes_against(disparity, start, checked, votes),
        )
    return best if _is_better(best, *comparison) else start
