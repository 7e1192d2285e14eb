"""What lies between two views of an accumulation, seen by rays through one of them: thesis 002, 3.4.

A view is a height field. Around its point of the pupil lie points of its own, and a ray through one of them
meets the surface whose blur moves it by just what the ray is away from the pixel. Bounds of the blur around
each pixel, by N-buffers, say how far to look. Rays that meet nothing take the view's own colour: a single
layer has nothing behind its surfaces.

Source: thesis 002, algorithms 3.2 and 3.3; N-buffers: Decoret, "N-buffers for efficient depth map query",
Eurographics 2005.
"""

import math

import numpy as np

from bokehnet.kernels import njit

__all__ = ["n_buffers", "radius_bounds", "subsample_blur"]

# A ray meets a surface that it passes by no more than this, pixels.
_NEAR_ENOUGH = 1.0

# How often bounds are looked for inside the last ones.
_ROUNDS = 3


def n_buffers(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest of ``values`` (H, W) over squares of 1, 2, 4, ... pixels, (levels, H, W).

    Level i at (y, x) is of the square of side 2^i whose upper left corner is there; beyond the border the
    values at the border count.
    """
    height, width = values.shape
    low, high = [values], [values]
    step = 1
    while step < max(height, width):
        down, right = (
            np.minimum(np.arange(height) + step, height - 1),
            np.minimum(np.arange(width) + step, width - 1),
        )
        for kept, of in ((low, np.minimum), (high, np.maximum)):
            last = kept[-1]
            kept.append(of(of(last, last[down]), of(last[:, right], last[down][:, right])))
        step *= 2
    return np.stack(low), np.stack(high)


@njit(cache=True)
def radius_bounds(low, high, y, x, reach):  # type: ignore[no-untyped-def]
    """Least and largest value within ``reach`` pixels of (y, x), by four look-ups each; a little beyond."""
    height, width = low.shape[1], low.shape[2]
    side = 2 * reach + 1
    level = 0
    while 2 << level <= side and level + 1 < low.shape[0]:
        level += 1
    back = side - (1 << level)
    least, most = np.inf, -np.inf
    for j in (y - reach, y - reach + back):
        for i in (x - reach, x - reach + back):
            b, a = min(max(j, 0), height - 1), min(max(i, 0), width - 1)
            least, most = min(least, low[level, b, a]), max(most, high[level, b, a])
    return least, most


@njit(cache=True)
def subsample_blur(light, radius, points, low, high):  # type: ignore[no-untyped-def]
    """Return the mean (H, W, 3) of a view and what rays through points around it see.

    Args:
        light: The view, (H, W, 3).
        radius: Signed blur radius of its pixels in pixels, + in front of focus, (H, W).
        points: Of the pupil, from the view's own one, in pupil radii, (S, 2).
        low: From :func:`n_buffers` of ``radius``.
        high: The same.
    """
    height, width = radius.shape
    result = np.empty((height, width, 3))
    for y in range(height):
        for x in range(width):
            least, most = low[-1, 0, 0], high[-1, 0, 0]
            for _ in range(_ROUNDS):
                away = 0.0
                for s in range(len(points)):
                    away = max(away, math.hypot(points[s, 0], points[s, 1]))
                reach = int(math.ceil(away * max(abs(least), abs(most)) + _NEAR_ENOUGH))
                least, most = radius_bounds(low, high, y, x, reach)
            for k in range(3):
                result[y, x, k] = light[y, x, k]
            for s in range(len(points)):
                u, v = points[s, 0], points[s, 1]
                length = math.hypot(u, v)
                found_y, found_x = y, x
                steps = int(math.ceil((most - least) * max(abs(u), abs(v)))) + 1
                for step in range(steps + 1):  # the nearest surface first
                    r = most - (most - least) * step / steps
                    j, i = y + int(round(r * v)), x + int(round(r * u))
                    if j < 0 or i < 0 or j >= height or i >= width:
                        continue
                    if abs(radius[j, i] - r) * length <= _NEAR_ENOUGH:
                        found_y, found_x = j, i
                        break
                for k in range(3):
                    result[y, x, k] += light[found_y, found_x, k]
    return result / (len(points) + 1)
