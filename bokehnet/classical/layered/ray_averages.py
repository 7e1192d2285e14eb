"""The picture that comes of the rays' means: blurred surfaces are averaged over windows of pixels.

A disc of radius r has next to nothing at the frequency of pixels, so a window much smaller than r takes noise
away and leaves the picture. Sharp surfaces, and what their edges cover, are each pixel's own.
"""

import numpy as np
from numba import prange

from bokehnet.classical.layered.ray_accumulators import BACK_GROUP, COLORED, FRONT_GROUP, SHARP_GROUP
from bokehnet.kernels import njit

__all__ = ["WIDEST", "resolve", "window_reach"]

# Half-width of a window, less its middle, over the radius of the discs; at least 1 pixel, at most WIDEST.
_REACH_BY_RADIUS = 1 / 12
WIDEST = 4


@njit(cache=True, forceinline=True)
def window_reach(weight, steepness):  # type: ignore[no-untyped-def]
    """How many pixels to either side the window of a group may reach, 1 to ``WIDEST``, not in whole pixels.

    Args:
        weight: Of the group.
        steepness: Its weighted sum of 1 / radius, so that the smallest discs prevail.
    """
    if weight <= 0.0:
        return 1.0
    return min(max(_REACH_BY_RADIUS * weight / steepness, 1.0), float(WIDEST))


@njit(cache=True, forceinline=True)
def _add_pixel(sums, v, u, share, window):  # type: ignore[no-untyped-def]
    for group in range(window.shape[0]):
        for c in range(window.shape[1]):
            window[group, c] += share * sums[v, u, group, c]


@njit(cache=True)
def _add_ring(sums, y, x, reach, share, window):  # type: ignore[no-untyped-def]
    """Add the pixels that are ``reach`` away from a pixel, along either axis, to ``window``."""
    height, width = sums.shape[:2]
    for v in range(max(0, y - reach), min(height, y + reach + 1)):
        whole_row = abs(v - y) == reach
        for u in range(x - reach, x + reach + 1, 1 if whole_row else 2 * reach):
            if 0 <= u < width:
                _add_pixel(sums, v, u, share, window)


@njit(cache=True)
def _average(sums, y, x, group, window):  # type: ignore[no-untyped-def]
    """Let a window that holds the 3x3 pixels grow as far as the discs of a group allow."""
    numbers = window.shape[1]
    for ring in range(2, WIDEST + 1):
        weight = 0.0
        for i in range(3, numbers - 2):
            weight += window[group, i] / (numbers - 5)
        share = min(window_reach(weight, window[group, numbers - 2]) - (ring - 1), 1.0)
        if share <= 0.0:
            break
        _add_ring(sums, y, x, ring, share, window)


@njit(cache=True, parallel=True)
def resolve(sums, rays_mask, first, top, bottom, result, disocclusion_weight):  # type: ignore[no-untyped-def]
    """Turn the means of rows ``top`` to ``bottom`` into colours; ``sums`` begin at row ``first``.

    Args:
        sums: See :mod:`bokehnet.classical.layered.ray_accumulators`, (rows, W, GROUPS, numbers); 0 where no
            rays were sent.
        rays_mask: Pixels to write, (H, W) bool.
        first: Row of the picture at which ``sums`` begin.
        top: First row to write.
        bottom: The row behind the last one.
        result: (H, W, 3), float32.
        disocclusion_weight: (H, W), float32.
    """
    width, numbers = rays_mask.shape[1], sums.shape[3]
    own = 1 if numbers == COLORED else 0  # whether each colour has a weight of its own
    for y in prange(top, bottom):
        front_window, back_window = np.empty((3, numbers)), np.empty((3, numbers))
        row = y - first
        for x in range(width):
            if not rays_mask[y, x]:
                continue
            front_window[:] = 0.0
            _add_pixel(sums, row, x, 1.0, front_window)
            _add_ring(sums, row, x, 1, 1.0, front_window)
            back_window[:] = front_window
            unseen, weight = 0.0, 0.0
            for group in range(front_window.shape[0]):
                unseen += front_window[group, numbers - 1]
                for i in range(3, numbers - 2):
                    weight += front_window[group, i] / (numbers - 5)
            if weight > 0.0:
                disocclusion_weight[y, x] = unseen / weight
            _average(sums, row, x, FRONT_GROUP, front_window)
            _average(sums, row, x, BACK_GROUP, back_window)
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
