"""Depth discontinuities, where one surface ends before another: where they are, soft ones sharpened."""

import numpy as np
from numba import prange

from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit

__all__ = [
    "BACK",
    "DISCONTINUITY_THRESHOLD",
    "FRONT",
    "STEP_TILE",
    "are_one_surface",
    "discontinuity_sides",
    "sharpen_discontinuities",
    "span",
    "tiles_with_steps",
]

# Neighbouring pixels whose defocus differs by more than this many pixels belong to two surfaces.
DISCONTINUITY_THRESHOLD = 1.0

# Sides of the tiles that are passed over together where there is no step.
STEP_TILE = 16

# Defocus by which a surface may change from pixel to pixel and still be one on both sides of what hides it.
_SLOPE = 0.1

# Bits of a pixel at a depth discontinuity: it belongs to the nearer surface, to the farther one, or (thin
# things) to both.
FRONT, BACK = 1, 2

# Widest ramp, in pixels, that is taken for a blurred depth discontinuity.
_WIDEST_RAMP = 16

# A surface between two others goes on within so many pixels, at the same defocus but for so much.
_SUPPORT, _SAME = 2, 0.25


@njit(cache=True)
def are_one_surface(a, b, apart):  # type: ignore[no-untyped-def]
    """Whether two places, at defocus ``a`` and ``b`` and so many pixels apart, may be of one surface."""
    return abs(a - b) <= DISCONTINUITY_THRESHOLD + _SLOPE * apart


@njit(cache=True)
def span(values, y, x, reach):  # type: ignore[no-untyped-def]
    """Lowest and highest value among the neighbours up to so many pixels away."""
    low = high = values[y, x]
    for v in range(max(0, y - reach), min(values.shape[0], y + reach + 1)):
        for u in range(max(0, x - reach), min(values.shape[1], x + reach + 1)):
            low = min(low, values[v, u])
            high = max(high, values[v, u])
    return low, high


@njit(cache=True, parallel=True)
def _find_steps(defocus, reach, least, stepped):  # type: ignore[no-untyped-def]
    height, width = defocus.shape
    for row in prange(stepped.shape[0]):
        for column in range(stepped.shape[1]):
            low = high = defocus[row * STEP_TILE, column * STEP_TILE]
            for y in range(max(0, row * STEP_TILE - reach), min(height, (row + 1) * STEP_TILE + reach)):
                for x in range(
                    max(0, column * STEP_TILE - reach), min(width, (column + 1) * STEP_TILE + reach)
                ):
                    low, high = min(low, defocus[y, x]), max(high, defocus[y, x])
            stepped[row, column] = high - low > least


def tiles_with_steps(defocus: np.ndarray, reach: int, least: float = DISCONTINUITY_THRESHOLD) -> np.ndarray:
    """Which tiles, ``STEP_TILE`` pixels wide and high, may hold a step: (rows, columns) of them, bool.

    Args:
        defocus: (H, W).
        reach: Pixels beyond a tile's border that are looked at too.
        least: What is no step yet, pixels of defocus.
    """
    stepped = np.empty([-(-size // STEP_TILE) for size in defocus.shape], np.bool_)
    with parallel_region:
        _find_steps(defocus, reach, least, stepped)
    return stepped


@njit(cache=True, parallel=True)
def _discontinuity_sides(defocus, reach, stepped):  # type: ignore[no-untyped-def]
    height, width = defocus.shape
    sides = np.zeros((height, width), np.int8)
    for y in prange(height):
        for x in range(width):
            if not stepped[y // STEP_TILE, x // STEP_TILE]:
                continue
            low, high = span(defocus, y, x, reach)
            if low < defocus[y, x] - DISCONTINUITY_THRESHOLD:
                sides[y, x] |= FRONT
            if high > defocus[y, x] + DISCONTINUITY_THRESHOLD:
                sides[y, x] |= BACK
    return sides


def discontinuity_sides(defocus: np.ndarray, reach: int = 1) -> np.ndarray:
    """Bits ``FRONT`` and ``BACK`` of every pixel, (H, W) int8.

    Args:
        defocus: (H, W), float32.
        reach: Pixels from a depth discontinuity, along rows and columns, beyond which all are 0.
    """
    stepped = tiles_with_steps(defocus, reach)
    with parallel_region:
        sides: np.ndarray = _discontinuity_sides(defocus, reach, stepped)
    return sides


def sharpen_discontinuities(defocus: np.ndarray) -> np.ndarray:
    """Turn steep ramps into steps.

    A resized, smoothed or estimated disparity map passes from one surface to the next through values
    that belong to neither; where they pass through focus a renderer would draw a sharp sliver. A pixel
    inside such a ramp, with neighbours more than ``DISCONTINUITY_THRESHOLD`` above and below it, takes the
    value at that end of the ramp which is closer to its own. Surfaces that stand between two others, as a
    wire between a blade of grass and the lawn, are told from ramps by pixels of the same defocus close by
    that are not between others.

    Args:
        defocus: (H, W), float32.

    Returns:
        A new map (H, W). Steps of one pixel and slopes below ``DISCONTINUITY_THRESHOLD`` a pixel stay as they
        are.
    """
    between = discontinuity_sides(defocus) == FRONT | BACK
    on_ramps = np.argwhere(between)
    if len(on_ramps):
        on_ramps = on_ramps[~_is_supported(defocus, between, on_ramps)]
    return _sharpen(defocus, on_ramps) if len(on_ramps) else defocus.copy()


@njit(cache=True)
def _is_supported(defocus, between, places):  # type: ignore[no-untyped-def]
    """Whether a pixel of the same surface that is not between others is near each of ``places``, (N,)."""
    height, width = defocus.shape
    found = np.zeros(len(places), np.bool_)
    for i in range(len(places)):
        y, x = places[i]
        for v in range(max(0, y - _SUPPORT), min(height, y + _SUPPORT + 1)):
            for u in range(max(0, x - _SUPPORT), min(width, x + _SUPPORT + 1)):
                found[i] |= not between[v, u] and abs(defocus[v, u] - defocus[y, x]) <= _SAME
    return found


@njit(cache=True)
def _sharpen(defocus, places):  # type: ignore[no-untyped-def]
    """Let the pixels at ``places``, (N, 2), take the value of the nearer end of their ramp."""
    result = defocus.copy()
    lows, highs = defocus.copy(), defocus.copy()
    new_lows, new_highs = np.empty(len(places)), np.empty(len(places))
    for _ in range(_WIDEST_RAMP // 2):
        for i in range(len(places)):
            y, x = places[i]
            new_lows[i], new_highs[i] = span(lows, y, x, 1)[0], span(highs, y, x, 1)[1]
        for i in range(len(places)):
            y, x = places[i]
            lows[y, x], highs[y, x] = new_lows[i], new_highs[i]
    for i in range(len(places)):
        y, x = places[i]
        near, far = highs[y, x], lows[y, x]
        result[y, x] = near if near - defocus[y, x] < defocus[y, x] - far else far
    return result
