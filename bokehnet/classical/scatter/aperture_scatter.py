"""Scatter of every pixel over the shape of any aperture, and its adjoint: kernels and public API.

A pixel with signed blur radius d adds to each pixel around it the fraction of its light in the shape's radius
table (:mod:`bokehnet.classical.scatter.aperture_table`) for that radius, eight pixels of four channels at a
time. The cost is O(r^2), but the factor is so small that up to about 8 pixels it is faster than writing the
two ends of each row, and any picture can be a shape. The fractions of one pixel's light sum to one, whatever
the shape.

Destination rows are processed in blocks of a fixed height. One thread owns a block and visits all sources
that reach it in a fixed order: the result has the same bits for any number of threads. A block has a
margin on both sides, so that nothing is cut at the borders of the picture.

The cat's-eye clips each row of a shape to an interval and divides by the remaining fraction, so that a pixel
keeps all its light there, too: the loss of light is not modelled, because the sums are divided by the weights
in the end.

Shapes beyond the tables' largest radius are scattered on pictures of every second row and column
(:mod:`bokehnet.classical.scatter.pyramid_lattices`), four of them, so that no source moves, and are upsampled
by linear interpolation. That blurs by a variance of 3/4 pixel^2, compared with the r^2 / 4 of a disc.
"""

import math
from collections.abc import Iterator

import numpy as np
from numba import prange

from bokehnet.classical.parallel import parallel_region
from bokehnet.classical.scatter.aperture_table import LARGEST_TABLE, STEP, shape_table
from bokehnet.classical.scatter.cats_eye import (
    SMALLEST_SHARE,
    View,
    chord_room,
    every_second,
    find_chords,
    make_view,
    share_at,
    share_table,
)
from bokehnet.classical.scatter.disc_scatter import BLOCK_ROWS, LARGEST_RADIUS
from bokehnet.classical.scatter.disc_table import SMALLEST_RADIUS
from bokehnet.classical.scatter.pyramid_lattices import add_lattice, gather_lattice, lattice_shape
from bokehnet.classical.simd.float8 import (
    LANES,
    broadcast8,
    indices8,
    load4_twice,
    load8,
    overlap8,
    overlap_growth8,
    repeat4,
    store8,
)
from bokehnet.kernels import njit
from bokehnet.optics.aperture import Aperture

__all__ = ["prepare_tables", "scatter_backward", "scatter_forward"]

# Channels of a pixel in these kernels.
CHANNELS = 4


@njit(cache=True, forceinline=True)
def _step_of(signed):
    """Return the radius, its step of the table, the fraction towards the next step, and the reach in rows."""
    radius = max(abs(float(signed)), SMALLEST_RADIUS)
    place = (radius - SMALLEST_RADIUS) / STEP
    step = int(place)
    return radius, step, place - step, int(math.floor(SMALLEST_RADIUS + (step + 1) * STEP + 0.5))


@njit(cache=True)
def _row_reach(defocus):
    """Return the reach of the pixels of each row, up or down, in rows."""
    reach = np.zeros(defocus.shape[0], np.int64)
    for y in range(defocus.shape[0]):
        largest = abs(defocus[y, 0])
        for x in range(defocus.shape[1]):
            largest = max(largest, abs(defocus[y, x]))
        if largest > SMALLEST_RADIUS:
            reach[y] = _step_of(min(largest, LARGEST_TABLE))[3]
    return reach


@njit(cache=True)
def _is_absent(values, y, x):
    """Return whether all values of a pixel are 0."""
    return not (values[y, x, 0] or values[y, x, 1] or values[y, x, 2] or values[y, x, 3])


@njit(cache=True, forceinline=True)
def _clip(signed, shares, view, y, x, lowest, highest, halves, growths):
    """Clip a source by the second pupil.

    Returns:
        Whether it is clipped, the transmitted fraction of the light, its derivative by the radius, the first
        and last remaining row of those from ``lowest`` to ``highest``, and the centre of their intervals.
    """
    radius, step, along, _ = _step_of(signed)
    u, v = view.u + x * view.du, view.v + y * view.dv
    side = 0
    if signed < 0:
        side, u, v = 1, -u, -v
    share, growth = share_at(shares, view.cats_eye, side, step, along, u, v)
    if share <= SMALLEST_SHARE:
        return False, 1.0, 0.0, lowest, highest, 0.0
    top = max(lowest, int(math.floor(radius * (v - 1.0) + 0.5)))
    bottom = min(highest, int(math.floor(radius * (v + 1.0) + 0.5)))
    if top > bottom:
        top, bottom = lowest, lowest - 1
    find_chords(radius, u, v, top, bottom, halves, growths)
    return True, share, growth, top, bottom, radius * u


@njit(cache=True)
def _add_block(sums, at, part, value):
    """Add the fractions of eight pixels of a value."""
    a, b, c, d = repeat4(part)
    store8(sums, at, load8(sums, at) + a * value)
    store8(sums, at + LANES, load8(sums, at + LANES) + b * value)
    store8(sums, at + 2 * LANES, load8(sums, at + 2 * LANES) + c * value)
    store8(sums, at + 3 * LANES, load8(sums, at + 3 * LANES) + d * value)


@njit(cache=True)
def _splat_blocks(sums, at, stride, shape, begin, end, f, value, clip, halves):
    """Add the blocks ``begin`` to ``end`` (exclusive) of a shape to rows of pixels.

    Args:
        sums: The rows, flat.
        at: Index of the source's own pixel.
        stride: Values per row.
        shape: Rows, columns and fractions, see
            :class:`bokehnet.classical.scatter.aperture_table.ShapeTable`.
        begin: First block.
        end: Index behind the last block.
        f: Fraction towards the next step of the radius table, in all lanes.
        value: Four channels of the source, twice.
        clip: Whether each row is clipped to an interval, its centre in pixels from the source, and the
            row of the first of ``halves``.
        halves: From :func:`find_chords`.
    """
    rows, columns, parts = shape
    clipped, centre, lowest = clip
    number = parts.dtype.type
    if clipped:
        from_centre = indices8(number(-centre))
        for block in range(begin, end):
            place = 2 * LANES * block
            part = load8(parts, place) + f * load8(parts, place + LANES)
            distance = from_centre + broadcast8(number(columns[block]))
            part = part * overlap8(distance, broadcast8(halves[rows[block] - lowest]))
            _add_block(sums, at + stride * rows[block] + CHANNELS * columns[block], part, value)
    else:
        for block in range(begin, end):
            place = 2 * LANES * block
            part = load8(parts, place) + f * load8(parts, place + LANES)
            _add_block(sums, at + stride * rows[block] + CHANNELS * columns[block], part, value)


@njit(cache=True)
def _scatter_rows(values, defocus, reach, table, shares, view, margin, first, last, out):
    """Fill the rows ``first`` to ``last`` (exclusive) of ``out``."""
    height, width = defocus.shape
    middle, starts = table.middle, table.first
    shape = (table.rows, table.columns, table.parts)
    number = table.parts.dtype.type
    stride = CHANNELS * (width + 2 * margin)
    sums = np.zeros((last - first) * stride, table.parts.dtype)
    halves = np.empty(chord_room(last - first), table.parts.dtype)
    no_growths = halves[:0]
    flat = values.reshape(values.size)
    for y in range(height):
        if y + reach[y] < first or y - reach[y] >= last:
            continue
        for x in range(width):
            signed = defocus[y, x]
            if abs(signed) > LARGEST_TABLE or _is_absent(values, y, x):
                continue
            at = (y - first) * stride + CHANNELS * (margin + x)
            if abs(signed) <= SMALLEST_RADIUS:
                if first <= y < last:
                    for c in range(CHANNELS):
                        sums[at + c] += values[y, x, c]
                continue
            _, step, along, steps = _step_of(signed)
            low, high = max(-steps, first - y), min(steps, last - 1 - y)
            if low > high:
                continue
            clipped, share, centre = False, 1.0, 0.0
            if view.cats_eye > 0:
                clipped, share, _, low, high, centre = _clip(
                    signed, shares, view, y, x, low, high, halves, no_growths
                )
            clip = (clipped, centre, low)
            side = 1 if signed < 0 else 0
            f, strength = broadcast8(number(along)), broadcast8(number(1.0 / share))
            value = strength * load4_twice(flat, CHANNELS * (y * width + x))
            begin, end = starts[middle[side, step] + low], starts[middle[side, step] + high + 1]
            _splat_blocks(sums, at, stride, shape, begin, end, f, value, clip, halves)
    for y in range(first, last):
        at = (y - first) * stride + CHANNELS * margin
        for x in range(width):
            for c in range(CHANNELS):
                out[y, x, c] = sums[at + CHANNELS * x + c]


@njit(cache=True, parallel=True)
def shaped_forward(values, defocus, table, shares, view, margin, out):
    """Fill ``out``, of the shape of ``values``; other arguments as in :func:`_scatter_rows`."""
    height = defocus.shape[0]
    reach = _row_reach(defocus)
    for block in prange((height + BLOCK_ROWS - 1) // BLOCK_ROWS):
        first = np.int64(block) * BLOCK_ROWS  # the counter is unsigned, and rows can be negative
        last = min(height, first + BLOCK_ROWS)
        _scatter_rows(values, defocus, reach, table, shares, view, margin, first, last, out)


@njit(cache=True)
def _gather_block(gradient, at, part, change, sums):
    """Add the adjoint of :func:`_add_block` by the value and by the fractions' ``change``; two sums each."""
    even, odd, even_rise, odd_rise = sums
    first, second = load8(gradient, at), load8(gradient, at + LANES)
    third, fourth = load8(gradient, at + 2 * LANES), load8(gradient, at + 3 * LANES)
    a, b, c, d = repeat4(part)
    even, odd = even + a * first + c * third, odd + b * second + d * fourth
    a, b, c, d = repeat4(change)
    even_rise, odd_rise = even_rise + a * first + c * third, odd_rise + b * second + d * fourth
    return even, odd, even_rise, odd_rise


@njit(cache=True)
def _read_blocks(gradient, at, stride, shape, begin, end, f, clip, halves, growths, sums):
    """Add the adjoint of :func:`_splat_blocks` to ``sums``: by the value, and by the step of the table."""
    rows, columns, parts = shape
    clipped, centre, lowest, drift = clip
    number = parts.dtype.type
    if clipped:
        from_centre, centre_growth = indices8(number(-centre)), broadcast8(number(drift))
        for block in range(begin, end):
            place = 2 * LANES * block
            row = rows[block] - lowest
            distance, half = from_centre + broadcast8(number(columns[block])), broadcast8(halves[row])
            cover = overlap8(distance, half)
            cover_growth = overlap_growth8(distance, half, broadcast8(growths[row]), centre_growth)
            change = load8(parts, place + LANES)
            part = load8(parts, place) + f * change
            change = cover * change + cover_growth * part
            at_block = at + stride * rows[block] + CHANNELS * columns[block]
            sums = _gather_block(gradient, at_block, cover * part, change, sums)
    else:
        for block in range(begin, end):
            place = 2 * LANES * block
            change = load8(parts, place + LANES)
            part = load8(parts, place) + f * change
            at_block = at + stride * rows[block] + CHANNELS * columns[block]
            sums = _gather_block(gradient, at_block, part, change, sums)
    return sums


@njit(cache=True)
def _gather_row(y, values, defocus, gradient, table, shares, view, margin, grad_values, grad_defocus):
    """Fill row y of the gradients; ``gradient`` is flat, and its rows include the margin."""
    height, width = defocus.shape
    middle, starts = table.middle, table.first
    shape = (table.rows, table.columns, table.parts)
    number = table.parts.dtype.type
    stride = CHANNELS * (width + 2 * margin)
    halves = np.empty(chord_room(height), table.parts.dtype)
    growths = np.empty_like(halves)
    lanes = np.empty(LANES, table.parts.dtype)
    zero = broadcast8(number(0))
    for x in range(width):
        signed = defocus[y, x]
        at = y * stride + CHANNELS * (margin + x)
        if abs(signed) <= SMALLEST_RADIUS:
            for c in range(CHANNELS):
                grad_values[y, x, c] = gradient[at + c]
            continue
        if abs(signed) > LARGEST_TABLE:
            continue
        radius, step, along, steps = _step_of(signed)
        low, high = max(-steps, -y), min(steps, height - 1 - y)
        clipped, share, growth, centre = False, 1.0, 0.0, 0.0
        if view.cats_eye > 0:
            clipped, share, growth, low, high, centre = _clip(
                signed, shares, view, y, x, low, high, halves, growths
            )
        clip = (clipped, centre, low, centre / radius * STEP)
        sign, side = (-1, 1) if signed < 0 else (1, 0)
        f, sums = broadcast8(number(along)), (zero, zero, zero, zero)
        begin, end = starts[middle[side, step] + low], starts[middle[side, step] + high + 1]
        sums = _read_blocks(gradient, at, stride, shape, begin, end, f, clip, halves, growths, sums)
        slope = 0.0
        store8(lanes, 0, sums[2] + sums[3])
        for c in range(CHANNELS):
            slope += values[y, x, c] * (lanes[c] + lanes[c + CHANNELS]) / STEP
        store8(lanes, 0, sums[0] + sums[1])
        for c in range(CHANNELS):
            gathered = (lanes[c] + lanes[c + CHANNELS]) / share
            grad_values[y, x, c] = gathered
            slope -= growth * values[y, x, c] * gathered
        grad_defocus[y, x] += sign * slope / share


@njit(cache=True, parallel=True)
def shaped_backward(values, defocus, gradient, table, shares, view, margin, grad_values, grad_defocus):
    """Fill ``grad_values`` and add to ``grad_defocus``; arguments as in :func:`_gather_row`."""
    for y in prange(defocus.shape[0]):
        _gather_row(
            np.int64(y), values, defocus, gradient, table, shares, view, margin, grad_values, grad_defocus
        )


def _groups(values: np.ndarray) -> list[np.ndarray]:
    """Split the channels into groups of four; zeros fill the last one."""
    missing = -values.shape[2] % CHANNELS
    filled = np.pad(values, ((0, 0), (0, 0), (0, missing))) if missing else values
    groups = range(0, filled.shape[2], CHANNELS)
    return [np.ascontiguousarray(filled[:, :, c : c + CHANNELS]) for c in groups]


def _join(groups: list[np.ndarray], channels: int) -> np.ndarray:
    """Join groups of channels."""
    joined = groups[0] if len(groups) == 1 else np.concatenate(groups, axis=2)
    return joined[:, :, :channels]


def _lattices(
    values: np.ndarray, defocus: np.ndarray, view: View
) -> Iterator[tuple[int, int, np.ndarray, np.ndarray, np.ndarray, View]]:
    """Yield the sources beyond the tables: lattice start, mask, their values, defocus and view.

    The values are divided by four because a pixel of a lattice represents four pixels.
    """
    for y, x in np.ndindex(2, 2):
        lattice = defocus[y::2, x::2]
        mask = np.abs(lattice) > LARGEST_TABLE
        if mask.any():
            shape = lattice_shape(defocus.shape[0], defocus.shape[1], y, x)
            coarse_values, coarse_defocus = (
                np.zeros((*shape, CHANNELS), values.dtype),
                np.zeros(shape, values.dtype),
            )
            coarse_values[1:-1, 1:-1][mask] = values[y::2, x::2][mask] / 4
            coarse_defocus[1:-1, 1:-1][mask] = lattice[mask] / 2
            yield y, x, mask, coarse_values, coarse_defocus, every_second(view, x - 2, y - 2)


def prepare_tables(aperture: Aperture, radius: float) -> None:
    """Prepare the tables of an aperture for discs of up to ``radius`` pixels, before a picture needs them."""
    share_table(aperture, shape_table(aperture, radius, "float32"))


def _scatter(values: np.ndarray, defocus: np.ndarray, aperture: Aperture, view: View) -> np.ndarray:
    """Scatter four channels, (H, W, 4)."""
    table = shape_table(aperture, float(np.abs(defocus).max()), values.dtype.name)
    shares, margin = share_table(aperture, table), int(table.reach[-1]) + LANES
    sums = np.empty_like(values)
    with parallel_region:
        shaped_forward(values, defocus, table, shares, view, margin, sums)
    for y, x, _, coarse_values, coarse_defocus, coarse_view in _lattices(values, defocus, view):
        coarse = _scatter(coarse_values, coarse_defocus, aperture, coarse_view)
        with parallel_region:
            add_lattice(coarse, y, x, sums)
    return sums


def _gather(
    values: np.ndarray, defocus: np.ndarray, gradient: np.ndarray, aperture: Aperture, view: View
) -> tuple[np.ndarray, np.ndarray]:
    """Return the adjoint of :func:`_scatter`."""
    table = shape_table(aperture, float(np.abs(defocus).max()), values.dtype.name)
    shares, margin = share_table(aperture, table), int(table.reach[-1]) + LANES
    padded = np.pad(gradient, ((0, 0), (margin, margin), (0, 0))).ravel()
    grad_values, grad_defocus = np.zeros_like(values), np.zeros_like(defocus)
    with parallel_region:
        shaped_backward(values, defocus, padded, table, shares, view, margin, grad_values, grad_defocus)
    for y, x, places, coarse_values, coarse_defocus, coarse_view in _lattices(values, defocus, view):
        coarse = np.empty_like(coarse_values)
        with parallel_region:
            gather_lattice(gradient, y, x, coarse)
        gathered, slopes = _gather(coarse_values, coarse_defocus, coarse, aperture, coarse_view)
        grad_values[y::2, x::2][places] = gathered[1:-1, 1:-1][places] / 4
        grad_defocus[y::2, x::2][places] = slopes[1:-1, 1:-1][places] / 2
    return grad_values, grad_defocus


def _prepare(
    defocus: np.ndarray,
    aperture: Aperture,
    dtype: np.dtype,
    full_shape: tuple[int, int] | None,
    scale: float,
    origin: tuple[int, int],
) -> tuple[np.ndarray, View]:
    """Return the defocus in the form of the kernels, and the view of the grid in the picture."""
    height, width = defocus.shape
    view = make_view(aperture.cats_eye, full_shape or (height, width), scale, origin)
    return np.ascontiguousarray(np.clip(defocus, -LARGEST_RADIUS, LARGEST_RADIUS), dtype), view


def scatter_forward(
    values: np.ndarray,
    defocus: np.ndarray,
    aperture: Aperture,
    *,
    full_shape: tuple[int, int] | None = None,
    scale: float = 1.0,
    origin: tuple[int, int] = (0, 0),
) -> np.ndarray:
    """Scatter the values of every pixel over the shape of the aperture, and sum.

    Args:
        values: (H, W, C), float32 or float64; a channel of ones gives the weights. A pixel whose values
            are all 0 costs nothing. Channels are processed in fours: one costs as much as four.
        defocus: Signed blur radius in pixels of this grid, (H, W), finite, + in front of focus. Up to 0.5
            pixels (on both sides) a pixel is unchanged.
        aperture: Shape of the aperture.
        full_shape: Height and width of the full-size picture, for the cat's-eye; default: this one's.
        scale: Full-size pixels per pixel: pixel x of this grid is centred on (x + 1/2) scale - 1/2.
        origin: Column and row of the full-size picture at which this one begins.

    Returns:
        Sums (H, W, C), of the values' dtype. The fractions of one pixel sum to one (with a cat's-eye within
        half a percent) as far as they are inside the picture.
    """
    defocus, view = _prepare(defocus, aperture, values.dtype, full_shape, scale, origin)
    return _join([_scatter(group, defocus, aperture, view) for group in _groups(values)], values.shape[2])


def scatter_backward(
    values: np.ndarray,
    defocus: np.ndarray,
    grad_sums: np.ndarray,
    aperture: Aperture,
    *,
    full_shape: tuple[int, int] | None = None,
    scale: float = 1.0,
    origin: tuple[int, int] = (0, 0),
) -> tuple[np.ndarray, np.ndarray]:
    """Return the adjoint of :func:`scatter_forward`, at the same cost.

    Args:
        values: As in the forward pass.
        defocus: As in the forward pass.
        grad_sums: Gradient of the sums, (H, W, C).
        aperture: As in the forward pass.
        full_shape: As in the forward pass.
        origin: As in the forward pass.
        scale: As in the forward pass.

    Returns:
        Gradients of the values (H, W, C) and of the defocus (H, W). The latter is 0 where the magnitude is
        up to 1/2 or above ``LARGEST_RADIUS``.
    """
    clipped, view = _prepare(defocus, aperture, values.dtype, full_shape, scale, origin)
    grad_values, grad_defocus = [], np.zeros_like(clipped)
    for group, gradient in zip(_groups(values), _groups(grad_sums), strict=True):
        gathered, slopes = _gather(group, clipped, gradient, aperture, view)
        grad_values.append(gathered)
        grad_defocus += slopes
    grad_defocus[np.abs(defocus) > LARGEST_RADIUS] = 0
    return _join(grad_values, values.shape[2]), grad_defocus
