"""Scatter as ONNX operators: ``classical.scatter.pyramid_levels`` and ``pyramid_merging`` without numba.

Large discs are scattered on pictures of half, a quarter, ... of the size; the selection of pixels is that
of :mod:`bokehnet.classical.scatter.pyramid_merging`. In addition, discs beyond the table always move, also
those of bright lights and of pixels at jumps, so that no loop grows with the largest blur.

The continuation beyond the border is that of :mod:`bokehnet.arrays.beyond_border`.
"""

import numpy as np

from bokehnet.arrays.beyond_border import COMPARED_PX, LAMP_RATIOS, LIGHT_FLOOR, LINE_RATIOS
from bokehnet.classical.scatter.disc_scatter import LARGEST_RADIUS
from bokehnet.classical.scatter.pyramid_levels import CONTRAST, DISC, TOLERANCE
from bokehnet.classical.scatter.pyramid_merging import TILE
from bokehnet.classical.scatter_renderer import MAX_CONTINUATION
from bokehnet.onnx_file.builder import END, Graph, Value
from bokehnet.onnx_file.pictures import double, pad_to_multiple, repeat
from bokehnet.onnx_file.polygon import Polygon
from bokehnet.onnx_file.spread import CHANNELS, TABLE_RADIUS, spread_discs, spread_polygons

__all__ = ["scatter", "scatter_beyond"]


def _block_parts(x: Value, axis: int) -> list[Value]:
    """Return the four pixels of every 2x2 block, each (..., H/2, W/2); H is at ``axis``."""
    return [x.cut(axis, row, END, 2).cut(axis + 1, column, END, 2) for row in (0, 1) for column in (0, 1)]


def _block_sum(x: Value, axis: int) -> Value:
    a, b, c, d = _block_parts(x, axis)
    return a + b + c + d


def _is_mergeable(g: Graph, defocus: Value) -> Value:
    """Return the mask of blocks whose four discs are large and differ little, (H/2, W/2)."""
    a, b, c, d = _block_parts(defocus, 0)
    low, high = g.op("Min", a, b, c, d), g.op("Max", a, b, c, d)
    smallest = g.maximum(low, -high)
    return (smallest > DISC.merge_above) & (high - low <= smallest * TOLERANCE)


def _outshines(g: Graph, values: Value, height: Value, width: Value) -> Value:
    """Return the mask of blocks with a pixel above ``CONTRAST`` times the mean of its tile, (H/2, W/2).

    ``values`` (4, H, W) are 0 beyond ``height`` and ``width``, H and W multiples of the tile.
    """
    half = TILE // 2
    rows, columns = values.size(1) // TILE, values.size(2) // TILE
    sums = abs(values).reshape(CHANNELS, rows, TILE, columns, TILE).sum(2, 4)
    inside = [
        g.minimum(size - g.count_up(count) * TILE, TILE).astype(np.float32)
        for size, count in ((height, rows), (width, columns))
    ]
    mean = sums / (inside[0].reshape(-1, 1) * inside[1])
    brightest = g.op("Max", *_block_parts(abs(values), 1)).reshape(CHANNELS, rows, half, columns, half)
    above = brightest > mean.reshape(CHANNELS, rows, 1, columns, 1) * CONTRAST
    return (above.astype(np.float32).max(0) > 0).reshape(rows * half, columns * half)


def _merge(g: Graph, values: Value, defocus: Value) -> tuple[Value, Value, Value, Value]:
    """Move sources to the half-size picture.

    Args:
        g: Open graph.
        values: Values to spread, (4, H, W).
        defocus: Signed blur radius, (H, W).

    Returns:
        The remaining sources, same shapes, and the moved ones, (4, ceil H/2, ceil W/2) and (ceil H/2, ceil
        W/2); each is 0 where the other one has the source.
    """
    height, width = defocus.size(0), defocus.size(1)
    padded, padded_defocus = (pad_to_multiple(g, x, TILE, "constant") for x in (values, defocus))
    block = _is_mergeable(g, padded_defocus) & ~_outshines(g, padded, height, width)
    moved = (repeat(g, block) | (abs(padded_defocus) >= TABLE_RADIUS)).astype(np.float32)
    count = _block_sum(moved, 0)
    total = _block_sum(padded_defocus * moved, 0)
    magnitude = _block_sum(abs(padded_defocus) * moved, 0) / g.maximum(count, 1)
    smaller = g.op("Sqrt", g.maximum(magnitude * magnitude - DISC.excess, 0)) * 0.5
    coarse_defocus = g.where(total < 0, -smaller, smaller)
    half_height, half_width = (height + 1) // 2, (width + 1) // 2
    kept = (1 - moved).cut(0, 0, height).cut(1, 0, width)
    return (
        values * kept,
        defocus * kept,
        (_block_sum(padded * moved, 1) * 0.25).cut(1, 0, half_height).cut(2, 0, half_width),
        coarse_defocus.cut(0, 0, half_height).cut(1, 0, half_width),
    )


def _spread(g: Graph, values: Value, defocus: Value, polygon: Polygon | None = None) -> Value:
    """Spread (4, H, W) over discs or polygons of any size; arguments and result as in ``spread_discs``."""

    def spread(values: Value, defocus: Value) -> Value:
        if polygon is None:
            return spread_discs(g, values, defocus)
        return g.branch(
            polygon.exists,
            lambda: spread_polygons(g, polygon, values, defocus),
            lambda: spread_discs(g, values, defocus),
        )

    def descend(
        _: Value, __: Value, values: Value, defocus: Value, levels: Value
    ) -> tuple[list[Value], list[Value]]:
        values, defocus, coarse, coarse_defocus = _merge(g, values, defocus)
        levels = g.append(levels, spread(values, defocus))
        return [abs(coarse_defocus).max() > 0, coarse, coarse_defocus, levels], []

    start = [g.constant([True]), values, defocus, g.empty_sequence()]
    levels = g.loop(descend, start, while_true=True)[-1]
    last = g.op("SequenceLength", levels, dtype=np.int64) - 1

    def climb(iteration: Value, sums: Value) -> tuple[list[Value], list[Value]]:
        finer = g.at(levels, last - 1 - iteration)
        doubled = double(g, sums).cut(1, 0, finer.size(1)).cut(2, 0, finer.size(2))
        return [finer + doubled], []

    return g.loop(climb, [g.at(levels, last)], times=last.reshape(1))[0]


def scatter(g: Graph, image: Value, defocus: Value, polygon: Polygon | None = None) -> Value:
    """Render bokeh by scattering, as :func:`bokehnet.classical.scatter_renderer.scatter_inside` with a disc.

    Args:
        g: Open graph.
        image: Scene-linear picture, not negative, (3, H, W), float32.
        defocus: Signed blur radius in pixels, (H, W), float32.
        polygon: Aperture in place of a disc, if it exists.

    Returns:
        Picture (3, H, W).
    """
    ones = g.op("Expand", g.constant(1, np.float32), g.sizes(1, defocus.size(0), defocus.size(1)))
    clipped = g.minimum(g.maximum(defocus, -LARGEST_RADIUS), LARGEST_RADIUS)
    sums = _spread(g, g.concat([image, ones]), clipped, polygon)
    weight = sums.cut(0, 3, 4)
    return g.where(weight > 0, sums.cut(0, 0, 3) / weight, image)


def scatter_beyond(g: Graph, image: Value, defocus: Value, polygon: Polygon | None = None) -> Value:
    """Scatter a picture that continues beyond its border, as the engines do; arguments as for ``scatter``."""
    height, width = defocus.size(0), defocus.size(1)
    shorter = g.minimum(height, width).astype(np.float32)
    limit = g.op("Ceil", shorter * MAX_CONTINUATION)
    reach = g.minimum(g.op("Ceil", abs(defocus).max()), limit).astype(np.int64)
    radii = g.op("Pad", defocus, g.concat([reach, reach, reach, reach]), mode="edge")
    bokeh = scatter(g, _beyond_border(g, image, reach), radii, polygon)
    return bokeh.cut(1, reach, reach + height).cut(2, reach, reach + width)


def _median(g: Graph, values: Value, axis: int) -> Value:
    """Return the median along an axis, which is kept with length 1."""
    count = values.size(axis)
    ordered, _ = g.ops("TopK", values, count, dtypes=[values.dtype, np.int64], axis=axis)
    lower, upper = (count - 1) // 2, count // 2
    return (ordered.cut(axis, lower, lower + 1) + ordered.cut(axis, upper, upper + 1)) * 0.5


def _weight(ratio: Value, ends: tuple[float, float]) -> Value:
    """Return 0 up to the first end, 1 from the second on, and linear values between."""
    low, high = ends
    return ((ratio - low) / (high - low)).clip(0.0, 1.0)


def _continuation(g: Graph, rows: Value, count: Value) -> Value:
    """Return ``count`` rows beyond the first of ``rows`` (3, H, W), from the border outwards."""
    nearest = rows.cut(1, 0, COMPARED_PX)
    light = nearest.mean(0) + LIGHT_FLOOR
    ratio = light.cut(0, 0, 1) / _median(g, light, 0)
    of_side = _median(g, ratio, 1)
    of_side = g.maximum(of_side, 1 / of_side)
    weight = g.maximum(_weight(ratio, LAMP_RATIOS), _weight(of_side, LINE_RATIOS))
    number, compared = g.count_up(count), nearest.size(1)
    mirrored = nearest.take(g.minimum(number, compared - 1), axis=1)
    is_mirrored = (number < compared // 2 + 1).reshape(-1, 1)
    other = g.where(is_mirrored, mirrored, _median(g, nearest, 1))
    return rows.cut(1, 0, 1) * (1 - weight) + other * weight


def _reversed_rows(g: Graph, rows: Value) -> Value:
    """Return (3, H, W) upside down; by indices, because WebGPU drops the last row of a slice of step -1."""
    return rows.take(rows.size(1) - 1 - g.count_up(rows.size(1)), axis=1)


def _with_rows(g: Graph, picture: Value, count: Value) -> Value:
    """Return a picture (3, H, W) with ``count`` rows above and below."""
    above = _continuation(g, picture, count)
    below = _continuation(g, _reversed_rows(g, picture), count)
    return g.concat([_reversed_rows(g, above), picture, below], axis=1)


def _beyond_border(g: Graph, picture: Value, reach: Value) -> Value:
    """Return a picture (3, H, W) with ``reach`` more pixels, shape (1,), on every side."""
    wider = _with_rows(g, picture.transpose(0, 2, 1), reach).transpose(0, 2, 1)
    return _with_rows(g, wider, reach)
