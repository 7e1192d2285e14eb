"""Spreading over discs as ONNX operators: ``classical.scatter.disc_scatter`` with arrays for loops.

The picture is worked in blocks of source rows, from the top down. A canvas holds a block and what its
discs reach above and below; the ends of all discs are added to it by ``ScatterElements``, a few ends of every
disc at a time, those with the most ends first in line. The uppermost rows, which no later block can
reach, leave the canvas as running sums. Memory beyond the picture is that of a block.

``ScatterND`` would be faster, but in ONNX Runtime (1.31) several threads add at once, and where an index
repeats some of it is lost.
"""

from functools import cache
from itertools import pairwise

import numpy as np

from bokehnet.classical.scatter.disc_table import SMALLEST_RADIUS, disc_table, list_row
from bokehnet.onnx_file.builder import END, Graph, Value

__all__ = ["CHANNELS", "TABLE_RADIUS", "spread_discs"]

CHANNELS = 4

# Discs up to this radius are tabulated, pixels; those that the package lists one by one, in steps of half a
# pixel.
TABLE_RADIUS = 128.0
_LARGE_STEP = 0.5

# Ends of a disc that are added in one go.
_PACK = 8

# Fewest source rows of a block; it has at least as many as its discs reach up and down, so that the
# canvas, of which every turn makes a copy, is at most twice as large.
_BLOCK_ROWS = 64

# How much farther than its radius a disc of the table can reach, as in
# ``bokehnet.classical.scatter.disc_scatter``.
_MARGIN = 1.5


@cache
def _radii() -> np.ndarray:
    """Radii of the table: those of the package's, then equal steps up to ``TABLE_RADIUS``."""
    small = disc_table().radii
    return np.append(small, np.arange(small[-1] + _LARGE_STEP, TABLE_RADIUS + _LARGE_STEP, _LARGE_STEP))


def _ends(radius: float) -> np.ndarray:
    """Weights of the ends of a disc by row and column, see :mod:`bokehnet.classical.scatter.disc_table`."""
    size = int(radius) + 3
    dense = np.zeros((size, size))
    places, weights = np.empty((2 * size, 2), np.int32), np.empty((2 * size, 2))
    for k in range(size):
        count = list_row(radius, k, size, 0, places, weights)
        np.add.at(dense, tuple(places[:count].T), weights[:count, 0])
    return dense


def _packed_table() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """All discs in packs of ``_PACK`` ends, filled up with ends of weight 0.

    Returns:
        Packs (P, 4, _PACK), float32: row, column, weight at the step's start and its growth with the radius;
        the first pack of each step (n,) and the number of its packs (n,).
    """
    radii = _radii()
    packs, counts = [], []
    start = _ends(radii[0])
    for low, high in pairwise(radii):
        stop = _ends(high)
        start = np.pad(start, (0, len(stop) - len(start)))
        k, j = np.nonzero((start > 0) | (stop > 0))
        growth = (stop - start) / (high - low)
        ends = np.stack([k, j, start[k, j], growth[k, j]], 1)
        ends = np.pad(ends, ((0, -len(ends) % _PACK), (0, 0)))
        packs.append(ends.reshape(-1, _PACK, 4).transpose(0, 2, 1))
        counts.append(len(packs[-1]))
        start = stop
    return np.concatenate(packs).astype(np.float32), np.cumsum(counts) - counts, np.array(counts)


def _find_step(g: Graph, radius: Value) -> tuple[Value, Value]:
    """Step of the table for each radius (N,), and the way from its start in pixels."""
    radii = _radii()
    finest = np.diff(radii).min()  # all are multiples of it
    steps = np.searchsorted(radii, np.arange(0, radii[-1], finest), "right") - 1
    cell = (radius / finest).astype(np.int64)
    step = g.constant(np.maximum(steps, 0), np.int16).take(cell).astype(np.int64)
    return step, radius - g.constant(radii, np.float32).take(step)


def _add_discs(g: Graph, canvas: list[Value], values: Value, defocus: Value, reach: Value) -> list[Value]:
    """Add the ends of the discs of one block to the canvas.

    Args:
        g: The open graph.
        canvas: For each channel the differences along the rows, flat, (rows + 2 reach, W + 1).
        values: What each pixel spreads, (4, rows, W).
        defocus: Its radius, (rows, W).
        reach: Rows by which the canvas exceeds the block at its top.
    """
    packs, first, counts = (g.constant(x) for x in _packed_table())
    width = defocus.size(1)
    radii = abs(defocus.reshape(-1))
    found = g.op("NonZero", radii > SMALLEST_RADIUS, dtype=np.int64).reshape(-1)
    step, along = _find_step(g, radii.take(found))
    remaining, order = g.sorted(counts.take(step))
    found, pack, along = found.take(order), first.take(step).take(order), along.take(order)
    row, column = found // width, found % width
    centre = (row + reach) * (width + 1)
    colours = values.reshape(CHANNELS, -1).transpose(1, 0).take(found)

    def add(turn: Value, *canvas: Value) -> tuple[list[Value], list[Value]]:
        active = (remaining > turn).astype(np.int64).sum()

        def head(x: Value) -> Value:
            return x.cut(0, 0, active)

        def stand(x: Value) -> Value:  # beside the ends
            return head(x).reshape(-1, 1)

        ends = packs.take(head(pack) + turn)
        k, j, weight, growth = (ends.take(g.constant(i, np.int64), axis=1) for i in range(4))
        k, j = k.astype(np.int64) * (width + 1), j.astype(np.int64)
        weight = weight + stand(along) * growth
        left = g.maximum(stand(column) - j, 0)
        right = g.minimum(stand(column) + j + 1, width)
        upper, lower = stand(centre) - k, stand(centre) + k
        starts = [(line + left).reshape(-1) for line in (upper, lower)]
        stops = [(line + right).reshape(-1) for line in (upper, lower)]
        head_colours = head(colours)
        result = []
        for c in range(CHANNELS):
            light = (weight * head_colours.cut(1, c, c + 1)).reshape(-1).astype(np.float64)
            sums = canvas[c]
            for places, strength in ((starts, light), (stops, -light)):
                for place in places:
                    sums = g.op("ScatterElements", sums, place, strength, axis=0, reduction="add")
            result.append(sums)
        return result, []

    most = g.concat([remaining, g.constant([0], np.int64)]).max()
    return g.loop(add, canvas, times=most)


def spread_discs(g: Graph, values: Value, defocus: Value) -> Value:
    """Scatter every pixel over its disc and add up, as ``bokehnet.classical.scatter.disc_scatter`` does.

    Args:
        g: The open graph.
        values: What each pixel spreads, (4, H, W), float32, not negative.
        defocus: Blur radius in pixels, (H, W), float32; its magnitude is below ``TABLE_RADIUS``.

    Returns:
        Sums (4, H, W), float32.
    """
    height, width = defocus.size(0), defocus.size(1)
    reach = (abs(defocus).max() + _MARGIN).astype(np.int64)
    rows = g.maximum(reach * 2, _BLOCK_ROWS)
    leaving = rows * (width + 1)
    canvas = [g.zeros(np.float64, (rows + reach * 2) * (width + 1)) for _ in range(CHANNELS)]

    def band(turn: Value, *canvas: Value) -> tuple[list[Value], list[Value]]:
        top, bottom = rows * turn, rows * (turn + 1)
        sums = _add_discs(g, list(canvas), values.cut(1, top, bottom), defocus.cut(0, top, bottom), reach)
        done = [g.op("CumSum", x.cut(0, 0, leaving).reshape(1, rows, width + 1), g.constant(2)) for x in sums]
        kept = [g.concat([x.cut(0, leaving, END), g.zeros(np.float64, leaving)]) for x in sums]
        return kept, [g.concat(done).cut(2, 0, width).astype(np.float32)]

    bands = (height + reach + rows - 1) // rows
    collected = g.loop(band, canvas, times=bands)[-1]
    sums = collected.transpose(1, 0, 2, 3).reshape(CHANNELS, -1, width).cut(1, reach, reach + height)
    sharp = g.where(abs(defocus) <= SMALLEST_RADIUS, values, 0)
    return g.maximum(sums, 0) + sharp
