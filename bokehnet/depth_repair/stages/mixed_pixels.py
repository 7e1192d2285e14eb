"""Mixed pixels of an anti-aliased depth map: values between two surfaces that belong to neither.

A renderer that filters depth as it filters colour writes, where an edge crosses a pixel, an average of what
lies on both sides. Blur of such a pixel is that of a surface which is not there: it can even be in focus
between a blurred foreground and a blurred background. Colour may be mixed, depth may not.

The steps that :mod:`bokehnet.classical.layered.depth_discontinuities` sharpens are measured in pixels of
blur, which a file does not know yet, and are split in the middle of the disparity, which is not the middle of
the pixel when depth was filtered. So this is another rule, for narrow ramps only: what is wider than filters
make is left alone.
"""

from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bokehnet.checks import check_choice, check_finite, check_map

__all__ = ["repair_mixed", "share_of_mixed"]

# Both sides of a step differ by more than this part of the map's range.
_STEP = 0.01

# Steps larger than this part of it tell whether a map is mixed at all; smaller ones may be slopes.
_CLEAR_STEP = 0.05

# Mixed pixels side by side that one edge makes at most: filters are up to four pixels wide.
_WIDEST = 3

# Every part of a step is this many times steeper than the surfaces on either side of it.
_STEEPER = 2.0

# A pixel that differs from its surface by less than this part of the step is left alone: round things, such
# as balls, turn away from the eye at their edges.
_LEAST_CHANGE = 0.1

# Coverage of either side below which a pixel is not mixed, and change of it within a ramp from pixel to
# pixel: two equal values side by side are a surface.
_LEAST_SHARE = 0.02

_DIRECTIONS = ((0, 1), (1, 0), (1, 1), (1, -1))


def repair_mixed(disparity: NDArray[np.float32], *, filtered: str = "disparity") -> NDArray[np.float32]:
    """Give each mixed pixel at a depth edge the value of the surface that covers more of it.

    A pixel is mixed when, along a row, a column or a diagonal, up to three pixels rise or fall from one
    surface to another, every one of them between both, in a step that is steeper than the surfaces beside
    it. So slopes stay, and so do thin things, which are nearer or farther than both of their sides.

    Args:
        disparity: relative or 1/mm, (H, W), 0 is infinitely far, finite.
        filtered: ``"depth"`` if the file held depth, ``"disparity"`` if it held disparity: the quantity
            that is linear in coverage.

    Returns:
        A new map of the same shape; a pixel either keeps its value or takes one from its surroundings.

    Raises:
        ShapeError, ParameterError: not a finite map, or another ``filtered``.
    """
    result = np.array(disparity, np.float32)
    rows, columns, mixed, value = _find(disparity, filtered)
    result[rows[mixed], columns[mixed]] = value[mixed]
    return result


def share_of_mixed(disparity: NDArray[np.float32], *, filtered: str = "disparity") -> float:
    """Tell how many of the pixels at clear depth edges are mixed.

    Maps at pixel centres have about 0.01, filtered ones 0.2 and more; between both, 0.05 parts them.

    Args:
        disparity: as for :func:`repair_mixed`.
        filtered: as for :func:`repair_mixed`.
    """
    rows, columns, mixed, _ = _find(disparity, filtered)
    spans = _span(np.asarray(disparity, np.float64))[rows, columns]
    clear = spans > _CLEAR_STEP * float(np.ptp(disparity))
    return float(mixed[clear].mean()) if clear.any() else 0.0


def _find(
    disparity: NDArray[np.float32], filtered: str
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.bool_], NDArray[Any]]:
    """Return rows and columns of the pixels beside edges, which are mixed, and what they should be."""
    check_map("disparity", disparity)
    check_finite("disparity", disparity)
    check_choice("filtered", filtered, ("disparity", "depth"))
    values = np.asarray(disparity, np.float64)
    least = _STEP * float(np.ptp(values))
    rows, columns = np.nonzero(_span(values) > least)
    found = np.zeros(rows.size)
    nearest = np.full(rows.size, np.inf)  # pixels from one surface to the other, on the best line so far
    pairs = [(i, j) for i, j in product(range(1, _WIDEST + 1), repeat=2) if i + j <= _WIDEST + 1]
    for (dy, dx), (i, j) in product(_DIRECTIONS, sorted(pairs, key=sum)):
        distance = (i + j) * np.hypot(dy, dx)
        still = np.flatnonzero(nearest > distance)
        line = _along(values, rows[still], columns[still], (dy, dx), (i + 1, j + 1))
        mixed, value = _judge(line, i + 1, least, filtered)
        found[still[mixed]] = value[mixed]
        nearest[still[mixed]] = distance
    return rows, columns, np.isfinite(nearest), found


def _span(values: NDArray[Any]) -> NDArray[Any]:
    """Return the difference of largest and smallest value in the 3x3 window of each pixel."""
    low = high = values
    for axis in (0, 1):
        padded = np.pad(low, [(int(a == axis), int(a == axis)) for a in (0, 1)], "edge")
        low = np.min(np.lib.stride_tricks.sliding_window_view(padded, 3, axis), axis=-1)
        padded = np.pad(high, [(int(a == axis), int(a == axis)) for a in (0, 1)], "edge")
        high = np.max(np.lib.stride_tricks.sliding_window_view(padded, 3, axis), axis=-1)
    return high - low


def _along(
    values: NDArray[Any],
    rows: NDArray[np.intp],
    columns: NDArray[np.intp],
    direction: tuple[int, int],
    reach: tuple[int, int],
) -> NDArray[Any]:
    """Return the values on a line through each pixel, (pixels, 1 + both reaches); the border is repeated."""
    steps = np.arange(-reach[0], reach[1] + 1)
    height, width = values.shape
    return values[
        np.clip(rows[:, None] + direction[0] * steps, 0, height - 1),
        np.clip(columns[:, None] + direction[1] * steps, 0, width - 1),
    ]


def _judge(
    line: NDArray[Any], centre: int, least: float, filtered: str
) -> tuple[NDArray[np.bool_], NDArray[Any]]:
    """Tell which pixels are mixed, and the value of the surface that covers more of each.

    The first two and the last two values of each line are the surfaces on either side, what stands between
    is the ramp with the pixel at ``centre``.
    """
    first, last = line[:, 1], line[:, -2]
    parts = np.diff(line, axis=1)  # of the step, from pixel to pixel, and of the surfaces at both ends
    slope = np.maximum(np.abs(parts[:, 0]), np.abs(parts[:, -1]))
    steep = np.abs(parts[:, 1:-1]).min(axis=1) > _STEEPER * slope
    # Depth 0 stands for no disparity at all; a tiny disparity keeps infinity out of the arithmetic.
    linear = 1 / np.maximum(line, 1e-30) if filtered == "depth" else line
    with np.errstate(divide="ignore", invalid="ignore"):  # where there is no step
        share = (linear - linear[:, -2:-1]) / (linear[:, 1:2] - linear[:, -2:-1])  # 1 first to 0 last
        falling = (np.diff(share[:, 1:-1], axis=1) < -_LEAST_SHARE).all(axis=1)
    step = np.abs(first - last)
    surface = np.where(share[:, centre] > 0.5, first, last)
    away = np.abs(line[:, centre] - surface) > _LEAST_CHANGE * step
    return steep & falling & away & (step > least), surface
