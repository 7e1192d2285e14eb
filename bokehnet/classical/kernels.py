"""Numba kernels that scatter every pixel over a disc, and their adjoint.

A pixel with blur radius r lights the disc of that radius around its centre. The disc is cut into rows
one pixel high; row k gets the exact area of the disc between k - 1/2 and k + 1/2, laid out as one
interval centred on the pixel, whose two ends cover their pixels in part. Divided by the disc's area the
weights sum to one for every radius, and they change smoothly with it. Only the two ends of an interval
are written, as differences along the row; one running sum per row then fills the insides, so that a
pixel costs O(r), not O(r^2).

Destination rows are worked in bands of a fixed height. One thread owns a band and visits all sources
that reach it in a fixed order: the result has the same bits for any number of threads.

Source: Kosloff, Tao and Barsky, "Depth of field postprocessing for layered scenes using constant-time
rectangle spreading", Graphics Interface 2009, for spreading by differences; the rows are ours.
"""

import math
import threading
from typing import Any

import numpy as np
from numba import njit, prange

__all__ = ["LARGEST_RADIUS", "SMALLEST_RADIUS", "scatter_backward", "scatter_forward"]

# A disc of half a pixel or less lies inside its own pixel: the scatter is the identity there.
SMALLEST_RADIUS = 0.5

# Far beyond any picture, and small enough that the weight 1 / (pi r^2) is a normal float32.
LARGEST_RADIUS = 1e9

BAND_ROWS = 32

# Two Python threads inside one parallel region would abort the process on numba's workqueue layer.
_parallel_region = threading.Lock()


@njit(cache=True)
def half_area(t):  # type: ignore[no-untyped-def]
    """Area under the unit circle's upper half from 0 to t, t clamped to [-1, 1]."""
    if t >= 1.0:
        return math.pi / 4
    if t <= -1.0:
        return -math.pi / 4
    return 0.5 * (t * math.sqrt(1.0 - t * t) + math.asin(t))


@njit(cache=True)
def clamped_asin(t):  # type: ignore[no-untyped-def]
    """Arc sine of t clamped to [-1, 1]; r times it is the derivative of the area by the radius."""
    if t >= 1.0:
        return math.pi / 2
    if t <= -1.0:
        return -math.pi / 2
    return math.asin(t)


@njit(cache=True)
def _deposit(row, left, right, value):  # type: ignore[no-untyped-def]
    """Add ``value`` over the interval [left, right] (pixel i covers i - 1/2 .. i + 1/2) as differences."""
    width = row.shape[0] - 1
    channels = value.shape[0]
    if left <= -0.5:
        for c in range(channels):
            row[0, c] += value[c]
    else:
        i = int(math.floor(left + 0.5))
        if i >= width:
            return
        inside = i + 0.5 - left
        for c in range(channels):
            row[i, c] += inside * value[c]
            row[i + 1, c] += (1.0 - inside) * value[c]
    if right < width - 0.5:
        i = int(math.floor(right + 0.5))
        if i < 0:
            for c in range(channels):
                row[0, c] -= value[c]
            return
        inside = i + 0.5 - right
        for c in range(channels):
            row[i, c] -= inside * value[c]
            row[i + 1, c] -= (1.0 - inside) * value[c]


@njit(cache=True)
def _row_reach(defocus):  # type: ignore[no-untyped-def]
    """How many rows the pixels of each row reach up or down."""
    reach = np.zeros(defocus.shape[0], np.int64)
    for y in range(defocus.shape[0]):
        largest = SMALLEST_RADIUS
        for x in range(defocus.shape[1]):
            largest = max(largest, abs(defocus[y, x]))
        reach[y] = int(math.floor(min(largest, LARGEST_RADIUS) + 0.5))
    return reach


@njit(cache=True)
def _scatter_band(image, defocus, reach, first, last, total, weight):  # type: ignore[no-untyped-def]
    """Fill rows ``first`` to ``last`` (excluded) of ``total`` and ``weight``."""
    height, width, channels = image.shape
    sums = np.zeros((last - first, width + 1, channels + 1))
    value = np.empty(channels + 1)
    for y in range(height):
        if y + reach[y] < first or y - reach[y] >= last:
            continue
        nearest = max(0, first - y, y - (last - 1))
        for x in range(width):
            radius = min(max(abs(float(defocus[y, x])), SMALLEST_RADIUS), LARGEST_RADIUS)
            farthest = min(int(math.floor(radius + 0.5)), max(last - 1 - y, y - first))
            if farthest < nearest:
                continue
            w = 1.0 / (math.pi * radius * radius)
            for c in range(channels):
                value[c] = w * image[y, x, c]
            value[channels] = w
            below = half_area((nearest - 0.5) / radius)
            for k in range(nearest, farthest + 1):
                above = half_area((k + 0.5) / radius)
                half_width = radius * radius * (above - below)
                below = above
                if half_width <= 0.0:
                    continue
                if first <= y + k < last:
                    _deposit(sums[y + k - first], x - half_width, x + half_width, value)
                if k > 0 and first <= y - k < last:
                    _deposit(sums[y - k - first], x - half_width, x + half_width, value)
    running = np.empty(channels + 1)
    for row in range(last - first):
        running[:] = 0.0
        for x in range(width):
            for c in range(channels + 1):
                running[c] += sums[row, x, c]
            for c in range(channels):
                total[first + row, x, c] = running[c]
            weight[first + row, x] = running[channels]


@njit(cache=True, parallel=True)
def _scatter_forward(image, defocus, total, weight):  # type: ignore[no-untyped-def]
    height = image.shape[0]
    reach = _row_reach(defocus)
    for band in prange((height + BAND_ROWS - 1) // BAND_ROWS):
        first = band * BAND_ROWS
        _scatter_band(image, defocus, reach, first, min(height, first + BAND_ROWS), total, weight)


@njit(cache=True)
def _integral(sums, values, position, out):  # type: ignore[no-untyped-def]
    """Integral of a row of pixels from its left border to ``position``; ``sums`` are exclusive."""
    width = values.shape[0]
    i = min(max(int(math.floor(position + 0.5)), 0), width)
    for c in range(out.shape[0]):
        out[c] = sums[i, c]
    if i < width and position > -0.5:
        inside = position - (i - 0.5)
        for c in range(out.shape[0]):
            out[c] += inside * values[i, c]


@njit(cache=True, parallel=True)
def _scatter_backward(image, defocus, gradient, sums, grad_image, grad_defocus):  # type: ignore[no-untyped-def]
    height, width, channels = image.shape
    for y in prange(height):
        high = np.empty(channels + 1)
        low = np.empty(channels + 1)
        gathered = np.empty(channels + 1)
        by_radius = np.empty(channels + 1)
        for x in range(width):
            signed = float(defocus[y, x])
            radius = min(max(abs(signed), SMALLEST_RADIUS), LARGEST_RADIUS)
            lowest = -min(int(math.floor(radius + 0.5)), y)
            highest = min(int(math.floor(radius + 0.5)), height - 1 - y)
            gathered[:] = 0.0
            by_radius[:] = 0.0
            below = half_area((lowest - 0.5) / radius)
            angle_below = clamped_asin((lowest - 0.5) / radius)
            for k in range(lowest, highest + 1):
                above = half_area((k + 0.5) / radius)
                angle_above = clamped_asin((k + 0.5) / radius)
                half_width = radius * radius * (above - below)
                growth = radius * (angle_above - angle_below)
                below = above
                angle_below = angle_above
                if half_width <= 0.0:
                    continue
                row = y + k
                _integral(sums[row], gradient[row], x + half_width, high)
                _integral(sums[row], gradient[row], x - half_width, low)
                right = int(math.floor(x + half_width + 0.5))
                left = int(math.floor(x - half_width + 0.5))
                for c in range(channels + 1):
                    gathered[c] += high[c] - low[c]
                    if right < width:
                        by_radius[c] += growth * gradient[row, right, c]
                    if left >= 0:
                        by_radius[c] += growth * gradient[row, left, c]
            w = 1.0 / (math.pi * radius * radius)
            slope = 0.0
            for c in range(channels + 1):
                source = image[y, x, c] if c < channels else 1.0
                slope += source * w * (by_radius[c] - 2.0 / radius * gathered[c])
                if c < channels:
                    grad_image[y, x, c] = w * gathered[c]
            if SMALLEST_RADIUS < abs(signed) <= LARGEST_RADIUS:
                grad_defocus[y, x] = slope if signed > 0 else -slope


def scatter_forward(image: np.ndarray, defocus: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Scatter every pixel over its disc and add up.

    Args:
        image: Scene-linear colours, shape (H, W, C), float32 or float64.
        defocus: Blur radius in pixels, shape (H, W); only its magnitude matters.

    Returns:
        Weighted colours (H, W, C) and weights (H, W), of the image's dtype. Their quotient is the
        rendered picture; away from the borders the weights of a uniform blur are 1.
    """
    total = np.empty_like(image)
    weight = np.empty(image.shape[:2], image.dtype)
    with _parallel_region:
        _scatter_forward(image, defocus, total, weight)
    return total, weight


def scatter_backward(
    image: np.ndarray, defocus: np.ndarray, grad_total: np.ndarray, grad_weight: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Adjoint of :func:`scatter_forward`: gradients for the image and the defocus, at the same cost.

    The derivative by a defocus of magnitude up to ``SMALLEST_RADIUS``, or above ``LARGEST_RADIUS``, is 0.
    """
    gradient = np.concatenate([grad_total, grad_weight[..., None]], axis=-1, dtype=np.float64)
    sums: np.ndarray[Any, Any] = np.zeros((gradient.shape[0], gradient.shape[1] + 1, gradient.shape[2]))
    np.cumsum(gradient, axis=1, out=sums[:, 1:])
    grad_image = np.empty_like(image)
    grad_defocus = np.zeros_like(defocus)
    with _parallel_region:
        _scatter_backward(image, defocus, gradient, sums, grad_image, grad_defocus)
    return grad_image, grad_defocus
