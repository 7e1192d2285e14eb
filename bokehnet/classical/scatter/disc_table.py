"""Exact area of a disc on every pixel, in the form that spreading by differences needs.

A disc of radius r around a pixel's centre covers the pixel j columns and k rows away by an area ``cover(k,
j)``. In a row the cover falls with |j|, so the row is a sum of centred intervals: the interval over the
columns -j .. j has the strength ``end(k, j) = cover(k, j) - cover(k, j + 1) >= 0``. Only the ends that are
not 0 are listed, for k >= 0 and j >= 0: along the rim, about 3 r of them. The other quadrants follow by
symmetry; row 0 is listed as its lower half. Divided by the disc's area, the weights of the intervals sum to
one.

Where the rim crosses a pixel, the area inside is a trapezoid under the chord plus the segment between
chord and arc; its derivative by r is the length of the arc.

Small discs are tabulated; between two adjacent radii of the table the weights are linear in r. That
keeps their sum at one, and makes them a differentiable function whose derivative is tabulated too.
"""

import math
from functools import cache
from typing import NamedTuple

import numpy as np

from bokehnet.kernels import njit

__all__ = [
    "SMALLEST_RADIUS",
    "TABLE_RADIUS",
    "DiscTable",
    "disc_table",
    "find_step",
    "list_discs",
    "list_row",
]

# A disc of at most half a pixel is inside its own pixel: spreading is the identity.
SMALLEST_RADIUS = 0.5

# Radius up to which discs are tabulated, pixels.
TABLE_RADIUS = 64.0

# The table divides every octave of the radius minus this offset into steps of equal length, so that they are
# finest where the coverage of a pixel changes fastest.
_OFFSET = SMALLEST_RADIUS - 1 / 8

# A step is identified by the exponent (octave) and the first seven bits of the mantissa of a float32.
_STEP_BITS = 16


@njit(cache=True)
def _segment(chord, radius):
    """Return the area between a chord and its arc, and the arc's length; exact to 1e-9."""
    q = 0.5 * chord / radius
    if q < 0.05:
        s = q * q
        area = radius * radius * q * s * (2 / 3 + s * (1 / 5 + s * 3 / 28))
        return area, chord * (1.0 + s * (1 / 6 + s * (3 / 40 + s * 5 / 112)))
    angle = math.asin(min(q, 1.0))
    return radius * radius * (angle - q * math.sqrt(max(1.0 - q * q, 0.0))), 2.0 * radius * angle


@njit(cache=True)
def list_row(radius, k, farthest, start, places, weights):
    """List the ends of row ``k`` >= 0 of a disc, and return the index behind the last one.

    Args:
        radius: Radius in pixels, > 0.
        k: Row, counted from the centre.
        farthest: Ends beyond this column are accumulated in it; the difference is outside the picture.
        start: Index of the first free entry of the lists.
        places: Row and column (k, j) of each end, (n, 2).
        weights: ``end(k, j)`` over the disc's area, and its derivative by the radius, (n, 2).
    """
    low, scale = max(k - 0.5, 0.0), 1.0 / (math.pi * radius * radius)
    if low >= radius:
        return start
    high = min(k + 0.5, radius)
    x = math.sqrt(radius * radius - high * high)
    widest = math.sqrt(radius * radius - low * low)
    y = high
    index = start
    cover, growth = high - low, 0.0
    # The rim enters the row at (x, high), passes one column after the other, and leaves it at (widest, low).
    first = int(math.floor(x + 0.5))
    last = min(farthest, int(math.floor(widest + 0.5)))
    for j in range(min(first, last + 1), last + 2):
        outer, outer_growth = 0.0, 0.0
        if j <= last:
            x_out, y_out = widest, low
            if widest > j + 0.5:
                x_out, y_out = j + 0.5, math.sqrt(radius * radius - (j + 0.5) ** 2)
            width, height = x_out - x, y - y_out
            area, outer_growth = _segment(math.sqrt(width * width + height * height), radius)
            outer = (x - max(j - 0.5, 0.0)) * (high - low) + width * (0.5 * (y + y_out) - low) + area
            x, y = x_out, y_out
            if j == 0:  # both halves of the centre pixel
                outer, outer_growth = 2.0 * outer, 2.0 * outer_growth
        if j > 0:
            end = scale * (cover - outer)
            places[index, 0], places[index, 1] = k, min(j - 1, farthest)
            weights[index, 0] = end
            weights[index, 1] = scale * (growth - outer_growth) - 2.0 / radius * end
            index += 1
        cover, growth = outer, outer_growth
    return index


class DiscTable(NamedTuple):
    """Ends of the discs of a range of radii; within a step the weights are linear in the radius.

    Attributes:
        radii: Radius at which step i starts, (n + 1,).
        reach: Last row of step i, (n,).
        first: Index of the first end of row k of step i, (n, K + 1); rows beyond a step's reach are empty.
        places: Row and column (k, j) of each end, (m, 2), int16.
        weights: Weight of each end at the step's start, and its derivative by the radius, (m, 2).
    """

    radii: np.ndarray
    reach: np.ndarray
    first: np.ndarray
    places: np.ndarray
    weights: np.ndarray


@njit(cache=True)
def _add_ends(radius, sign, dense):
    """Add ``sign`` times the ends of a disc to ``dense``, (rows, columns)."""
    size = dense.shape[0]
    places, weights = np.empty((size, 2), np.int32), np.empty((size, 2))
    for k in range(size):
        for n in range(list_row(radius, k, size, 0, places, weights)):
            dense[k, places[n, 1]] += sign * weights[n, 0]


@njit(cache=True)
def _fill(radii, first, places, weights):
    """Fill the table's lists; return the number of ends."""
    size = first.shape[1] - 1
    count = 0
    for step in range(first.shape[0]):
        start, change = np.zeros((size, size)), np.zeros((size, size))
        _add_ends(radii[step], 1.0, start)
        _add_ends(radii[step], -1.0, change)
        _add_ends(radii[step + 1], 1.0, change)
        for k in range(size):
            first[step, k] = count
            for j in range(size):
                if start[k, j] != 0.0 or change[k, j] != 0.0:
                    places[count, 0], places[count, 1] = k, j
                    weights[count, 0] = start[k, j]
                    weights[count, 1] = change[k, j] / (radii[step + 1] - radii[step])
                    count += 1
        first[step, size] = count
    return count


@njit(cache=True)
def find_step(table, radius):
    """Return the step of the table for ``radius``, the offset from its start in pixels, its last row."""
    step = (np.float32(radius - _OFFSET).view(np.int32) >> _STEP_BITS) - _FIRST_STEP
    return step, radius - table.radii[step], table.reach[step]


def _step_number(radius: float) -> int:
    return int(np.float32(radius - _OFFSET).view(np.int32)) >> _STEP_BITS


_FIRST_STEP = _step_number(SMALLEST_RADIUS)


@cache
def disc_table() -> DiscTable:
    """Return the table; it is computed once."""
    numbers = np.arange(_FIRST_STEP, _step_number(TABLE_RADIUS) + 2, dtype=np.int32)
    return list_discs((numbers << _STEP_BITS).view(np.float32).astype(np.float64) + _OFFSET)


def list_discs(radii: np.ndarray) -> DiscTable:
    """Return the ends of all discs between ascending radii in pixels, (n + 1,), each the start of a step."""
    steps, size = len(radii) - 1, math.ceil(radii[-1]) + 2
    first = np.empty((steps, size + 1), np.int32)
    places, weights = np.empty((steps * 4 * size, 2), np.int16), np.empty((steps * 4 * size, 2))
    count = _fill(radii, first, places, weights)
    reach = np.floor(radii[1:] + 0.5).astype(np.int32)
    return DiscTable(radii, reach, first, places[:count].copy(), weights[:count].copy())
