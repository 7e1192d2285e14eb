"""Picture from the rays' means: blurred surfaces are averaged over windows of pixels.

A disc of radius r has almost no energy at pixel frequency, so a window much smaller than r removes noise and
preserves the picture. Sharp surfaces, and the coverage of their edges, are not averaged. Windows of more than
``_MAX_RINGS`` rings consist of blocks of 2, 4 or 8 pixels a side; each pixel interpolates bilinearly between
the windows of the four blocks next to it.

Source: Burt and Adelson, "The Laplacian pyramid as a compact image code", 1983, for means of means.
"""

import math

import numpy as np
from numba import prange

from bokehnet.classical.layered.march.ray_accumulators import (
    BACK_GROUP,
    COLORED,
    FRONT_GROUP,
    GROUPS,
    SHARP_GROUP,
)
from bokehnet.kernels import njit

__all__ = ["resolve", "window_halo", "window_reach"]

# Half-width of a window, less its middle pixel, over the disc radius; limited to 1 to _MAX_REACH_PX pixels.
_REACH_BY_RADIUS = 1 / 12
_MAX_REACH_PX = 32

# Maximum rings of a window, and maximum levels of blocks.
_MAX_RINGS, _MAX_LEVELS = 4, 3


def window_halo(radius: float) -> int:
    """Return the rows around others that their pixels depend on, if no disc has more than this radius."""
    levels = _levels(radius)
    return math.ceil(_widest(radius)) + (2 << levels if levels else 0)


def _widest(radius: float) -> float:
    """Return the reach of the widest window, pixels, at least that of single pixels."""
    return min(max(_REACH_BY_RADIUS * radius, float(_MAX_RINGS)), float(_MAX_REACH_PX))


def _levels(radius: float) -> int:
    """Return the number of levels of blocks for this radius."""
    return math.ceil(math.log2(_widest(radius) / _MAX_RINGS))


@njit(cache=True, forceinline=True)
def window_reach(weight, steepness):
    """Return the reach of the window of a group, 1 to ``_MAX_REACH_PX`` pixels, as a float.

    Args:
        weight: Weight of the group.
        steepness: Weighted sum of 1 / radius of the group, which the smallest discs dominate.
    """
    if weight <= 0.0:
        return 1.0
    return min(max(_REACH_BY_RADIUS * weight / steepness, 1.0), float(_MAX_REACH_PX))


@njit(cache=True, forceinline=True)
def _level_of(reach):
    """Return the level of blocks, of 2^level pixels a side, for a window of this reach in pixels."""
    level = 0
    while reach > _MAX_RINGS << level:
        level += 1
    return level


@njit(cache=True, forceinline=True)
def _weight_of(window, group):
    """Return the weight of a group, mean over the colors."""
    weight, last = 0.0, window.shape[1] - 2
    for i in range(3, last):
        weight += window[group, i]
    return weight / (last - 3)


@njit(cache=True, forceinline=True)
def _add_pixel(sums, v, u, weight, window):
    for group in range(window.shape[0]):
        for c in range(window.shape[1]):
            window[group, c] += weight * sums[v, u, group, c]


@njit(cache=True)
def _add_ring(sums, y, x, reach, weight, window):
    """Add the pixels at the distance ``reach`` from a pixel, along either axis, to ``window``."""
    height, width = sums.shape[:2]
    for v in range(max(0, y - reach), min(height, y + reach + 1)):
        whole_row = abs(v - y) == reach
        for u in range(x - reach, x + reach + 1, 1 if whole_row else 2 * reach):
            if 0 <= u < width:
                _add_pixel(sums, v, u, weight, window)


@njit(cache=True, forceinline=True)
def _allowed_reach(window, group, level):
    """Return the reach in blocks of a level that the discs of a group in a window allow."""
    reach = window_reach(_weight_of(window, group), window[group, window.shape[1] - 2])
    return (reach + 0.5) / (1 << level) - 0.5


@njit(cache=True)
def _average(sums, y, x, group, level, window):
    """Grow a window of 3x3 blocks of a level as far as the discs of a group allow.

    Returns:
        True if the added discs allow it, too.
    """
    last = 1
    for ring in range(2, _MAX_RINGS + 1):
        weight = min(_allowed_reach(window, group, level) - (ring - 1), 1.0)
        if weight <= 0.0:
            break
        _add_ring(sums, y, x, ring, weight, window)
        last = ring
    return _allowed_reach(window, group, level) >= max(last - 1, 1)


@njit(cache=True, parallel=True)
def _halve(sums, occupied, smaller, smaller_occupied):
    """Add the sums over 2x2 of ``sums`` to ``smaller``; values beyond the border are 0.

    Args:
        sums: Sums of pixels or blocks.
        occupied: Pixels or blocks that sent rays; the sums of others are 0, (rows, columns) bool.
        smaller: Sums of half the size, 0.
        smaller_occupied: Output, ``occupied`` of half the size.
    """
    height, width = sums.shape[:2]
    for y in prange(smaller.shape[0]):
        for x in range(smaller.shape[1]):
            smaller_occupied[y, x] = False
            for v in range(2 * y, min(2 * y + 2, height)):
                for u in range(2 * x, min(2 * x + 2, width)):
                    if occupied[v, u]:
                        smaller_occupied[y, x] = True
                        _add_pixel(sums, v, u, 1.0, smaller[y, x])


@njit(cache=True, forceinline=True)
def _any_around(mask, y, x):
    """Return whether a mask is set at a position or next to it."""
    is_set = False
    for v in range(max(0, y - 1), min(mask.shape[0], y + 2)):
        for u in range(max(0, x - 1), min(mask.shape[1], x + 2)):
            is_set = is_set or mask[v, u]
    return is_set


@njit(cache=True, parallel=True)
def _fill_windows(sums, occupied, level, windows, fitting):
    """Fill windows around blocks of a level: all groups for the front, then the group behind, alone.

    Pixels read the windows of blocks next to their own: only those next to an ``occupied`` one are filled.
    """
    for y in prange(sums.shape[0]):
        window = np.empty(sums.shape[2:])
        for x in range(sums.shape[1]):
            if not _any_around(occupied, y, x):
                continue
            for i in range(2):
                window[:] = 0.0
                _add_pixel(sums, y, x, 1.0, window)
                _add_ring(sums, y, x, 1, 1.0, window)
                group = FRONT_GROUP if i == 0 else BACK_GROUP
                fitting[y, x, i] = _average(sums, y, x, group, level, window)
                for c in range(window.shape[1]):
                    if i == 1:
                        windows[y, x, GROUPS, c] = window[BACK_GROUP, c]
                        continue
                    for g in range(GROUPS):
                        windows[y, x, g, c] = window[g, c]


@njit(cache=True)
def _from_blocks(windows, fitting, y, x, level, group, window):
    """Fill ``window`` from those of the four blocks next to a pixel, unless their discs are too small.

    Returns:
        True if it is filled.
    """
    rows, columns = fitting.shape[:2]
    side = float(1 << level)
    v, u = max((y + 0.5) / side - 0.5, 0.0), max((x + 0.5) / side - 0.5, 0.0)
    top, left = min(int(v), rows - 1), min(int(u), columns - 1)
    bottom, right = min(top + 1, rows - 1), min(left + 1, columns - 1)
    down, along = v - top, u - left
    behind = 1 if group == BACK_GROUP else 0
    window[:] = 0.0
    for i in range(2):
        for j in range(2):
            row, column = bottom if i else top, right if j else left
            weight = (down if i else 1.0 - down) * (along if j else 1.0 - along)
            if weight == 0.0:
                continue
            group_weight = _weight_of(windows[row, column], GROUPS if behind else FRONT_GROUP)
            if group_weight > 0.0 and not fitting[row, column, behind]:
                return False
            if behind:
                for c in range(window.shape[1]):
                    window[BACK_GROUP, c] += weight * windows[row, column, GROUPS, c]
            else:
                for g in range(GROUPS):
                    for c in range(window.shape[1]):
                        window[g, c] += weight * windows[row, column, g, c]
    return True


@njit(cache=True)
def _widest_window(sums, windows, fitting, y, x, group, start, window):
    """Fill ``window`` with the widest one around a pixel that the discs of a group allow.

    Args:
        sums: Sums of the pixels.
        windows: Windows of the blocks of each level, from the first on.
        fitting: True where the discs in them allow them.
        y: Row.
        x: Column.
        group: Group whose discs count.
        start: Window of 3x3 pixels.
        window: Output, same shape.
    """
    reach = window_reach(_weight_of(start, group), start[group, start.shape[1] - 2])
    for level in range(min(_level_of(reach), len(windows)), 0, -1):
        if _from_blocks(windows[level - 1], fitting[level - 1], y, x, level, group, window):
            return
    for g in range(GROUPS):
        for c in range(window.shape[1]):
            window[g, c] = start[g, c]
    _average(sums, y, x, group, 0, window)


@njit(cache=True, parallel=True)
def _resolve(sums, windows, fitting, rays_mask, first, top, bottom, result, disocclusion_weight):
    width, numbers = rays_mask.shape[1], sums.shape[3]
    own = 1 if numbers == COLORED else 0  # 1 if each color has a weight of its own
    for y in prange(top, bottom):
        start = np.empty((GROUPS, numbers))
        front_window, back_window = np.empty((GROUPS, numbers)), np.empty((GROUPS, numbers))
        row = y - first
        for x in range(width):
            if not rays_mask[y, x]:
                continue
            start[:] = 0.0
            _add_pixel(sums, row, x, 1.0, start)
            _add_ring(sums, row, x, 1, 1.0, start)
            unseen, weight = 0.0, 0.0
            for group in range(GROUPS):
                unseen += start[group, numbers - 1]
                weight += _weight_of(start, group)
            if weight > 0.0:
                disocclusion_weight[y, x] = unseen / weight
            _widest_window(sums, windows, fitting, row, x, FRONT_GROUP, start, front_window)
            _widest_window(sums, windows, fitting, row, x, BACK_GROUP, start, back_window)
            for c in range(3):
                i = 3 + own * c
                before, within, beyond = front_window[0, i], front_window[1, i], front_window[2, i]
                total = before + within + beyond
                if total <= 0.0:
                    continue
                front = before / total
                sharp, back = sums[row, x, SHARP_GROUP, i], sums[row, x, BACK_GROUP, i]
                rest = 0.0
                if sharp > 0.0:
                    rest += sums[row, x, SHARP_GROUP, c] / (sharp + back)
                if back > 0.0:
                    rest += back / (sharp + back) * back_window[2, c] / back_window[2, i]
                if sharp + back == 0.0 and front < 1.0:
                    rest = (front_window[1, c] + front_window[2, c]) / (within + beyond)
                result[y, x, c] = front_window[0, c] / total + (1.0 - front) * rest


def resolve(
    sums: np.ndarray,
    rays_mask: np.ndarray,
    first: int,
    top: int,
    bottom: int,
    result: np.ndarray,
    disocclusion_weight: np.ndarray,
    radius: float,
) -> None:
    """Turn the means of rows ``top`` to ``bottom`` into colors; ``sums`` begin at row ``first``.

    Args:
        sums: See :mod:`bokehnet.classical.layered.march.ray_accumulators`, (rows, W, GROUPS, numbers),
            float32; 0 where no rays were sent. They contain :func:`window_halo` rows more on either side, or
            end at the border of the picture.
        rays_mask: Pixels to write, (H, W) bool.
        first: Row of the picture at which ``sums`` begin, a multiple of the largest block's side.
        top: First row to write.
        bottom: Row behind the last one to write.
        result: Output colors, (H, W, 3), float32.
        disocclusion_weight: Output weights, (H, W), float32.
        radius: Largest radius of any disc, pixels.
    """
    levels = _levels(radius)
    windows, fitting, blocks = [], [], sums
    occupied = rays_mask[first : first + len(sums)]
    for level in range(1, _MAX_LEVELS + 1):
        shape = ((len(blocks) + 1) // 2, (blocks.shape[1] + 1) // 2) if level <= levels else (0, 0)
        smaller = np.zeros((*shape, *sums.shape[2:]), np.float32)
        smaller_occupied = np.empty(shape, np.bool_)
        windows.append(np.empty((*shape, GROUPS + 1, sums.shape[3]), np.float32))
        fitting.append(np.empty((*shape, 2), np.bool_))
        _halve(blocks, occupied, smaller, smaller_occupied)
        _fill_windows(smaller, smaller_occupied, level, windows[-1], fitting[-1])
        blocks, occupied = smaller, smaller_occupied
    outputs = (result, disocclusion_weight)
    _resolve(sums, tuple(windows), tuple(fitting), rays_mask, first, top, bottom, *outputs)
