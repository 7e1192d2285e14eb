"""Deblurring of soft maps: restore detail, such as wires, that blur has reduced to low ridges.

Many maps are accurate maps blurred by their network, by enlargement or by compression. A correct repaired
map, blurred in the same way, reproduces the input. The residual between the two shows what is missing.

Method: van Cittert iteration (van Cittert, "Zum Einfluß der Spaltbreite auf die Intensitätsverteilung in
Spektrallinien II", Zeitschrift für Physik 1931) with a guided filter (He, Sun and Tang, "Guided image
filtering", ECCV 2010). The blur is the Gaussian that fits best. In each window the residual is fitted by a
linear function of the colours of the equally blurred picture; the mean of the functions of all windows that
contain a pixel is applied to its sharp colours and added. Blurring the guide like the map, so that the filter
sharpens, is our addition.

In: the picture, scene-linear (H, W, 3), the input map and the repaired map, (H, W), in one unit. Out: the
repaired map with the missing detail, in that unit.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import prange

from bokehnet.classical.parallel import parallel_region
from bokehnet.depth_repair.config import (
    BLUR_RADIUS,
    BLUR_SIGMA_RATIO,
    BLUR_SIGMAS_PX,
    COLOR_VARIANCE,
    MAX_SAMPLES,
    MEDIAN_PASSES,
    MIN_EDGE_HEIGHT,
    VAN_CITTERT_ITERATIONS,
)
from bokehnet.depth_repair.filters import weighted_median
from bokehnet.kernels import njit
from bokehnet.optics.encoding import encode

__all__ = [
    "MEDIAN_HALO_PX",
    "BlurEstimate",
    "blur_map",
    "estimate_blur",
    "restore_blurred_detail",
    "snap_soft_edges",
]

# Distance up to which the weighted medians depend on a pixel, pixels.
MEDIAN_HALO_PX = sum(radius for radius, _ in MEDIAN_PASSES)


@njit(cache=True, parallel=True)
def _convolve(padded, weights, row_step, column_step, result):  # type: ignore[no-untyped-def]
    """Convolve along one axis into ``result`` (H, N); the steps give the distance of taps."""
    height, width = result.shape
    for y in prange(height):
        for x in range(width):
            result[y, x] = 0.0
        for i in range(len(weights)):
            weight, row, first = weights[i], y + i * row_step, i * column_step
            for x in range(width):
                result[y, x] += weight * padded[row, first + x]


def _gaussian(sigma: float) -> np.ndarray:
    """Return the weights of a one-dimensional Gaussian, float32, with sum 1."""
    radius = math.ceil(BLUR_RADIUS * sigma)
    weights = np.exp(-0.5 * (np.arange(-radius, radius + 1) / sigma) ** 2)
    return np.asarray(weights / weights.sum(), np.float32)


def blur_map(values: np.ndarray, sigma: float) -> np.ndarray:
    """Return an array blurred by a Gaussian, with its border repeated.

    Args:
        values: Array, (H, W) or (H, W, C), float32.
        sigma: Standard deviation of the Gaussian, pixels.
    """
    weights = _gaussian(sigma)
    radius = len(weights) // 2
    height, channels = len(values), 1 if values.ndim == 2 else values.shape[2]
    residual = [(0, 0)] * (values.ndim - 1)
    result = np.empty((height, values.size // height), np.float32)
    with parallel_region:
        padded = np.pad(values, [(radius, radius), *residual], "edge").reshape(height + 2 * radius, -1)
        _convolve(padded, weights, 1, 0, result)
        padded = np.pad(result.reshape(values.shape), [(0, 0), (radius, radius), *residual[1:]], "edge")
        _convolve(padded.reshape(height, -1), weights, 0, channels, result)
    return result.reshape(values.shape)


@njit(cache=True, parallel=True)
def _residuals_at(original, repaired, ys, xs, weights, residuals):  # type: ignore[no-untyped-def]
    """Fill ``residuals`` with absolute residuals of a map and the other one blurred, at some pixels."""
    height, width = original.shape
    radius = len(weights) // 2
    for i in prange(len(ys)):
        blurred = 0.0
        for v in range(-radius, radius + 1):
            y, row = min(max(ys[i] + v, 0), height - 1), 0.0
            for u in range(-radius, radius + 1):
                row += weights[u + radius] * repaired[y, min(max(xs[i] + u, 0), width - 1)]
            blurred += weights[v + radius] * row
        residuals[i] = abs(original[ys[i], xs[i]] - blurred)


class BlurEstimate(NamedTuple):
    """Estimate of the blur of a map.

    Attributes:
        sigma: Standard deviation of the Gaussian that best maps the repaired map to the input, pixels; 0
            if the input is hardly soft.
        residual: Mean square root of the absolute residuals that remain, in square roots of the map's unit.
    """

    sigma: float
    residual: float


def estimate_blur(original: np.ndarray, repaired: np.ndarray, soft: np.ndarray) -> BlurEstimate:
    """Return the Gaussian blur that best maps a repaired map to the input.

    The mean square root of the residuals is robust: a few wrong pixels have little weight. It is computed at
    about 2000 evenly spaced pixels and minimised over fixed candidates with a parabola through the best
    three.

    Args:
        original: Input map, (H, W), float32.
        repaired: Map with sharp edges, (H, W), float32.
        soft: Pixels at soft edges of the input, (H, W), bool.
    """
    ys, xs = np.nonzero(soft)
    if len(ys) == 0:
        return BlurEstimate(0.0, 0.0)
    stride = -(-len(ys) // MAX_SAMPLES)
    ys, xs = ys[::stride], xs[::stride]
    mean_roots, residuals = [], np.empty(len(ys), np.float32)
    for sigma in BLUR_SIGMAS_PX:
        with parallel_region:
            _residuals_at(original, repaired, ys, xs, _gaussian(sigma), residuals)
        mean_roots.append(float(np.sqrt(residuals).mean()))
    best = int(np.argmin(mean_roots))
    if best in (0, len(mean_roots) - 1):
        return BlurEstimate(BLUR_SIGMAS_PX[best] if best else 0.0, mean_roots[best])
    before, minimum, after = mean_roots[best - 1 : best + 2]
    vertex = 0.5 * (before - after) / max(before - 2 * minimum + after, 1e-12)  # of the parabola
    return BlurEstimate(BLUR_SIGMAS_PX[best] * BLUR_SIGMA_RATIO**vertex, minimum)


@njit(cache=True)
def _solve(xx, xy, xz, yy, yz, zz, x, y, z):  # type: ignore[no-untyped-def]
    """Solve a symmetric 3x3 system of linear equations by Cramer's rule."""
    a, b, c = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    determinant = xx * a + xy * b + xz * c
    d, e, f = xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy
    return (
        (a * x + b * y + c * z) / determinant,
        (b * x + d * y + e * z) / determinant,
        (c * x + e * y + f * z) / determinant,
    )


@njit(cache=True, parallel=True)
def _fit(residual, guide, mask, radius, noise, fitted):  # type: ignore[no-untyped-def]
    """Fit linear functions of the guide, (H, W, 4), to the residual in the window of each masked pixel.

    Each function is scaled by the fraction of the residual's variance that it explains.
    """
    height, width = residual.shape
    for row in prange(height):
        for column in range(width):
            if not mask[row, column]:
                continue
            n = r = g = b = e = rr = rg = rb = gg = gb = bb = re = ge = be = ee = 0.0
            for v in range(max(0, row - radius), min(height, row + radius + 1)):
                for u in range(max(0, column - radius), min(width, column + radius + 1)):
                    i, j, k, t = guide[v, u, 0], guide[v, u, 1], guide[v, u, 2], residual[v, u]
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
            explained = min(max((x * re + y * ge + z * be) / max(ee / n - e * e, 1e-12), 0.0), 1.0)
            fitted[row, column, 0], fitted[row, column, 1] = explained * x, explained * y
            fitted[row, column, 2] = explained * z
            fitted[row, column, 3] = explained * (e - x * r - y * g - z * b)


@njit(cache=True, parallel=True)
def _add_detail(fitted, guide, mask, radius, result):  # type: ignore[no-untyped-def]
    """Apply the mean of the functions around each masked pixel to its sharp colours and add the result."""
    height, width = result.shape
    for row in prange(height):
        for column in range(width):
            if not mask[row, column]:
                continue
            n = x = y = z = w = 0.0
            for v in range(max(0, row - radius), min(height, row + radius + 1)):
                for u in range(max(0, column - radius), min(width, column + radius + 1)):
                    n += 1.0
                    x, y = x + fitted[v, u, 0], y + fitted[v, u, 1]
                    z, w = z + fitted[v, u, 2], w + fitted[v, u, 3]
            red, green, blue = guide[row, column, 0], guide[row, column, 1], guide[row, column, 2]
            result[row, column] += (x * red + y * green + z * blue + w) / n


@njit(cache=True, parallel=True)
def _mark_residuals(residual, threshold, radius, mask):  # type: ignore[no-untyped-def]
    """Mark pixels with a residual above ``threshold`` anywhere in their window."""
    height, width = residual.shape
    in_row_window = np.zeros((height, width), np.bool_)
    for y in prange(height):
        last = -radius - 1
        for x in range(width + radius):
            if x < width and abs(residual[y, x]) > threshold:
                last = x
            if x >= radius:
                in_row_window[y, x - radius] = last >= x - 2 * radius
    for y in prange(height):
        for x in range(width):
            mask[y, x] = False
            for v in range(max(0, y - radius), min(height, y + radius + 1)):
                if in_row_window[v, x]:
                    mask[y, x] = True
                    break


def restore_blurred_detail(
    image: np.ndarray, original: np.ndarray, repaired: np.ndarray, sigma: float
) -> np.ndarray:
    """Return a repaired map with the detail that it needs to reproduce the input when blurred.

    Args:
        image: All-in-focus picture, scene-linear, not negative, (H, W, 3), float32.
        original: Input map, (H, W), float32.
        repaired: Map with sharp edges, (H, W), float32.
        sigma: Standard deviation of the blur from :func:`estimate_blur`, pixels.

    Returns:
        Map, (H, W), float32, within the range of both maps; equal to ``repaired`` where no detail is missing.
    """
    sharp = np.sqrt(np.clip(image, 0, 1))
    soft = blur_map(sharp, sigma)
    low = min(float(original.min()), float(repaired.min()))
    high = max(float(original.max()), float(repaired.max()))
    radius = round(BLUR_RADIUS * sigma)
    result, mask = repaired.copy(), np.empty(original.shape, bool)
    for _ in range(VAN_CITTERT_ITERATIONS):
        residual = original - blur_map(result, sigma)
        fitted = np.zeros((*original.shape, 4), np.float32)
        with parallel_region:
            _mark_residuals(residual, MIN_EDGE_HEIGHT * (high - low), radius, mask)
            _fit(residual, soft, mask, radius, COLOR_VARIANCE, fitted)
            _add_detail(fitted, sharp, mask, radius, result)
        np.clip(result, low, high, out=result)
    return result


def snap_soft_edges(image: np.ndarray, disparity: np.ndarray, soft: np.ndarray, span: float) -> np.ndarray:
    """Return the map with weighted medians at soft edges, which moves them to colour edges.

    The position of an edge inside a ramp is unknown, and the middle is only a guess. A second pass in a
    smaller window smooths the edges; a third pass, with a larger colour tolerance, removes isolated pixels.

    Args:
        image: All-in-focus picture, scene-linear, (H, W, 3).
        disparity: Map with sharpened edges, (H, W), float32, any unit.
        soft: Pixels on ramps of the input, (H, W), bool.
        span: Range of the whole map, in its unit.

    Returns:
        Map, (H, W), float32; each value lies within the range of its window.
    """
    colors = np.asarray(encode(image), np.float32)
    for radius, color_sigma in MEDIAN_PASSES:
        disparity = weighted_median(colors, disparity, soft, radius, color_sigma, MIN_EDGE_HEIGHT * span)
    return disparity
