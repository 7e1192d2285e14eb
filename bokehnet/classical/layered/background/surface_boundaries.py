"""Boundaries between the surfaces that continue behind an occluder: ragged ones become smooth.

Each occluded pixel selects its surface alone, by eight directions. Where two surfaces meet behind an occluder
their boundary then has spikes along these directions, which show where one of the surfaces is in focus.
A median of the defocus over a window removes spikes from their ends and keeps straight boundaries. Pixels
whose surface continues on both sides of them in some direction stay, so that poles are not removed.
"""

import numpy as np
from numba import prange

from bokehnet.classical.layered.depth_discontinuities import DISCONTINUITY_THRESHOLD, are_one_surface
from bokehnet.kernels import njit

__all__ = ["smooth_boundaries", "write_occluded"]

# Distance from the edge of the occluder, pixels, from which boundaries are smoothed: next to the edge the
# surfaces of the directions are reliable.
_MIN_DISTANCE_PX = 8.0

# Half-width of the window in samples; spacing of the samples over the distance from the edge, and its maximum
# in pixels; number of passes.
_REACH, _SPACING_BY_DISTANCE, _MAX_SPACING_PX, _PASSES = 3, 1 / 6, 4, 4


@njit(cache=True, forceinline=True)
def _continues(depths, y, x, down, right, nearest):
    """Return whether the surface of a pixel continues over ``_REACH`` steps on both sides of it."""
    height, width = depths.shape
    for k in range(-_REACH, _REACH + 1):
        v, u = min(max(y + k * down, 0), height - 1), min(max(x + k * right, 0), width - 1)
        if depths[v, u] >= nearest or not are_one_surface(depths[v, u], depths[y, x], 0.0):
            return False
    return True


@njit(cache=True)
def _upper_median(values, count):
    """Return the value at ``count // 2`` of the first ``count`` values in order; reorders them."""
    low, high, middle = 0, count - 1, count // 2
    while low < high:
        pivot, i, j = values[middle], low, high
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i += 1
                j -= 1
        if j < middle:
            low = i
        if i > middle:
            high = j
    return values[middle]


@njit(cache=True, parallel=True)
def _select_medians(ys, xs, defocus, distances, colors, depths, new_colors, new_depths, mixed):
    """Write the surface of the median of each pixel's window, (N,), or its own if both are one surface.

    ``mixed`` (N,) becomes True where a window has more than one surface.
    """
    height, width = depths.shape
    side = 2 * _REACH + 1
    for i in prange(len(ys)):
        y, x = ys[i], xs[i]
        new_depths[i] = depths[y, x]
        for c in range(3):
            new_colors[i, c] = colors[y, x, c]
        spacing = min(max(int(round(distances[y, x] * _SPACING_BY_DISTANCE)), 1), _MAX_SPACING_PX)
        values, count = np.empty(side * side, np.float32), 0
        low, high, nearest = np.inf, -np.inf, defocus[y, x] - DISCONTINUITY_THRESHOLD
        for k in range(side * side):
            v, u = y + spacing * (k // side - _REACH), x + spacing * (k % side - _REACH)
            if 0 <= v < height and 0 <= u < width and depths[v, u] < nearest:
                values[count] = depths[v, u]
                low, high = min(low, values[count]), max(high, values[count])
                count += 1
        mixed[i] = high - low > DISCONTINUITY_THRESHOLD
        if not mixed[i]:
            continue
        if (
            _continues(depths, y, x, 0, spacing, nearest)
            or _continues(depths, y, x, spacing, 0, nearest)
            or _continues(depths, y, x, spacing, spacing, nearest)
            or _continues(depths, y, x, spacing, -spacing, nearest)
        ):
            continue
        median = _upper_median(values, count)
        if are_one_surface(median, depths[y, x], spacing):
            continue
        total = depth = red = green = blue = 0.0
        for k in range(side * side):
            down, right = spacing * (k // side - _REACH), spacing * (k % side - _REACH)
            v, u = y + down, x + right
            if not (0 <= v < height and 0 <= u < width and depths[v, u] < nearest):
                continue
            if are_one_surface(median, depths[v, u], 0.0):
                w = 1.0 / (down * down + right * right)
                total += w
                depth += w * depths[v, u]
                red += w * colors[v, u, 0]
                green += w * colors[v, u, 1]
                blue += w * colors[v, u, 2]
        new_depths[i] = depth / total
        new_colors[i, 0], new_colors[i, 1], new_colors[i, 2] = red / total, green / total, blue / total


@njit(cache=True, parallel=True)
def write_occluded(ys, xs, defocus, new_colors, new_depths, colors, depths):
    """Set the occluded background, (N), nowhere in front of its occluder."""
    for i in prange(len(ys)):
        y, x = ys[i], xs[i]
        depths[y, x] = min(new_depths[i], defocus[y, x])
        for c in range(3):
            colors[y, x, c] = new_colors[i, c]


def smooth_boundaries(
    ys: np.ndarray,
    xs: np.ndarray,
    defocus: np.ndarray,
    distances: np.ndarray,
    colors: np.ndarray,
    depths: np.ndarray,
) -> None:
    """Smooth the boundaries of the occluded background in place.

    Args:
        ys: Rows of the occluded pixels, (N,).
        xs: Their columns, (N,).
        defocus: Defocus of the occluders, (H, W), pixels.
        distances: Distance of occluded pixels from the edge of the occluder, (H, W), pixels.
        colors: Occluded background, (H, W, 3); overwritten at the occluded pixels.
        depths: Its defocus, (H, W); overwritten there.
    """
    mixed = distances[ys, xs] >= _MIN_DISTANCE_PX
    for _ in range(_PASSES):
        ys, xs = ys[mixed], xs[mixed]
        new_colors, new_depths = np.empty((len(ys), 3), colors.dtype), np.empty(len(ys), depths.dtype)
        mixed = np.empty(len(ys), np.bool_)
        _select_medians(ys, xs, defocus, distances, colors, depths, new_colors, new_depths, mixed)
        write_occluded(ys, xs, defocus, new_colors, new_depths, colors, depths)
