"""Blur between neighbouring views of an accumulation, by rays through one view: thesis 002, 3.4.

A view is a height field. Its pupil point is surrounded by additional points; a ray through one of them hits
the surface whose blur displaces it by the distance between ray and pixel. N-buffers bound the blur around
each pixel and thus the search range. Rays without a hit use the view's own colour, as a single layer has
nothing behind its surfaces.

Source: thesis 002, algorithms 3.2 and 3.3.
"""

import math

import numpy as np

from bokehnet.baselines.rays.n_buffers import radius_bounds
from bokehnet.kernels import njit

__all__ = ["subsample_blur"]

# Maximum distance between a ray and a surface that it hits, pixels.
_HIT_TOLERANCE_PX = 1.0

# Iterations of the bounds.
_BOUND_ITERATIONS = 3


@njit(cache=True)
def subsample_blur(light, radius, points, low, high):
    """Return the mean (H, W, 3) of a view and of rays through pupil points around it.

    Args:
        light: Picture of the view, (H, W, 3).
        radius: Signed blur radius of its pixels in pixels, + in front of focus, (H, W).
        points: Pupil points relative to that of the view, in pupil radii, (S, 2).
        low: Minima of ``radius`` from :func:`bokehnet.baselines.rays.n_buffers.n_buffers`.
        high: Maxima of ``radius``.
    """
    height, width = radius.shape
    result = np.empty((height, width, 3))
    for y in range(height):
        for x in range(width):
            min_radius, max_radius = low[-1, 0, 0], high[-1, 0, 0]
            for _ in range(_BOUND_ITERATIONS):
                pupil_distance = 0.0
                for s in range(len(points)):
                    pupil_distance = max(pupil_distance, math.hypot(points[s, 0], points[s, 1]))
                reach = int(
                    math.ceil(pupil_distance * max(abs(min_radius), abs(max_radius)) + _HIT_TOLERANCE_PX)
                )
                min_radius, max_radius = radius_bounds(low, high, y, x, reach)
            for k in range(3):
                result[y, x, k] = light[y, x, k]
            for s in range(len(points)):
                u, v = points[s, 0], points[s, 1]
                length = math.hypot(u, v)
                hit_y, hit_x = y, x
                steps = int(math.ceil((max_radius - min_radius) * max(abs(u), abs(v)))) + 1
                for step in range(steps + 1):  # the nearest surface first
                    r = max_radius - (max_radius - min_radius) * step / steps
                    j, i = y + int(round(r * v)), x + int(round(r * u))
                    if j < 0 or i < 0 or j >= height or i >= width:
                        continue
                    if abs(radius[j, i] - r) * length <= _HIT_TOLERANCE_PX:
                        hit_y, hit_x = j, i
                        break
                for k in range(3):
                    result[y, x, k] += light[hit_y, hit_x, k]
    return result / (len(points) + 1)
