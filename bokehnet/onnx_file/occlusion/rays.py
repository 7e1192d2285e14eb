"""Pupil rays through layers as ONNX operators, by the formulas of :mod:`bokehnet.pupil_rays`.

Pixels are sorted by their number of slabs and traced in blocks, so that a block only visits the slabs that
its pixels have. Surfaces are interpolated from the four pixels around a ray. All 3x3 blocks of pixels use the
same nine sets of pupil samples, so that means over windows of pixels, as in
:mod:`bokehnet.torch.window_means`, have no noise.
"""

from collections.abc import Iterator, Sequence
from functools import cache

import numpy as np

from bokehnet.classical.rays_renderer import pupil_pattern
from bokehnet.onnx_file.builder import Graph, Value
from bokehnet.onnx_file.occlusion.layers import GraphLayers
from bokehnet.onnx_file.pictures import pad_to_multiple
from bokehnet.onnx_file.polygon import Polygon
from bokehnet.optics.aperture import Aperture
from bokehnet.pupil_rays import (
    BINS,
    TILE,
    Slab,
    SlabScan,
    find_surface,
    first_scan,
    is_inside,
    max_bins_of,
    scan_bin,
)

__all__ = ["render_rays"]

# Pupil samples of a pixel, sets of samples, slabs, and pixels per block.
_SAMPLES, _SETS, _SLABS, _BLOCK_PIXELS = 16, 9, 6, 32768

# Radius in pixels below which a surface is sharp; half-widths of the windows over which others are averaged,
# pixels; half-width over blur radius, larger than in the package (1 / 12), which traces more rays.
_SHARP_RADIUS_PX, _REACHES_PX, _REACH_BY_RADIUS = 4.0, (1, 2, 4, 8, 16, 32), 1 / 8

_EPSILON = 1e-9

# Sums of a ray's group: red, green, blue, weight, weight over radius.
_NUMBERS, _GROUPS = 5, 3


@cache
def _points() -> tuple[np.ndarray, np.ndarray]:
    """Return aperture coordinates u and v of the samples, (_SETS * _SAMPLES,) each."""
    points = pupil_pattern(Aperture())[0][:, :_SETS, :_SAMPLES]
    return points[0].ravel(), points[1].ravel()


def _occupied(g: Graph, index: Value) -> Value:
    """Return for each bin the tiles that contain it, (BINS, rows, columns), 0 or 1; ``index`` (H, W)."""
    padded = pad_to_multiple(g, index, TILE)
    batch = padded.reshape(1, 1, padded.size(0), padded.size(1))
    window = {"kernel_shape": [TILE] * 2, "strides": [TILE] * 2}

    def mask(bin: Value) -> tuple[list[Value], list[Value]]:
        return [], [g.op("MaxPool", batch.equals(bin.astype(np.float32)).astype(np.float32), **window)]

    tiles = g.loop(mask, [], times=g.sizes(BINS))[0]
    return g.op("Squeeze", tiles, g.sizes(1, 2))


def _dilate(g: Graph, occupied: Value, reach: Value) -> Value:
    """Return the bins of all tiles within ``reach`` (BINS,) tiles, as a mask of the same shape."""
    bins = g.constant(np.arange(BINS)).reshape(-1, 1)
    for axis in (1, 2):
        rows = occupied if axis == 2 else occupied.transpose(0, 2, 1)
        size = rows.size(2)
        zero = rows.cut(2, 0, 1) * 0
        sums = g.concat([zero, g.op("CumSum", rows, g.constant(2))], 2)
        at = g.count_up(size).reshape(1, -1)
        last = g.minimum(at + reach.reshape(-1, 1) + 1, size)
        first = g.maximum(at - reach.reshape(-1, 1), 0)
        columns = sums.transpose(0, 2, 1).reshape(-1, sums.size(1))  # (BINS * (size + 1), lines)
        offset = bins * (size + 1)
        counts = columns.take((last + offset).reshape(-1)) - columns.take((first + offset).reshape(-1))
        counts = counts.reshape(g.constant([BINS], np.int64), size, rows.size(1))  # (BINS, size, lines)
        occupied = (counts > 0.5).astype(np.float32)
        if axis == 2:
            occupied = occupied.transpose(0, 2, 1)
    return occupied > 0.5


def _find_slabs(g: Graph, layers: GraphLayers, height: Value, width: Value) -> tuple[list[Value], Value]:
    """Return front, back, high and low of the tiles' slabs, (_SLABS, tiles) each, and the tile columns."""
    high = g.op("Max", layers.defocus[0].max(), layers.defocus[1].max())
    low = g.op("Min", layers.defocus[0].min(), layers.defocus[1].min())
    thickness = g.maximum((high - low) / BINS, 1e-3) * (1 + 1e-5)
    occupied = None
    for defocus in layers.defocus:
        index = g.floor((high - defocus) / thickness).clip(0.0, BINS - 1.0).reshape(height, width)
        mask = _occupied(g, index)
        occupied = mask if occupied is None else g.maximum(occupied, mask)
    assert occupied is not None
    edges = high - thickness * g.constant(np.arange(BINS + 1), np.float32)
    farthest = g.maximum(abs(edges.cut(0, 0, BINS)), abs(edges.cut(0, 1, BINS + 1)))
    reach = g.op("Ceil", farthest / float(TILE)).astype(np.int64)
    columns = occupied.size(2)
    dilated = _dilate(g, occupied, reach).reshape(BINS, -1)
    bins = g.constant(np.arange(BINS)).reshape(-1, 1)
    first_bin, last_bin = g.where(dilated, bins, BINS).min(0), g.where(dilated, bins, -1).max(0)
    max_bins = max_bins_of(first_bin, last_bin, _SLABS)

    def add(bin: Value, *state: Value) -> tuple[list[Value], list[Value]]:
        scan = scan_bin(SlabScan(state[0], state[1], state[2], state[3:]), bin, dilated.take(bin), max_bins)
        return [*scan[:3], *scan.bounds], []

    start = first_scan(max_bins * 0, _SLABS)
    scanned = g.loop(add, [*start[:3], *start.bounds], times=g.sizes(BINS))[3:]
    bounds = zip(scanned[:_SLABS], scanned[_SLABS:], strict=True)
    values: list[list[Value]] = [[], [], [], []]
    for first, last in bounds:
        exists = first >= 0
        front, back = (high - thickness * (bin.astype(np.float32) + 0.5) for bin in (first, last))
        margin = thickness * 1e-3
        upper = g.where(exists, high - thickness * first.astype(np.float32) + margin, -1e9)
        lower = g.where(exists, high - thickness * (last.astype(np.float32) + 1) - margin, 1e9)
        for column, value in zip(values, (front, back, upper, lower), strict=True):
            column.append(value.reshape(1, -1))
    return [g.concat(column) for column in values], columns


def _surface_at(corners: Iterator[tuple[Value, Value]], slab: Slab) -> tuple[Value, Value, Value]:
    """Return coverage (N,), defocus (N,) and weighted colours (3, N) of the surfaces in a slab.

    Args:
        corners: Weight (N,) of the four pixels around each ray, and their layers (9, N): colours of both,
            defocus of both, and coverage of the first.
        slab: Slab of each ray.
    """
    alpha: Value | None = None
    for weight, layers in corners:
        g = weight.graph
        front, back, coverage = (layers.cut(0, c, c + 1).reshape(-1) for c in (6, 7, 8))
        front_weight = g.where(is_inside(slab, front), weight * coverage, 0)
        back_weight = g.where(is_inside(slab, back), weight - front_weight, 0)
        colors = layers.cut(0, 0, 3) * front_weight + layers.cut(0, 3, 6) * back_weight
        share, moment = front_weight + back_weight, front_weight * front + back_weight * back
        if alpha is None:
            alpha, depth, color = share, moment, colors
        else:
            alpha, depth, color = alpha + share, depth + moment, color + colors
    assert alpha is not None
    return alpha, depth / alpha.graph.maximum(alpha, _EPSILON), color


def _trace(
    g: Graph,
    layers: GraphLayers,
    slabs: list[Value],
    tile: Value,
    pixels: Value,
    size: tuple[Value, Value],
    points: tuple[Value, Value],
) -> Value:
    """Return the sums over the rays of sorted pixels, (N, _GROUPS * _NUMBERS)."""
    height, width = size
    count = pixels.size(0)
    us, vs = points
    flat = [x.reshape(-1, 1) for x in (*layers.defocus, layers.coverage)]
    table = g.concat([*layers.colors, *flat], 1)
    last_x, last_y = (width - 1).astype(np.float32), (height - 1).astype(np.float32)

    def block(iteration: Value) -> tuple[list[Value], list[Value]]:
        first = iteration.reshape(1) * _BLOCK_PIXELS
        own = pixels.take(g.minimum(g.count_up(g.sizes(_BLOCK_PIXELS)) + first, count - 1))
        row, column = own // width, own % width
        x, y = column.astype(np.float32), row.astype(np.float32)
        first_sample = (row % 3 * 3 + column % 3) * _SAMPLES
        own_tile = tile.take(own)
        own_slabs = [table.take(own_tile, axis=1) for table in slabs]
        used = (own_slabs[2] > -1e8).astype(np.int64).sum(0).max()

        def cells(axis: Value, last: Value) -> Value:
            return axis.clip(0.0, last).astype(np.int64)

        def defocus_at(column: Value, row: Value) -> Sequence[Value]:
            at = cells(g.round(row), last_y) * width + cells(g.round(column), last_x)
            return [defocus.take(at) for defocus in layers.defocus]

        def corners_at(column: Value, row: Value) -> Iterator[tuple[Value, Value]]:
            left, top = g.floor(column), g.floor(row)
            across, down = column - left, row - top
            columns = [(1 - across, cells(left, last_x)), (across, cells(left + 1, last_x))]
            for top_weight, line in ((1 - down, top), (down, top + 1)):
                start = cells(line, last_y) * width
                for weight, at in columns:
                    yield top_weight * weight, table.take(start + at).transpose(1, 0)

        def sample(number: Value, *sums: Value) -> tuple[list[Value], list[Value]]:
            at = first_sample + number
            u, v = us.take(at), vs.take(at)

            def visit(k: Value, transmitted: Value, *sums: Value) -> tuple[list[Value], list[Value]]:
                slab = Slab(*(table.take(k) for table in own_slabs))
                s = find_surface(defocus_at, (x, y), (u, v), slab)
                alpha, depth, color = _surface_at(corners_at(x - s * u, y - s * v), slab)
                weight = transmitted * alpha
                radius = abs(depth)
                steepness = weight / g.maximum(radius, _SHARP_RADIUS_PX)
                shown = g.concat([color * transmitted, weight.reshape(1, -1), steepness.reshape(1, -1)])
                is_blurred, is_front = radius >= _SHARP_RADIUS_PX, depth > 0
                groups = (is_blurred & is_front, ~is_blurred, is_blurred & ~is_front)
                masks = [mask.astype(np.float32) for mask in groups]
                added = [total + shown * mask for total, mask in zip(sums, masks, strict=True)]
                return [transmitted * (1 - alpha), *added], []

            return g.loop(visit, [x * 0 + 1, *sums], times=used)[1:], []

        start = [g.zeros(np.float32, _NUMBERS, _BLOCK_PIXELS) for _ in range(_GROUPS)]
        sums = g.loop(sample, start, times=g.sizes(_SAMPLES))
        return [], [g.concat(sums).transpose(1, 0)]

    traced = g.loop(block, [], times=(count + _BLOCK_PIXELS - 1) // _BLOCK_PIXELS)[0]
    return traced.reshape(-1, _GROUPS * _NUMBERS).cut(0, 0, count)


def _line_sums(g: Graph, sums: Value, reach: int, axis: int) -> Value:
    """Return the sums over ``2 reach + 1`` pixels along an axis, by doubling; ``reach`` is a power of two."""
    length, side = sums.size(axis), 2 * reach
    margin = np.zeros((2, 3), np.int64)
    margin[:, axis] = reach
    padded = g.op("Pad", sums, g.constant(margin.ravel()), g.constant(0, np.float32))
    total, count = padded, 1
    while count < side:
        rest = total.size(axis) - count
        total = total.cut(axis, 0, rest) + total.cut(axis, count, rest + count)
        count *= 2
    return total.cut(axis, 0, length) + padded.cut(axis, side, length + side)


def _average(g: Graph, windows: list[Value], group: int) -> Value:
    """Return the widest window that the discs of a group allow, (N, H, W).

    Args:
        g: Open graph.
        windows: Means over windows of growing size, (N, H, W).
        group: Number of the group, whose weight and weight over radius follow three colours.
    """
    at = group * _NUMBERS + 3

    def reach(window: Value) -> Value:
        ratio = window.cut(0, at, at + 1) / g.maximum(window.cut(0, at + 1, at + 2), _EPSILON)
        return (ratio * _REACH_BY_RADIUS).clip(1.0, float(_REACHES_PX[-1]))

    result, allowed = windows[0], windows[0].cut(0, 0, 1) * 0 + 1
    for last, end, window in zip(_REACHES_PX, _REACHES_PX[1:], windows[1:], strict=False):
        within = g.minimum(reach(result), reach(window))
        step = ((within - last) / (end - last)).clip(0.0, 1.0) * allowed
        allowed = allowed * (step >= 1).astype(np.float32)
        result = result + (window - result) * step
    return result


def _average_windows(g: Graph, sums: Value) -> Value:
    """Return the picture (3, H, W) of sums (_GROUPS * _NUMBERS, H, W), as in ``torch.window_means``."""
    windows = []
    for reach in _REACHES_PX:
        window = _line_sums(g, _line_sums(g, sums, reach, 2), reach, 1)
        weight = sum((window.cut(0, i, i + 1) for i in (8, 13)), window.cut(0, 3, 4))
        windows.append(window / g.maximum(weight, _EPSILON))
    front, back = _average(g, windows, 0), _average(g, [window.cut(0, 10, 15) for window in windows], 0)
    back_color = back.cut(0, 0, 3) / g.maximum(back.cut(0, 3, 4), _EPSILON)
    own = sums.cut(0, 8, 9) + sums.cut(0, 13, 14)
    rest = (sums.cut(0, 5, 8) + sums.cut(0, 13, 14) * back_color) / g.maximum(own, _EPSILON)
    around = front.cut(0, 8, 9) + front.cut(0, 13, 14)
    rest_around = (front.cut(0, 5, 8) + front.cut(0, 10, 13)) / g.maximum(around, _EPSILON)
    rest = g.where(own > _EPSILON, rest, rest_around)
    return front.cut(0, 0, 3) + (1 - front.cut(0, 3, 4)) * rest


def render_rays(g: Graph, layers: GraphLayers, error_map: Value, polygon: Polygon | None = None) -> Value:
    """Return the rays' picture (3, H, W) where the error map (H, W) is above 0, else 0.

    Args:
        g: Open graph.
        layers: From :func:`bokehnet.onnx_file.occlusion.layers.split_layers`.
        error_map: Weight of the rays over the scatter, (H, W).
        polygon: Aperture in place of a disc, if it exists.
    """
    u, v = _points()
    points = (g.constant(u), g.constant(v)) if polygon is None else polygon.samples(u, v)
    height, width = error_map.size(0), error_map.size(1)
    slabs, tile_columns = _find_slabs(g, layers, height, width)
    rows, columns = (g.count_up(side) // TILE for side in (height, width))
    tile = (rows.reshape(-1, 1) * tile_columns + columns.reshape(1, -1)).reshape(-1)
    pixels = g.op("NonZero", error_map.reshape(-1), dtype=np.int64).reshape(-1)
    used = (slabs[2] > -1e8).astype(np.int64).sum(0).take(tile.take(pixels))
    keys, _ = g.sorted(used * 2**40 + (pixels * -1 + 2**39))  # most slabs first, then in picture order
    pixels = (keys % 2**40 - 2**39) * -1
    traced = _trace(g, layers, slabs, tile, pixels, (height, width), points)
    sums = g.zeros(np.float32, height * width, _GROUPS * _NUMBERS)
    sums = g.op("ScatterND", sums, pixels.reshape(-1, 1), traced)
    return _average_windows(g, sums.transpose(1, 0).reshape(_GROUPS * _NUMBERS, height, width))
