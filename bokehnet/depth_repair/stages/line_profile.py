"""Lines of a picture, told by their profile across: the colours on them and to either side.

All pictures are (H, W, 3), encoded; places are rows and columns between pixels, directions down and right.
"""

import math

import numpy as np

from bokehnet.kernels import njit

__all__ = [
    "SIDE",
    "STRIDE",
    "contrast_across",
    "difference",
    "half_width",
    "heading",
    "look_across",
    "ranked",
    "sample",
    "turned",
    "unlike",
]

# Pixels of a step along a line.
STRIDE = 1.5

# Pixels across the line within which it stands out from both sides, and within which it ends.
SIDE, HALF_WIDTH = 6, 4


@njit(cache=True)
def sample(picture, y, x, c):  # type: ignore[no-untyped-def]
    """Channel of the picture (H, W, 3) between its pixels."""
    y = min(max(y, 0.0), picture.shape[0] - 1.001)
    x = min(max(x, 0.0), picture.shape[1] - 1.001)
    i, j = int(y), int(x)
    b, a = y - i, x - j
    upper = picture[i, j, c] * (1.0 - a) + picture[i, j + 1, c] * a
    lower = picture[i + 1, j, c] * (1.0 - a) + picture[i + 1, j + 1, c] * a
    return upper * (1.0 - b) + lower * b


@njit(cache=True)
def look_across(picture, y, x, down, right, profile):  # type: ignore[no-untyped-def]
    """Set the profile, (3, 3), of a line that runs down and right: the pixel on it and one to either side."""
    for k in range(3):
        for c in range(3):
            profile[k, c] = sample(picture, y + (k - 1) * right, x - (k - 1) * down, c)


@njit(cache=True)
def unlike(a, b):  # type: ignore[no-untyped-def]
    """Squared difference of two profiles, the middle counting twice."""
    total = 0.0
    for k in range(3):
        for c in range(3):
            total += (0.5 if k == 1 else 0.25) * (a[k, c] - b[k, c]) ** 2
    return total


@njit(cache=True)
def difference(picture, y, x, v, u):  # type: ignore[no-untyped-def]
    """Squared difference of the colours at two places."""
    total = 0.0
    for c in range(3):
        total += (sample(picture, y, x, c) - sample(picture, v, u, c)) ** 2
    return total


@njit(cache=True)
def contrast_across(picture, y, x, down, right):  # type: ignore[no-untyped-def]
    """Largest squared difference within reach on one side, of the side where it is less."""
    least = np.inf
    for side in range(-1, 2, 2):
        largest = 0.0
        for apart in range(2, SIDE + 1):
            v, u = y + side * apart * right, x - side * apart * down
            largest = max(largest, difference(picture, y, x, v, u))
        least = min(least, largest)
    return least


@njit(cache=True)
def turned(picture, y, x, angle, turns, turn, ahead, kept, profile):  # type: ignore[no-untyped-def]
    """Angle near the given one along which the picture changes least from ``kept``, and by how much.

    ``kept`` is the profile where the line begins if its first row is NaN.
    """
    own = math.isnan(kept[0, 0])
    start = np.empty((3, 3))
    best, chosen = np.inf, angle
    for way in range(-turns, turns + 1):
        tried = angle + way * turn
        down, right = math.sin(tried), math.cos(tried)
        if own:
            look_across(picture, y, x, down, right, start)
        change = 0.0
        for step in range(1, ahead + 1):
            reach = step * STRIDE
            look_across(picture, y + reach * down, x + reach * right, down, right, profile)
            change += unlike(profile, start if own else kept) / ahead
        change += 1e-4 * way * way
        if change < best:
            best, chosen = change, tried
    return chosen, best


@njit(cache=True)
def heading(points, count, i):  # type: ignore[no-untyped-def]
    """Unit vector along a line at one of its points."""
    first, last = max(0, i - 3), min(count - 1, i + 3)
    down, right = points[last, 0] - points[first, 0], points[last, 1] - points[first, 1]
    length = math.sqrt(down * down + right * right)
    if length == 0.0:
        return 1.0, 0.0
    return down / length, right / length


@njit(cache=True)
def half_width(picture, y, x, down, right, side):  # type: ignore[no-untyped-def]
    """Pixels across the line at which its colours change most, on one side; near changes count more."""
    best, chosen = 0.0, 1.0
    for k in range(1, 2 * HALF_WIDTH):
        apart = 0.5 * k
        inner, outer = side * (apart - 0.75), side * (apart + 0.75)
        change = difference(picture, y + inner * right, x - inner * down, y + outer * right, x - outer * down)
        change *= 1.0 - 0.08 * apart
        if change > best:
            best, chosen = change, apart
    return chosen


@njit(cache=True)
def ranked(values, rank):  # type: ignore[no-untyped-def]
    """The value that is larger than ``rank`` others, of a few."""
    for value in values:
        below = among = 0
        for other in values:
            below += other < value
            among += other <= value
        if below <= rank < among:
            return value
    return values[0]
