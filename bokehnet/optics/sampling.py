"""Low-discrepancy points and their way onto the lens."""

import math

import numpy as np

from bokehnet.checks import Array, array_namespace

__all__ = ["disc_from_square", "halton", "rotate_points"]


def halton(count: int, base: int, start: int = 1) -> np.ndarray:
    """Return ``count`` elements of the radical-inverse sequence in ``base``, float64, in [0, 1).

    Source:
        Halton, "On the efficiency of certain quasi-random sequences of points in evaluating
        multi-dimensional integrals", 1960.
    """
    index = np.arange(start, start + count)
    result = np.zeros(count)
    fraction = 1.0
    while index.any():
        fraction /= base
        result += fraction * (index % base)
        index //= base
    return result


def rotate_points(points: Array, shift: Array) -> Array:
    """Shift points of the unit square by ``shift`` and wrap them round; keeps their discrepancy.

    Source:
        Cranley and Patterson, "Randomization of number theoretic methods for multiple integration", 1976.
    """
    moved = points + shift
    return moved - array_namespace(moved).floor(moved)


def disc_from_square(points: Array) -> Array:
    """Map the unit square (..., 2) onto the unit disc (..., 2), keeping areas and neighbours together.

    Source:
        Shirley and Chiu, "A low distortion map between disk and square", 1997.
    """
    xp = array_namespace(points)
    a, b = 2 * points[..., 0] - 1, 2 * points[..., 1] - 1
    wide = xp.abs(a) > xp.abs(b)
    radius = xp.where(wide, a, b)
    safe = xp.where(radius == 0, xp.ones_like(radius), radius)
    angle = xp.where(wide, math.pi / 4 * b / safe, math.pi / 2 - math.pi / 4 * a / safe)
    return xp.stack([radius * xp.cos(angle), radius * xp.sin(angle)], -1)
