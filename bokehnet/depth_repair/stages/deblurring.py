"""Soft maps told by what they must have been: a repaired map, blurred as the given one is, is the given one.

Many maps are true ones blurred: by the network that made them, by enlargement, by compression. Where a
repaired map does not give the given one again when it is blurred, it is wrong: a wire that the blur has
left as a low ridge is missing. What is missing is sought as a linear function of the picture's colours in
each window, so fitted that it explains the rest after both are blurred, and added with the sharp colours.

Source: He, Sun and Tang, "Guided image filtering", ECCV 2010, for local linear functions of colours and the
mean over all windows that hold a pixel; van Cittert, "Zum Einfluß der Spaltbreite auf die
Intensitätsverteilung in Spektrallinien II", Zeitschrift für Physik 1931, for adding what does not come out
yet. That the guide is blurred as the map is, so that the filter sharpens, is ours.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import prange

from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit

__all__ = ["Softness", "blur_map", "explain_soft_map", "find_softness"]

# Standard deviations of the blur between which the map's is sought, pixels; the least is that of no soft map.
_DEVIATIONS = tuple(1.25**i for i in range(1, 9))

# Pixels at which that is sought.
_SAMPLES = 4096

# Reach of the Gaussian, in deviations.
_REACH = 3.5

# Half the width of a window, in deviations, and at least, pixels.
_WINDOW, _LEAST_WINDOW = 1.7, 3

# Variance of encoded colours below which they explain nothing.
_NOISE = 1e-4

# Rest, as a share of the map's span, below which nothing is missing.
_LEAST_REST = 0.05

# Times that what does not come out yet is added.
_ROUNDS = 2


@njit(cache=True, parallel=True)
def _weigh(padded, weights, down, along, result):  # type: ignore[no-untyped-def]
    """Weighted sums of numbers that lie ``down`` rows and ``along`` columns apart, from each on, (H, N)."""
    height, width = result.shape
    for y in prange(height):
        for x in range(width):
            result[y, x] = 0.0
        for i in range(len(weights)):
            weight, row, first = weights[i], y + i * down, i * along
            for x in range(width):
                result[y, x] += weight * padded[row, first + x]


def _gaussian(deviation: float) -> np.ndarray:
    """Weights of the pixels along an axis, float32; their sum is 1."""
    reach = math.ceil(_REACH * deviation)
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / deviation) ** 2)
    return np.asarray(weights / weights.sum(), np.float32)


def blur_map(values: np.ndarray, deviation: float) -> np.ndarray:
    """Blur (H, W) or (H, W, C), float32, by a Gaussian of that standard deviation in pixels."""
    weights = _gaussian(deviation)
    reach = len(weights) // 2
    height, channels = len(values), 1 if values.ndim == 2 else values.shape[2]
    rest = [(0, 0)] * (values.ndim - 1)
    result = np.empty((height, values.size // height), np.float32)
    with parallel_region:
        padded = np.pad(values, [(reach, reach), *rest], "edge").reshape(height + 2 * reach, -1)
        _weigh(padded, weights, 1, 0, result)
        padded = np.pad(result.reshape(values.shape), [(0, 0), (reach, reach), *rest[1:]], "edge")
        _weigh(padded.reshape(height, -1), weights, 0, channels, result)
    return result.reshape(values.shape)


@njit(cache=True, parallel=True)
def _find_rests(given, repaired, ys, xs, weights, rests):  # type: ignore[no-untyped-def]
    """Fill ``rests`` with what a map is away from the other one blurred, at some pixels."""
    height, width = given.shape
    reach = len(weights) // 2
    for i in prange(len(ys)):
        blurred = 0.0
        for v in range(-reach, reach + 1):
            y, row = min(max(ys[i] + v, 0), height - 1), 0.0
            for u in range(-reach, reach + 1):
                row += weights[u + reach] * repaired[y, min(max(xs[i] + u, 0), width - 1)]
            blurred += weights[v + reach] * row
        rests[i] = abs(given[ys[i], xs[i]] - blurred)


class Softness(NamedTuple):
    """How soft a map is.

    Attributes:
        deviation: Standard deviation in pixels of the Gaussian that best brings a repaired map back to the
            given one; 0 where that is hardly soft.
        rest: By how much it stays away from it then: the mean of square roots.
    """

    deviation: float
    rest: float


def find_softness(given: np.ndarray, repaired: np.ndarray, soft: np.ndarray) -> Softness:
    """Find the blur that lies between a repaired map and the given one.

    Most pixels are to come out right: the square root counts the others little. Some thousands, evenly
    spread, stand for all.

    Args:
        given: (H, W) float32.
        repaired: The same with sharp steps, (H, W) float32.
        soft: Where steps were soft, (H, W) bool.
    """
    ys, xs = np.nonzero(soft)
    if len(ys) == 0:
        return Softness(0.0, 0.0)
    every = -(-len(ys) // _SAMPLES)
    ys, xs = ys[::every], xs[::every]
    means, rests = [], np.empty(len(ys), np.float32)
    for deviation in _DEVIATIONS:
        with parallel_region:
            _find_rests(given, repaired, ys, xs, _gaussian(deviation), rests)
        means.append(float(np.sqrt(rests).mean()))
    best = int(np.argmin(means))
    if best in (0, len(means) - 1):
        return Softness(_DEVIATIONS[best] if best else 0.0, means[best])
    before, least, after = means[best - 1 : best + 2]
    peak = 0.5 * (before - after) / max(before - 2 * least + after, 1e-12)  # of a parabola through three
    return Softness(_DEVIATIONS[best] * 1.25**peak, least)


@njit(cache=True)
def _solve(xx, xy, xz, yy, yz, zz, x, y, z):  # type: ignore[no-untyped-def]
    """Solution of a symmetric system of three equations, by Cramer's rule."""
    a, b, c = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    determinant = xx * a + xy * b + xz * c
    d, e, f = xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy
    return (
        (a * x + b * y + c * z) / determinant,
        (b * x + d * y + e * z) / determinant,
        (c * x + e * y + f * z) / determinant,
    )


@njit(cache=True, parallel=True)
def _fit(rest, guide, wanted, reach, noise, fitted):  # type: ignore[no-untyped-def]
    """Linear functions of the guide, (H, W, 4), that explain the rest around each wanted pixel.

    They are weighted by the share of the rest's variance that they explain.
    """
    height, width = rest.shape
    for row in prange(height):
        for column in range(width):
            if not wanted[row, column]:
                continue
            n = r = g = b = e = rr = rg = rb = gg = gb = bb = re = ge = be = ee = 0.0
            for v in range(max(0, row - reach), min(height, row + reach + 1)):
                for u in range(max(0, column - reach), min(width, column + reach + 1)):
                    i, j, k, t = guide[v, u, 0], guide[v, u, 1], guide[v, u, 2], rest[v, u]
                    n += 1.0
                    r, g, b, e = r + i, g + j, b + k, e + t
                    rr, rg, rb = rr + i * i, rg + i * j, rb + i * k
                    gg, gb, bb = gg + j * j, gb + j * k, bb + k * k
                    re, ge, be, ee = re + i * t, ge + j * t, be + k * t, ee + t * t
            r, g, b, e = r / n, g / n, b / n, e / n
            re, ge, be = re / n - r * e, ge / n - g * e, be / n - b * e
            x, y, z = _solve(
                rr / n - r * r + noise,
                rg / n - r * g,
                rb / n - r * b,
                gg / n - g * g + noise,
                gb / n - g * b,
                bb / n - b * b + noise,
                re,
                ge,
                be,
            )
            share = min(max((x * re + y * ge + z * be) / max(ee / n - e * e, 1e-12), 0.0), 1.0)
            fitted[row, column, 0], fitted[row, column, 1] = share * x, share * y
            fitted[row, column, 2] = share * z
            fitted[row, column, 3] = share * (e - x * r - y * g - z * b)


@njit(cache=True, parallel=True)
def _add(fitted, guide, wanted, reach, result):  # type: ignore[no-untyped-def]
    """Add what the mean of the functions around each wanted pixel makes of its sharp colours."""
    height, width = result.shape
    for row in prange(height):
        for column in range(width):
            if not wanted[row, column]:
                continue
            n = x = y = z = w = 0.0
            for v in range(max(0, row - reach), min(height, row + reach + 1)):
                for u in range(max(0, column - reach), min(width, column + reach + 1)):
                    n += 1.0
                    x, y = x + fitted[v, u, 0], y + fitted[v, u, 1]
                    z, w = z + fitted[v, u, 2], w + fitted[v, u, 3]
            red, green, blue = guide[row, column, 0], guide[row, column, 1], guide[row, column, 2]
            result[row, column] += (x * red + y * green + z * blue + w) / n


@njit(cache=True, parallel=True)
def _near(rest, least, reach, wanted):  # type: ignore[no-untyped-def]
    """Whether the rest exceeds ``least`` somewhere in the window around each pixel."""
    height, width = rest.shape
    across = np.zeros((height, width), np.bool_)
    for y in prange(height):
        last = -reach - 1
        for x in range(width + reach):
            if x < width and abs(rest[y, x]) > least:
                last = x
            if x >= reach:
                across[y, x - reach] = last >= x - 2 * reach
    for y in prange(height):
        for x in range(width):
            wanted[y, x] = False
            for v in range(max(0, y - reach), min(height, y + reach + 1)):
                if across[v, x]:
                    wanted[y, x] = True
                    break


def explain_soft_map(
    image: np.ndarray, given: np.ndarray, repaired: np.ndarray, deviation: float
) -> np.ndarray:
    """Add to a repaired map what it lacks to be the given one when it is blurred.

    Args:
        image: Scene-linear, (H, W, 3) float32, 0 or more.
        given: The map as it was, (H, W) float32.
        repaired: With sharp steps, (H, W) float32.
        deviation: Of the blur that lies between both, from :func:`find_softness`, pixels.

    Returns:
        (H, W) float32, within the range of both; the same where nothing is missing.
    """
    sharp = np.sqrt(np.clip(image, 0, 1))
    soft = blur_map(sharp, deviation)
    low = min(float(given.min()), float(repaired.min()))
    high = max(float(given.max()), float(repaired.max()))
    reach = max(_LEAST_WINDOW, round(_WINDOW * deviation))
    result, wanted = repaired.copy(), np.empty(given.shape, bool)
    for _ in range(_ROUNDS):
        rest = given - blur_map(result, deviation)
        fitted = np.zeros((*given.shape, 4), np.float32)
        with parallel_region:
            _near(rest, _LEAST_REST * (high - low), reach, wanted)
            _fit(rest, soft, wanted, reach, _NOISE, fitted)
            _add(fitted, sharp, wanted, reach, result)
        np.clip(result, low, high, out=result)
    return result
