"""Depth discontinuities, where one surface ends in front of another: detection and sharpening."""

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

# Side of the tiles that are skipped as a whole where they have no step, pixels.
STEP_TILE = 16

# Change of defocus per pixel up to which two pixels on both sides of an occluder count as one surface.
_MAX_SLOPE = 0.1

# Bits of a pixel at a depth discontinuity: it belongs to the nearer surface, to the farther one, or (thin
# objects) to both.
FRONT, BACK = 1, 2

# Widest ramp, in pixels, that counts as a blurred depth discontinuity.
_MAX_RAMP_PX = 16

# Distance, and tolerance in defocus, within which a surface between two others must continue, pixels.
_SUPPORT_REACH_PX, _SUPPORT_TOLERANCE_PX = 2, 0.25


@njit(cache=True)
def are_one_surface(a, b, apart):
    """Return whether points at defocus ``a`` and ``b``, ``apart`` pixels apart, can be one surface."""
    return abs(a - b) <= DISCONTINUITY_THRESHOLD + _MAX_SLOPE * apart


@njit(cache=True)
def span(values, y, x, reach):
    """Return the lowest and highest value within ``reach`` pixels along both axes."""
    low = high = values[y, x]
    for v in range(max(0, y - reach), min(values.shape[0], y + reach + 1)):
        for u in range(max(0, x - reach), min(values.shape[1], x + reach + 1)):
            low = min(low, values[v, u])
            high = max(high, values[v, u])
    return low, high


@njit(cache=True, parallel=True)
def _find_steps(defocus, reach, threshold, stepped):
    height, width = defocus.shape
    for row in prange(stepped.shape[0]):
        for column in range(stepped.shape[1]):
            low = high = defocus[row * STEP_TILE, column * STEP_TILE]
            for y in range(max(0, row * STEP_TILE - reach), min(height, (row + 1) * STEP_TILE + reach)):
                for x in range(
                    max(0, column * STEP_TILE - reach), min(width, (column + 1) * STEP_TILE + reach)
                ):
                    low, high = min(low, defocus[y, x]), max(high, defocus[y, x])
            stepped[row, column] = high - low > threshold


def tiles_with_steps(
    defocus: np.ndarray, reach: int, threshold: float = DISCONTINUITY_THRESHOLD
) -> np.ndarray:
    """Return the mask of tiles of ``STEP_TILE`` pixels that may contain a step, (rows, columns) bool.

    Args:
        defocus: Signed blur radius, (H, W), pixels.
        reach: Pixels beyond a tile's border that count as the tile.
        threshold: Largest defocus difference that is not a step, pixels.
    """
    stepped = np.empty([-(-size // STEP_TILE) for size in defocus.shape], np.bool_)
    with parallel_region:
        _find_steps(defocus, reach, threshold, stepped)
    return stepped


@njit(cache=True, parallel=True)
def _discontinuity_sides(defocus, reach, stepped):
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
    """Return the bits ``FRONT`` and ``BACK`` of every pixel, (H, W) int8.

    Args:
        defocus: Signed blur radius, (H, W), float32, pixels.
        reach: Pixels from a depth discontinuity, along rows and columns, beyond which all bits are 0.
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
    value at the end of the ramp that is closer to its own. A surface between two others, such as a wire
    between a blade of grass and the lawn, differs from a ramp: pixels of the same defocus close by are not
    between others.

    Args:
        defocus: Signed blur radius, (H, W), float32, pixels.

    Returns:
        A new map (H, W). Steps of one pixel and slopes below ``DISCONTINUITY_THRESHOLD`` per pixel stay
        unchanged.
    """
    between = discontinuity_sides(defocus) == FRONT | BACK
    on_ramps = np.argwhere(between)
    if len(on_ramps):
        on_ramps = on_ramps[~_is_supported(defocus, between, on_ramps)]
    return _sharpen(defocus, on_ramps) if len(on_ramps) else defocus.copy()


@njit(cache=True)
def _is_supported(defocus, between, places):
    """Return whether each of ``places``, (N,), has a neighbour of its surface that is not between others."""
    height, width = defocus.shape
    supported = np.zeros(len(places), np.bool_)
    for i in range(len(places)):
        y, x = places[i]
        for v in range(max(0, y - _SUPPORT_REACH_PX), min(height, y + _SUPPORT_REACH_PX + 1)):
            for u in range(max(0, x - _SUPPORT_REACH_PX), min(width, x + _SUPPORT_REACH_PX + 1)):
                supported[i] |= (
                    not between[v, u] and abs(defocus[v, u] - defocus[y, x]) <= _SUPPORT_TOLERANCE_PX
                )
    return supported


@njit(cache=True)
def _sharpen(defocus, places):
    """Return the map with the pixels at ``places``, (N, 2), set to the closer end of their ramp."""
    result = defocus.copy()
    lows, highs = defocus.copy(), defocus.copy()
    new_lows, new_highs = np.empty(len(places)), np.empty(len(places))
    for _ in range(_MAX_RAMP_PX // 2):
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
