"""Scatter of every pixel over its disc, and the adjoint: kernels and public API. One grid, exact.

A pixel with blur radius r lights the disc of that radius around its centre; every pixel gets the exact
area of the disc that covers it (:mod:`bokehnet.classical.scatter.disc_table`), over the disc's area. Only
the ends of the intervals that make up a row are written, as differences along the row; one running sum per
row then fills the insides, so that a pixel costs O(r), not O(r^2). The adjoint reads, at the same positions,
running sums of the gradient from the row's end.

Destination rows are processed in blocks of a fixed height. One thread owns a block and visits all
sources that reach it in a fixed order: the result has the same bits for any number of threads. A block is
float64, so that beyond a bright disc only 1e-16 of its light remains.

Rows interleave four channels, with one more pixel behind the last, which is never read.

Source: Kosloff, Tao and Barsky, "Depth of field postprocessing for layered scenes using constant-time
rectangle spreading", Graphics Interface 2009, for spreading by differences; the discs are ours.
"""

import math

import numpy as np
from numba import prange

from bokehnet.classical.parallel import parallel_region
from bokehnet.classical.scatter.disc_table import (
    SMALLEST_RADIUS,
    TABLE_RADIUS,
    disc_table,
    find_step,
    list_row,
)
from bokehnet.classical.simd.double4 import add_interval, difference, load4
from bokehnet.kernels import njit

__all__ = [
    "BLOCK_ROWS",
    "LARGEST_RADIUS",
    "join_channels",
    "scatter_backward",
    "scatter_forward",
    "split_channels",
]

# Far beyond any picture, and small enough that 1 / (pi r^2) exceeds the rounding errors of the sums by far.
LARGEST_RADIUS = 1e4

BLOCK_ROWS = 64

# Maximum reach of a disc beyond its radius, pixels: half a pixel, and up to the end of its step in the table.
_MARGIN_PX = 1.5


@njit(cache=True, parallel=True, fastmath=True)  # no additions: only the order of comparisons may change
def _survey(values, defocus):
    """Return the reach in rows of the discs of each row (-1: all sharp), and whether a value is negative."""
    height, width = defocus.shape
    reach, negative = np.empty(height, np.int64), np.zeros(height, np.bool_)
    for row in prange(height):
        y = np.int64(row)
        largest, below = abs(defocus[y, 0]), False
        for x in range(width):
            largest = max(largest, abs(defocus[y, x]))
        for x in range(width):
            for channel in range(4):
                below |= values[y, x, channel] < 0.0
        reach[y] = int(min(largest, LARGEST_RADIUS) + _MARGIN_PX) if largest > SMALLEST_RADIUS else -1
        negative[y] = below
    return reach, negative.any()


@njit(cache=True)
def _stride(blocks):
    """Return a step that visits all blocks once and gives each thread blocks of the whole picture."""
    step = max(1, int(0.618 * blocks))
    while math.gcd(step, blocks) != 1:
        step += 1
    return step


@njit(cache=True)
def _four(array, y, x):
    """Return the four channels of a pixel in float64."""
    return (
        np.float64(array[y, x, 0]),
        np.float64(array[y, x, 1]),
        np.float64(array[y, x, 2]),
        np.float64(array[y, x, 3]),
    )


@njit(cache=True)
def _splat_whole(sums, stride, centre, value, along, start, end, places, weights):
    """Write the ends of a disc that is inside the block, in all four quadrants."""
    for n in range(np.uint64(start), np.uint64(end)):
        strength = weights[n, 0] + along * weights[n, 1]
        row, column = stride * np.int64(places[n, 0]), 4 * np.int64(places[n, 1])
        add_interval(sums, centre - row - column, centre - row + column + 4, strength, value)
        add_interval(sums, centre + row - column, centre + row + column + 4, strength, value)


@njit(cache=True)
def _splat_half(sums, stride, line, x, width, value, along, start, end, places, weights):
    """Write some ends of a disc around column x, below ``line`` or, with negative ``stride``, above it.

    Ends left of the picture are written to its border, ends right of it to the pixel behind the last.
    """
    for n in range(np.uint64(start), np.uint64(end)):
        strength = weights[n, 0] + along * weights[n, 1]
        row, column = line + stride * np.int64(places[n, 0]), np.int64(places[n, 1])
        left, right = row + 4 * max(x - column, 0), row + 4 * min(x + column + 1, width)
        add_interval(sums, left, right, strength, value)


@njit(cache=True)
def _list_disc(radius, nearest, farthest, border, first, places, weights):
    """List the ends of a disc beyond the table, rows ``nearest`` to ``farthest``."""
    end = 0
    for k in range(nearest, farthest + 1):
        first[0, k] = end
        end = list_row(radius, k, border, end, places, weights)
        first[0, k + 1] = end


@njit(cache=True)
def _new_lists(height, width):
    """Return buffers for the ends of one disc on ``height`` rows: ``first``, ``places``, ``weights``."""
    longest = width + 3 * height + 8
    return np.empty((1, height + 2), np.int32), np.empty((longest, 2), np.int16), np.empty((longest, 2))


@njit(cache=True)
def _splat_rows(values, defocus, reach, table, top, bottom, sums):
    """Write all discs that reach the rows ``top`` to ``bottom`` (exclusive) to ``sums``."""
    height, width = defocus.shape
    stride = 4 * (width + 1)
    own_first, own_places, own_weights = _new_lists(height, width)
    for y in range(height):
        if reach[y] < 0 or y + reach[y] < top or y - reach[y] >= bottom:
            continue
        nearest = max(0, top - y, y - (bottom - 1))
        line = (y - top) * stride
        for x in range(width):
            radius = np.float64(min(abs(defocus[y, x]), LARGEST_RADIUS))
            if radius <= SMALLEST_RADIUS or radius + _MARGIN_PX < nearest:
                continue
            value = _four(values, y, x)
            if value[0] == 0 and value[1] == 0 and value[2] == 0 and value[3] == 0:
                continue
            if radius < TABLE_RADIUS:
                step, along, far = find_step(table, radius)
                first, places, weights = table.first, table.places, table.weights
                if y - far >= top and y + far < bottom and x >= far and x + far < width:
                    start, end = first[step, 0], first[step, far + 1]
                    _splat_whole(sums, stride, line + 4 * x, value, along, start, end, places, weights)
                    continue
            else:
                step, along, far = 0, 0.0, int(radius + 0.5)
                first, places, weights = own_first, own_places, own_weights
                farthest = min(far, max(bottom - 1 - y, y - top))
                _list_disc(radius, nearest, farthest, max(x, width - 1 - x), first, places, weights)
            upper, lower = min(far, y - top), min(far, bottom - 1 - y)
            if upper >= nearest:
                start, end = first[step, nearest], first[step, upper + 1]
                _splat_half(sums, -stride, line, x, width, value, along, start, end, places, weights)
            if lower >= nearest:
                start, end = first[step, nearest], first[step, lower + 1]
                _splat_half(sums, stride, line, x, width, value, along, start, end, places, weights)


@njit(cache=True)
def _sum_rows(values, defocus, top, bottom, lowest, sums, out):
    """Sum the differences along the rows ``top`` to ``bottom`` of ``out``, and add the sharp pixels."""
    width = defocus.shape[1]
    for y in range(top, bottom):
        line = (y - top) * 4 * (width + 1)
        a, b, c, d = 0.0, 0.0, 0.0, 0.0
        for x in range(width):
            more = load4(sums, line + 4 * x)
            a, b, c, d = a + more[0], b + more[1], c + more[2], d + more[3]
            out[y, x, 0] = max(a, lowest)
            out[y, x, 1] = max(b, lowest)
            out[y, x, 2] = max(c, lowest)
            out[y, x, 3] = max(d, lowest)
            if abs(defocus[y, x]) <= SMALLEST_RADIUS:
                for channel in range(4):
                    out[y, x, channel] += values[y, x, channel]


@njit(cache=True, parallel=True)
def scatter_discs(values, defocus, table, out):
    """Scatter ``values`` (H, W, 4) over discs into ``out``.

    Args:
        values: Values to spread, (H, W, 4).
        defocus: Radii (H, W); the sign is ignored.
        table: Table of small discs.
        out: Sums, (H, W, 4); not below 0 if no value is.
    """
    height, width = defocus.shape
    reach, negative = _survey(values, defocus)
    lowest = -np.inf if negative else 0.0
    blocks = (height + BLOCK_ROWS - 1) // BLOCK_ROWS
    stride = _stride(blocks)
    for block in prange(blocks):
        top = np.int64(block) * stride % blocks * BLOCK_ROWS
        bottom = min(height, top + BLOCK_ROWS)
        sums = np.zeros((bottom - top) * 4 * (width + 1))
        _splat_rows(values, defocus, reach, table, top, bottom, sums)
        _sum_rows(values, defocus, top, bottom, lowest, sums, out)


@njit(cache=True)
def _read_half(rests, stride, line, x, width, value, along, start, end, places, weights):
    """Return the adjoint of :func:`_splat_half`: gradients of the value (4) and the radius."""
    a, b, c, d, slope = 0.0, 0.0, 0.0, 0.0, 0.0
    for n in range(np.uint64(start), np.uint64(end)):
        strength = weights[n, 0] + along * weights[n, 1]
        row, column = line + stride * np.int64(places[n, 0]), np.int64(places[n, 1])
        inside = difference(rests, row + 4 * max(x - column, 0), row + 4 * min(x + column + 1, width))
        a += strength * inside[0]
        b += strength * inside[1]
        c += strength * inside[2]
        d += strength * inside[3]
        light = value[0] * inside[0] + value[1] * inside[1] + value[2] * inside[2] + value[3] * inside[3]
        slope += weights[n, 1] * light
    return a, b, c, d, slope


@njit(cache=True, parallel=True)
def sum_from_end(gradient):
    """Return the sums of ``gradient`` (H, W, 4) from each pixel to the end of its row, flat (H (W + 1) 4)."""
    height, width, _ = gradient.shape
    rests = np.empty(height * (width + 1) * 4)
    for y in prange(height):
        line = np.int64(y) * (width + 1) * 4
        for channel in range(4):
            rest = 0.0
            rests[line + 4 * width + channel] = rest
            for x in range(width - 1, -1, -1):
                rest += gradient[y, x, channel]
                rests[line + 4 * x + channel] = rest
    return rests


@njit(cache=True)
def _read_rows(values, defocus, table, gradient, rests, top, bottom, grad_values, grad_defocus):
    """Fill the gradients of the rows ``top`` to ``bottom`` (exclusive)."""
    height, width = defocus.shape
    stride = 4 * (width + 1)
    own_first, own_places, own_weights = _new_lists(height, width)
    for y in range(top, bottom):
        for x in range(width):
            signed = np.float64(defocus[y, x])
            radius = min(abs(signed), LARGEST_RADIUS)
            if radius <= SMALLEST_RADIUS:
                for channel in range(4):
                    grad_values[y, x, channel] = gradient[y, x, channel]
                continue
            if radius < TABLE_RADIUS:
                step, along, far = find_step(table, radius)
                first, places, weights = table.first, table.places, table.weights
            else:
                step, along, far = 0, 0.0, int(radius + 0.5)
                first, places, weights = own_first, own_places, own_weights
                farthest = min(far, max(height - 1 - y, y))
                _list_disc(radius, 0, farthest, max(x, width - 1 - x), first, places, weights)
            value, start, line = _four(values, y, x), first[step, 0], y * stride
            end = first[step, min(far, y) + 1]
            upper = _read_half(rests, -stride, line, x, width, value, along, start, end, places, weights)
            end = first[step, min(far, height - 1 - y) + 1]
            lower = _read_half(rests, stride, line, x, width, value, along, start, end, places, weights)
            grad_values[y, x, 0] = upper[0] + lower[0]
            grad_values[y, x, 1] = upper[1] + lower[1]
            grad_values[y, x, 2] = upper[2] + lower[2]
            grad_values[y, x, 3] = upper[3] + lower[3]
            if abs(signed) <= LARGEST_RADIUS:
                grad_defocus[y, x] += math.copysign(1.0, signed) * (upper[4] + lower[4])


@njit(cache=True, parallel=True)
def gather_discs(values, defocus, table, gradient, rests, grad_values, grad_defocus):
    """Compute the adjoint of :func:`scatter_discs`; adds to ``grad_defocus``.

    Args:
        values: As in the forward pass, (H, W, 4).
        defocus: As in the forward pass, (H, W).
        table: As in the forward pass.
        gradient: Gradient of the sums, (H, W, 4).
        rests: Its sums from the row's end, from :func:`sum_from_end`.
        grad_values: Filled, (H, W, 4).
        grad_defocus: Added to, (H, W).
    """
    height = defocus.shape[0]
    blocks = (height + BLOCK_ROWS - 1) // BLOCK_ROWS
    stride = _stride(blocks)
    for block in prange(blocks):
        top = np.int64(block) * stride % blocks * BLOCK_ROWS
        bottom = min(height, top + BLOCK_ROWS)
        _read_rows(values, defocus, table, gradient, rests, top, bottom, grad_values, grad_defocus)


def split_channels(array: np.ndarray) -> list[np.ndarray]:
    """Split the channels into groups of four; zeros fill the last one."""
    if array.shape[2] == 4:
        return [np.ascontiguousarray(array)]
    missing = -array.shape[2] % 4
    filled = np.pad(array, ((0, 0), (0, 0), (0, missing)))
    return [np.ascontiguousarray(part) for part in np.split(filled, filled.shape[2] // 4, axis=2)]


def join_channels(groups: list[np.ndarray], channels: int) -> np.ndarray:
    """Join the groups of :func:`split_channels`."""
    return groups[0] if channels == 4 else np.ascontiguousarray(np.concatenate(groups, 2)[..., :channels])


def scatter_forward(values: np.ndarray, defocus: np.ndarray) -> np.ndarray:
    """Scatter every pixel over its disc and sum; linear in ``values``.

    Args:
        values: Values to spread, (H, W, C), float32 or float64; a channel of ones gives the
            weights to divide by. Four channels are the fastest. A pixel of zeros costs nothing.
        defocus: Blur radius in pixels, (H, W); only its magnitude counts. Up to 1/2 a pixel is unchanged.

    Returns:
        Sums (H, W, C) of the values' dtype. The sum over a disc inside the picture is the value of its
        source, whatever its radius.
    """
    sums = []
    for group in split_channels(values):
        sums.append(np.empty_like(group))
        with parallel_region:
            scatter_discs(group, np.ascontiguousarray(defocus), disc_table(), sums[-1])
    return join_channels(sums, values.shape[2])


def scatter_backward(
    values: np.ndarray, defocus: np.ndarray, grad_sums: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the adjoint of :func:`scatter_forward`, at the same order of cost.

    Args:
        values: As in the forward pass, (H, W, C).
        defocus: As in the forward pass, (H, W).
        grad_sums: Gradient of the sums, (H, W, C).

    Returns:
        Gradients of the values (H, W, C) and of the defocus (H, W). The latter is 0 where the magnitude is
        up to 1/2 or above ``LARGEST_RADIUS``.
    """
    defocus = np.ascontiguousarray(defocus)
    grad_values, grad_defocus = [], np.zeros_like(defocus)
    for group, gradient in zip(split_channels(values), split_channels(grad_sums), strict=True):
        grad_values.append(np.empty_like(group))
        with parallel_region:
            rests = sum_from_end(gradient)
            gather_discs(group, defocus, disc_table(), gradient, rests, grad_values[-1], grad_defocus)
    return join_channels(grad_values, values.shape[2]), grad_defocus
