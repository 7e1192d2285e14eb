"""Cross-sections of lines in a picture: colours on the centre line and on both sides.

Kernels for :mod:`bokehnet.depth_repair.stages.thin_structures`. In: pictures with encoded colours,
(H, W, 3); positions as fractional rows and columns, pixels; directions as unit vectors (down, right); angles
in radians from right to down. Out: colour differences (squared, summed over channels), widths in pixels.
"""

import math

import numpy as np

from bokehnet.depth_repair.config import BLOCK_PX, LINE_STEP_PX, TURN_RAD, WEIGHT_DECREASE
from bokehnet.kernels import njit

__all__ = [
    "color_difference_at",
    "half_width",
    "interpolate",
    "line_contrast",
    "order_statistic",
    "profile_difference",
    "sample_profile",
    "steer",
    "tangent",
]


@njit(cache=True)
def interpolate(picture, y, x, c):  # type: ignore[no-untyped-def]
    """Return a channel of the picture (H, W, 3) at a fractional position, by bilinear interpolation."""
    y = min(max(y, 0.0), picture.shape[0] - 1.001)
    x = min(max(x, 0.0), picture.shape[1] - 1.001)
    i, j = int(y), int(x)
    b, a = y - i, x - j
    upper = picture[i, j, c] * (1.0 - a) + picture[i, j + 1, c] * a
    lower = picture[i + 1, j, c] * (1.0 - a) + picture[i + 1, j + 1, c] * a
    return upper * (1.0 - b) + lower * b


@njit(cache=True)
def sample_profile(picture, y, x, down, right, profile):  # type: ignore[no-untyped-def]
    """Fill ``profile`` (3, 3) with the colours on a line with direction (down, right) and one pixel aside."""
    for k in range(3):
        for c in range(3):
            profile[k, c] = interpolate(picture, y + (k - 1) * right, x - (k - 1) * down, c)


@njit(cache=True)
def profile_difference(a, b):  # type: ignore[no-untyped-def]
    """Return the weighted squared difference of two profiles; the centre has twice the weight of a side."""
    total = 0.0
    for k in range(3):
        for c in range(3):
            total += (0.5 if k == 1 else 0.25) * (a[k, c] - b[k, c]) ** 2
    return total


@njit(cache=True)
def color_difference_at(picture, y, x, v, u):  # type: ignore[no-untyped-def]
    """Return the squared difference of the colours at two positions."""
    total = 0.0
    for c in range(3):
        total += (interpolate(picture, y, x, c) - interpolate(picture, v, u, c)) ** 2
    return total


@njit(cache=True)
def line_contrast(picture, y, x, down, right):  # type: ignore[no-untyped-def]
    """Return the largest squared difference within 8 pixels, on the side with less contrast."""
    contrast = np.inf
    for side in range(-1, 2, 2):
        largest = 0.0
        for distance in range(2, BLOCK_PX + 1):
            v, u = y + side * distance * right, x - side * distance * down
            largest = max(largest, color_difference_at(picture, y, x, v, u))
        contrast = min(contrast, largest)
    return contrast


@njit(cache=True)
def steer(picture, y, x, angle, max_turns, ahead, reference, profile):  # type: ignore[no-untyped-def]
    """Return the angle near ``angle`` with the least change of the profile, and this change.

    The change is measured from ``reference``, or, if its first row is NaN, from the profile at the start of
    each candidate.
    """
    uses_start = math.isnan(reference[0, 0])
    start = np.empty((3, 3))
    least_change, best_angle = np.inf, angle
    for number in range(2 * max_turns + 1):  # straight on first, then by size
        candidate = angle + TURN_RAD * ((number + 1) // 2) * (1 if number % 2 else -1)
        down, right = math.sin(candidate), math.cos(candidate)
        if uses_start:
            sample_profile(picture, y, x, down, right, start)
        change = 0.0
        for step in range(1, ahead + 1):
            distance = step * LINE_STEP_PX
            sample_profile(picture, y + distance * down, x + distance * right, down, right, profile)
            change += profile_difference(profile, start if uses_start else reference) / ahead
        if change < least_change:
            least_change, best_angle = change, candidate
    return best_angle, least_change


@njit(cache=True)
def tangent(points, count, i):  # type: ignore[no-untyped-def]
    """Return the unit tangent (down, right) of a line at one of its points."""
    first, last = max(0, i - BLOCK_PX // 2), min(count - 1, i + BLOCK_PX // 2)
    down, right = points[last, 0] - points[first, 0], points[last, 1] - points[first, 1]
    length = math.sqrt(down * down + right * right)
    if length == 0.0:
        return 1.0, 0.0
    return down / length, right / length


@njit(cache=True)
def half_width(picture, y, x, down, right, side):  # type: ignore[no-untyped-def]
    """Return the half width of a line on one side: distance of the largest colour change, pixels.

    It is less than 4 pixels. The weight of a change decreases with its distance from the centre line.
    """
    largest_change, best_distance = 0.0, 1.0
    for k in range(1, BLOCK_PX):
        distance = 0.5 * k
        inner, outer = side * (distance - LINE_STEP_PX / 2), side * (distance + LINE_STEP_PX / 2)
        change = color_difference_at(
            picture, y + inner * right, x - inner * down, y + outer * right, x - outer * down
        )
        change *= 1.0 - WEIGHT_DECREASE * distance
        if change > largest_change:
            largest_change, best_distance = change, distance
    return best_distance


@njit(cache=True)
def order_statistic(values, rank):  # type: ignore[no-untyped-def]
    """Return the value with a given rank (order statistic) in a short array."""
    for value in values:
        below = at_most = 0
        for other in values:
            below += other < value
            at_most += other <= value
        if below <= rank < at_most:
            return value
    return values[0]
