"""Spreading as ONNX operators: ``classical.scatter.disc_scatter`` with arrays instead of loops, and polygons.

The picture is processed in blocks of source rows, from the top down. A canvas contains a block and the reach
of its discs above and below; ``ScatterElements`` adds the ends of all discs to it, a few ends of every disc
at a time, discs with the most ends first. The uppermost rows, which no later block can reach, leave the
canvas as running sums. Memory beyond the picture is that of a block.

``ScatterND`` would be faster, but in ONNX Runtime (1.31) several threads add at the same time, and values are
lost where an index repeats.
"""

from collections.abc import Callable
from functools import cache

import numpy as np

from bokehnet.classical.scatter.disc_table import SMALLEST_RADIUS, disc_table, list_discs
from bokehnet.onnx_file.builder import END, Graph, Value
from bokehnet.onnx_file.polygon import Polygon

__all__ = ["CHANNELS", "TABLE_RADIUS", "spread_discs", "spread_polygons"]

CHANNELS = 4

# Largest tabulated radius, pixels; the step of discs that the package computes one by one is half a pixel.
TABLE_RADIUS = 128.0
_LARGE_STEP_PX = 0.5

# Ends of a disc that are added per iteration.
_PACK_SIZE = 8

# Minimum number of source rows of a block; a block has at least as many as its discs reach up and down, so
# that the canvas, which every iteration copies, is at most twice as large.
_BLOCK_ROWS = 64

# Maximum reach of a disc of the table beyond its radius, pixels, as in
# ``bokehnet.classical.scatter.disc_scatter``.
_MARGIN_PX = 1.5


@cache
def _radii() -> np.ndarray:
    """Return the radii of the table: those of the package's, then equal steps up to ``TABLE_RADIUS``."""
    small = disc_table().radii
    return np.append(
        small, np.arange(small[-1] + _LARGE_STEP_PX, TABLE_RADIUS + _LARGE_STEP_PX, _LARGE_STEP_PX)
    )


def _packed_table() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return all discs in packs of ``_PACK_SIZE`` ends, padded with ends of weight 0.

    Returns:
        Packs (P, 4, _PACK_SIZE), float32: row, column, weight at the step's start and its derivative by the
        radius; the first pack of each step (n,) and the number of its packs (n,).
    """
    table = list_discs(_radii())
    packs, counts = [], []
    for first in table.first:
        step = slice(first[0], first[-1])
        ends = np.concatenate([table.places[step], table.weights[step]], 1)
        ends = np.pad(ends, ((0, -len(ends) % _PACK_SIZE), (0, 0)))
        packs.append(ends.reshape(-1, _PACK_SIZE, 4).transpose(0, 2, 1))
        counts.append(len(packs[-1]))
    return np.concatenate(packs).astype(np.float32), np.cumsum(counts) - counts, np.array(counts)


def _find_step(g: Graph, radius: Value) -> tuple[Value, Value]:
    """Return the step of the table for each radius (N,), and the offset from its start in pixels."""
    radii = _radii()
    finest = np.diff(radii).min()  # all are multiples of it
    steps = np.searchsorted(radii, np.arange(0, radii[-1], finest), "right") - 1
    cell = (radius / finest).astype(np.int64)
    step = g.constant(np.maximum(steps, 0), np.int16).take(cell).astype(np.int64)
    return step, radius - g.constant(radii, np.float32).take(step)


def _add_discs(g: Graph, canvas: list[Value], values: Value, defocus: Value, reach: Value) -> list[Value]:
    """Add the ends of the discs of one block to the canvas.

    Args:
        g: Open graph.
        canvas: Per channel the differences along the rows, flat, (rows + 2 reach, W + 1).
        values: Values to spread, (4, rows, W).
        defocus: Blur radius, (rows, W).
        reach: Rows by which the canvas exceeds the block at its top.
    """
    packs, first, counts = (g.constant(x) for x in _packed_table())
    width = defocus.size(1)
    radii = abs(defocus.reshape(-1))
    indices = g.op("NonZero", radii > SMALLEST_RADIUS, dtype=np.int64).reshape(-1)
    step, along = _find_step(g, radii.take(indices))
    remaining, order = g.sorted(counts.take(step))
    indices, pack, along = indices.take(order), first.take(step).take(order), along.take(order)
    row, column = indices // width, indices % width
    centre = (row + reach) * (width + 1)
    colors = values.reshape(CHANNELS, -1).transpose(1, 0).take(indices)

    def add(iteration: Value, *canvas: Value) -> tuple[list[Value], list[Value]]:
        active = (remaining > iteration).astype(np.int64).sum()

        def head(x: Value) -> Value:
            return x.cut(0, 0, active)

        def column_of(x: Value) -> Value:  # broadcasts against the ends
            return head(x).reshape(-1, 1)

        ends = packs.take(head(pack) + iteration)
        k, j, weight, growth = (ends.take(g.constant(i, np.int64), axis=1) for i in range(4))
        k, j = k.astype(np.int64) * (width + 1), j.astype(np.int64)
        weight = weight + column_of(along) * growth
        left = g.maximum(column_of(column) - j, 0)
        right = g.minimum(column_of(column) + j + 1, width)
        upper, lower = column_of(centre) - k, column_of(centre) + k
        starts = [(line + left).reshape(-1) for line in (upper, lower)]
        stops = [(line + right).reshape(-1) for line in (upper, lower)]
        head_colors = head(colors)
        result = []
        for c in range(CHANNELS):
            light = (weight * head_colors.cut(1, c, c + 1)).reshape(-1).astype(np.float64)
            sums = canvas[c]
            for ends_at, strength in ((starts, light), (stops, -light)):
                for index in ends_at:
                    sums = g.op("ScatterElements", sums, index, strength, axis=0, reduction="add")
            result.append(sums)
        return result, []

    max_packs = g.concat([remaining, g.constant([0], np.int64)]).max()
    return g.loop(add, canvas, times=max_packs)


def _add_polygons(
    g: Graph, polygon: Polygon, canvas: list[Value], values: Value, defocus: Value, reach: Value
) -> list[Value]:
    """Add the ends of the polygons of one block, row by row; arguments as for ``_add_discs``."""
    width = defocus.size(1)
    flat = defocus.reshape(-1)
    spread = (abs(flat) > SMALLEST_RADIUS).astype(np.int64).sum(0, keep=True)
    size, indices = g.sorted(abs(flat), spread)
    radius = flat.take(indices)
    centre_row, centre_column = indices // width + reach, (indices % width).astype(np.float32) + 0.5
    colors = values.reshape(CHANNELS, -1).take(indices, axis=1) / (size * size * polygon.area)

    def add(iteration: Value, *canvas: Value) -> tuple[list[Value], list[Value]]:
        row = iteration.reshape(1) - reach
        active = (size + 0.5 > abs(row).astype(np.float32)).astype(np.int64).sum(0, keep=True)
        left, right, covered = polygon.mean_ends(radius.cut(0, 0, active), row)
        line = (centre_row.cut(0, 0, active) + row) * (width + 1)
        sums = list(canvas)
        for end, strength in ((left, covered), (right, -covered)):
            edge = g.minimum((centre_column.cut(0, 0, active) + end).clip(0.0), width.astype(np.float32))
            cell = g.minimum(g.floor(edge).astype(np.int64), width - 1)
            beyond = edge - cell.astype(np.float32)
            for index, share in ((line + cell, 1 - beyond), (line + cell + 1, beyond)):
                for c in range(CHANNELS):
                    light = colors.cut(0, c, c + 1).reshape(-1).cut(0, 0, active) * share * strength
                    sums[c] = g.op(
                        "ScatterElements", sums[c], index, light.astype(np.float64), axis=0, reduction="add"
                    )
        return sums, []

    return g.loop(add, canvas, times=reach * 2 + 1)


def spread_discs(g: Graph, values: Value, defocus: Value) -> Value:
    """Scatter every pixel over its disc and sum, as ``bokehnet.classical.scatter.disc_scatter``.

    Args:
        g: Open graph.
        values: Values to spread, (4, H, W), float32, not negative.
        defocus: Blur radius in pixels, (H, W), float32; its magnitude is below ``TABLE_RADIUS``.

    Returns:
        Sums (4, H, W), float32.
    """
    return _spread(g, values, defocus, _add_discs)


def spread_polygons(g: Graph, polygon: Polygon, values: Value, defocus: Value) -> Value:
    """Scatter every pixel over the polygon, mirrored for a negative radius; else as :func:`spread_discs`."""

    def add(g: Graph, canvas: list[Value], values: Value, defocus: Value, reach: Value) -> list[Value]:
        return _add_polygons(g, polygon, canvas, values, defocus, reach)

    return _spread(g, values, defocus, add)


# Adds the light of a block to the canvas; arguments and result as for ``_add_discs``.
_Add = Callable[[Graph, list[Value], Value, Value, Value], list[Value]]


def _spread(g: Graph, values: Value, defocus: Value, add: _Add) -> Value:
    """Return the sums of all blocks, (4, H, W), float32."""
    height, width = defocus.size(0), defocus.size(1)
    reach = (abs(defocus).max() + _MARGIN_PX).astype(np.int64)
    rows = g.maximum(reach * 2, _BLOCK_ROWS)
    leaving = rows * (width + 1)
    canvas = [g.zeros(np.float64, (rows + reach * 2) * (width + 1)) for _ in range(CHANNELS)]

    def band(iteration: Value, *canvas: Value) -> tuple[list[Value], list[Value]]:
        top, bottom = rows * iteration, rows * (iteration + 1)
        sums = add(g, list(canvas), values.cut(1, top, bottom), defocus.cut(0, top, bottom), reach)
        finished = [
            g.op("CumSum", x.cut(0, 0, leaving).reshape(1, rows, width + 1), g.constant(2)) for x in sums
        ]
        remaining = [g.concat([x.cut(0, leaving, END), g.zeros(np.float64, leaving)]) for x in sums]
        return remaining, [g.concat(finished).cut(2, 0, width).astype(np.float32)]

    bands = (height + reach + rows - 1) // rows
    collected = g.loop(band, canvas, times=bands)[-1]
    sums = collected.transpose(1, 0, 2, 3).reshape(CHANNELS, -1, width).cut(1, reach, reach + height)
    sharp = g.where(abs(defocus) <= SMALLEST_RADIUS, values, 0)
    return g.maximum(sums, 0) + sharp
