"""Low-discrepancy points and their mapping to the pupil."""

import math

import numpy as np

from bokehnet.checks import Array, array_namespace

__all__ = ["disc_from_square", "halton", "ring_points", "rotate_points", "sobol"]

# Binary digits of a point that follow the sequence; the digits after them are random.
_DIGITS = 16

# For each dimension after the first: inner coefficients of its primitive polynomial, and its initial numbers.
_POLYNOMIALS = ((0, (1,)), (1, (1, 3)), (1, (1, 3, 1)), (2, (1, 1, 1)))


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


def _directions(dimension: int) -> list[int]:
    """Return the direction numbers of a dimension of the Sobol' sequence, most significant digit first."""
    if dimension == 0:
        return [1 << (_DIGITS - 1 - k) for k in range(_DIGITS)]
    inner, first = _POLYNOMIALS[dimension - 1]
    degree, numbers = len(first), list(first)
    for k in range(degree, _DIGITS):
        number = numbers[k - degree] ^ numbers[k - degree] << degree
        for j in range(1, degree):
            if inner >> (degree - 1 - j) & 1:
                number ^= numbers[k - j] << j
        numbers.append(number)
    return [number << (_DIGITS - 1 - k) for k, number in enumerate(numbers)]


def sobol(count: int, rng: np.random.Generator, dimensions: int = 2) -> np.ndarray:
    """Return the first points of the scrambled Sobol' sequence in the unit cube, (count, dimensions) float64.

    Of every 2^m consecutive points that begin at a multiple of 2^m, m up to 16, each of 2^m equal intervals
    of any axis contains one, and so does each box of the first two axes with area 2^-m whose sides are powers
    of two. Scrambling preserves this and makes each point uniform.

    Args:
        count: Number of points, up to 65536.
        rng: Generator of the scrambling.
        dimensions: Number of dimensions, 1 to 5.

    Source:
        Sobol', "On the distribution of points in a cube and the approximate evaluation of integrals", 1967;
        Joe and Kuo, "Constructing Sobol sequences with better two-dimensional projections", 2008, for
        the polynomials and first numbers; Owen, "Randomly permuted (t, m, s)-nets and (t, s)-sequences",
        1995, for the scrambling.
    """
    index = np.arange(count)
    points = []
    for dimension in range(dimensions):
        value = np.zeros(count, np.int64)
        for k, number in enumerate(_directions(dimension)):
            value ^= np.where(index >> k & 1, number, 0)
        scrambled = np.zeros(count, np.int64)
        for k in range(_DIGITS):  # points with the same leading digits share the flip of the next digit
            digit = value >> (_DIGITS - 1 - k) & 1
            flips = rng.integers(0, 2, 1 << k)
            scrambled = scrambled << 1 | digit ^ flips[value >> (_DIGITS - k)]
        points.append((scrambled + rng.random(count)) / (1 << _DIGITS))
    return np.stack(points, -1)


def rotate_points(points: Array, shift: Array) -> Array:
    """Shift points of the unit square by ``shift`` modulo 1, preserving their discrepancy.

    Source:
        Cranley and Patterson, "Randomization of number theoretic methods for multiple integration", 1976.
    """
    shifted = points + shift
    return shifted - array_namespace(shifted).floor(shifted)


def ring_points(rings: int) -> np.ndarray:
    """Return points of the unit disc, (3 rings (rings + 1), 2), symmetric about its centre.

    Ring k has 6 k points, each at the centre of area of its cell, so that means over the points are means
    over the area.
    """
    number = np.arange(rings) + 1
    radii = np.repeat(number / math.sqrt(rings * (rings + 1)), 6 * number)
    angles = np.concatenate([np.arange(6 * k) / (6 * k) for k in number]) * 2 * np.pi
    return np.stack([radii * np.cos(angles), radii * np.sin(angles)], -1)


def disc_from_square(points: Array) -> Array:
    """Map the unit square (..., 2) to the unit disc (..., 2), preserving area and neighbourhood.

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
