"""Optical vignetting inside the kernels: interval of each row of a shape that the second pupil transmits.

The second disc has the shape's own radius r; its centre is ``r * shift`` from the shape's (the shift of
:func:`cats_eye_shift` times the sign of the defocus). In each row the disc covers an interval that has the
disc's exact area between the row's upper and lower border; a pixel's fraction of the light is multiplied by
its length inside that interval. (Approximately so where an interval is less than a pixel long.)

The transmitted light is divided by the transmitted fraction, so that a source keeps all its light. These
fractions change slowly with shift and radius: they are tabulated, and interpolated linearly.
"""

import math
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from bokehnet.classical.scatter.aperture_table import MAX_CACHED_APERTURES, STEP, ShapeTable
from bokehnet.classical.scatter.disc_table import SMALLEST_RADIUS
from bokehnet.classical.simd.float8 import LANES, broadcast8, indices8, load8, overlap8, sum8
from bokehnet.kernels import njit
from bokehnet.optics.aperture import Aperture, cats_eye_shift

__all__ = [
    "SMALLEST_SHARE",
    "SMALL_STEPS",
    "STEP_PARTS",
    "View",
    "chord_room",
    "every_second",
    "find_chords",
    "make_view",
    "share_at",
    "share_table",
]

# Below this transmitted fraction the shape is not clipped: no position of a picture turns black.
SMALLEST_SHARE = 0.02

# Tabulated shifts along each axis, from -cats_eye to cats_eye.
_SHIFTS = 33

# From this step of the radius table on, the fractions of every eighth step are computed.
_DENSE_STEPS, _STRIDE = 128, 8

# In the first steps, where pixels of a shape appear and disappear, the fractions are tabulated within a step.
SMALL_STEPS, STEP_PARTS = 8, 8


class View(NamedTuple):
    """Position of a grid in the full-size picture: second pupil's shift at (x, y) = (u + x du, v + y dv).

    Attributes:
        cats_eye: ``Aperture.cats_eye``.
        u: Shift at the pixel (0, 0), to the right.
        v: Shift at the pixel (0, 0), down.
        du: Change of the shift per pixel to the right.
        dv: Change of the shift per pixel down.
    """

    cats_eye: float
    u: float
    v: float
    du: float
    dv: float


def make_view(
    cats_eye: float, full_shape: tuple[int, int], scale: float, origin: tuple[int, int] = (0, 0)
) -> View:
    """Return the view of a grid whose pixel x is centred on ``(x + 1/2) scale - 1/2`` of the full size.

    The grid begins at the column and row ``origin`` of the full-size picture.
    """
    (height, width), (left, top) = full_shape, origin
    first, second = 0.5 * scale - 0.5, 1.5 * scale - 0.5
    u, v = cats_eye_shift(cats_eye, first + left, first + top, width, height)
    next_u, next_v = cats_eye_shift(cats_eye, second + left, second + top, width, height)
    return View(float(cats_eye), u, v, next_u - u, next_v - v)


def every_second(view: View, x: int, y: int) -> View:
    """Return the view of a grid of every second pixel, from the pixel (x, y) of this one on."""
    return View(view.cats_eye, view.u + x * view.du, view.v + y * view.dv, 2 * view.du, 2 * view.dv)


@njit(cache=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def _area_to(t):
    """Return the area under the unit circle's upper half from 0 to t, in t's own number type.

    The area beyond |t| is (1 - |t|)^(3/2) times a smooth function, here a polynomial that is exact for
    t = 0 and within 3e-8 up to 1: unlike with the arc sine, a loop over it compiles to vector instructions.
    """
    number = type(t)
    quarter, a, b = number(0.25 * math.pi), number(0.17809490113050896), number(-0.027327132067406047)
    c, d = number(0.009365181684620243), number(-0.0035515348419381957)
    e = number(0.0008353142064455885)
    far = abs(t)
    rest = max(number(1) - far, number(0))
    smooth = quarter + far * (a + far * (b + far * (c + far * (d + far * e))))
    area = quarter - rest * math.sqrt(rest) * smooth
    return area if t >= number(0) else -area


@njit(cache=True)
def chord_room(rows):
    """Return the number of chords that are computed for ``rows``: whole vectors on any machine."""
    return (rows + 15) // 16 * 16


@njit(cache=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def find_chords(radius, u, v, lowest, highest, halves, growths):
    """Compute the interval that the second disc covers in each row of a shape.

    Args:
        radius: Blur radius in pixels, above 0.
        u: Shift in radii, with the sign of the defocus.
        v: Shift down, in radii.
        lowest: First row, counted from the source.
        highest: Last row.
        halves: (n,), filled for row ``lowest + i``: half the chord plus half a pixel, the argument of
            :func:`overlap8`; 0 where a row gets nothing. n >= :func:`chord_room` of the rows.
        growths: (n,), filled with their derivatives by the step of the radius table, or (0,).
    """
    number = halves.dtype.type
    first, rise = number((lowest - 0.5) / radius - v), number(1 / radius)
    square, narrowest = number(radius * radius), number(0.5)
    count = highest - lowest + 1
    for i in range(chord_room(count)):
        half = square * (_area_to(first + rise * number(i + 1)) - _area_to(first + rise * number(i)))
        halves[i] = half + min(half, narrowest)
    if growths.shape[0] > 0:
        for i in range(count):
            k = lowest + i
            lower, upper = (k - 0.5) / radius - v, (k + 0.5) / radius - v
            narrow = halves[i] < 1.0
            growth = 2.0 / radius * (0.5 * halves[i] if narrow else halves[i] - 0.5)
            growth += (k - 0.5) * math.sqrt(max(1.0 - lower * lower, 0.0))
            growth -= (k + 0.5) * math.sqrt(max(1.0 - upper * upper, 0.0))
            growths[i] = STEP * growth * (2.0 if narrow else 1.0)


@njit(cache=True)
def _transmitted(table, middle, reach, step, along, u, v, halves):
    """Return the fraction of a shape's light that the second disc transmits."""
    number = table.parts.dtype.type
    radius = SMALLEST_RADIUS + (step + along) * STEP
    find_chords(radius, u, v, -reach, reach, halves, halves[:0])
    f, from_centre = broadcast8(number(along)), indices8(number(-radius * u))
    total = broadcast8(number(0))
    for block in range(table.first[middle - reach], table.first[middle + reach + 1]):
        index = 2 * LANES * block
        part = load8(table.parts, index) + f * load8(table.parts, index + LANES)
        distance = from_centre + broadcast8(number(table.columns[block]))
        total = total + part * overlap8(distance, broadcast8(halves[reach + table.rows[block]]))
    return sum8(total)


@njit(cache=True)
def _fill_shares(table, cats_eye, step, along, shares):
    """Fill one entry of a table of fractions, (2, shifts, shifts)."""
    shifts, reach = shares.shape[2], table.reach[step]
    halves = np.empty(chord_room(2 * reach + 1), table.parts.dtype)
    for side in range(2):
        middle = table.middle[side, step]
        if side == 1 and middle == table.middle[0, step]:
            shares[1] = shares[0]
            continue
        for i in range(shifts):
            v = cats_eye * (2.0 * i / (shifts - 1) - 1.0)
            for j in range(shifts):
                u = cats_eye * (2.0 * j / (shifts - 1) - 1.0)
                shares[side, i, j] = _transmitted(table, middle, reach, step, along, u, v, halves)


def _make_shares(table: ShapeTable, cats_eye: float) -> np.ndarray:
    steps = len(table.reach)
    shares = np.empty((2, steps + SMALL_STEPS * STEP_PARTS + 1, _SHIFTS, _SHIFTS), np.float32)
    computed_steps = sorted(
        {*range(min(_DENSE_STEPS, steps)), *range(_DENSE_STEPS, steps, _STRIDE), steps - 1}
    )
    for step in computed_steps:
        _fill_shares(table, cats_eye, step, 0.0, shares[:, step])
    for lower, upper in pairwise(computed_steps):
        along = (np.arange(1, upper - lower) / (upper - lower))[:, None, None].astype(np.float32)
        low, high = shares[:, lower, None], shares[:, upper, None]
        shares[:, lower + 1 : upper] = low + along * (high - low)
    for substep in range(SMALL_STEPS * STEP_PARTS + 1):
        step, along = divmod(substep, STEP_PARTS)
        _fill_shares(table, cats_eye, step, along / STEP_PARTS, shares[:, steps + substep])
    return shares


def share_table(aperture: Aperture, table: ShapeTable) -> np.ndarray:
    """Return the transmitted fraction of the light, float32, (side, entry, v, u), shifts up to ``cats_eye``.

    The entries are the steps of the radius table, followed by parts of its first ``SMALL_STEPS`` steps and
    their end. Without a cat's-eye the table is empty. Tables are cached like the radius tables.
    """
    if aperture.cats_eye == 0:
        return np.zeros((0, 0, 0, 0), np.float32)
    cached = _cached_shares(aperture, table.parts.dtype.name)
    if not cached or cached[0].shape[1] <= len(table.reach) + SMALL_STEPS * STEP_PARTS:
        cached[:] = [_make_shares(table, aperture.cats_eye)]
    return cached[0]


@lru_cache(maxsize=MAX_CACHED_APERTURES)
def _cached_shares(aperture: Aperture, dtype: str) -> list[np.ndarray]:
    """Return the list that holds the largest table computed so far."""
    return []


@njit(cache=True, forceinline=True)
def _between(shares, side, place, i, j, y, x):
    above = (1.0 - x) * shares[side, place, i, j] + x * shares[side, place, i, j + 1]
    below = (1.0 - x) * shares[side, place, i + 1, j] + x * shares[side, place, i + 1, j + 1]
    return (1.0 - y) * above + y * below


@njit(cache=True, error_model="numpy", forceinline=True)
def share_at(shares, cats_eye, side, step, along, u, v):
    """Return the transmitted fraction of the light, and its derivative by the radius."""
    cells = shares.shape[2] - 1
    place_x = min(max((u / cats_eye + 1.0) * (0.5 * cells), 0.0), float(cells))
    place_y = min(max((v / cats_eye + 1.0) * (0.5 * cells), 0.0), float(cells))
    i, j = min(int(place_y), cells - 1), min(int(place_x), cells - 1)
    y, x = place_y - i, place_x - j
    place, parts = step, 1
    if step < SMALL_STEPS:
        parts = STEP_PARTS
        along *= parts
        place = shares.shape[1] - 1 + (step - SMALL_STEPS) * parts + int(along)
        along -= int(along)
    low = _between(shares, side, place, i, j, y, x)
    high = _between(shares, side, place + 1, i, j, y, x)
    return low + along * (high - low), (high - low) * (parts / STEP)
