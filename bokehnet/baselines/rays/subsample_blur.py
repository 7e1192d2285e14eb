"""What lies between two views of an accumulation, seen by rays through one of them: thesis 002, 3.4.

A view is a height field. Around its point of the pupil lie points of its own, and a ray through one of them
meets the surface whose blur moves it by just what the ray is away from the pixel. Bounds of the blur around
each pixel, by N-buffers, say how far to look. Rays that meet nothing take the view's own colour: a single
layer has nothing behind its surfaces.

Source: thesis 002, algorithms 3.2 and 3.3.
"""

import math

import numpy as np

from bokehnet.baselines.rays.n_buffers import radius_bounds
from bokehnet.kernels import njit

__all__ = ["subsample_blur"]

# A ray meets a surface that it passes by no more than this, pixels.
_NEAR_ENOUGH = 1.0

# How often bounds are looked for inside the last ones.
_ROUNDS = 3


@njit(cache=True)
def subsample_blur(light, radius, points, low, high):  # type: ignore[no-untyped-def]
    """Return the mean (H, W, 3) of a view and what rays through points around it see.

    Args:
        light: The view, (H, W, 3).
        radius: Signed blur radius of its pixels in pixels, + in front of focus, (H, W).
        points: Of the pupil, from the view's own one, in pupil radii, (S, 2).
        low: From :func:`bokehnet.baselines.rays.n_buffers.n_buffers` of ``radius``.
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
