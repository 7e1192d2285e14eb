"""Where the scatter can be wrong, as ONNX operators: what ``geometric_error_map`` does."""

import numpy as np

from bokehnet.onnx_file.builder import Graph, Value

__all__ = ["geometric_error_map"]

# Half the width of the soft edge, pixels.
_SOFTNESS = 2

# Smallest span of the defocus that makes a boundary, pixels, and per pixel of the shorter side.
_SPAN, _SPAN_PER_PIXEL = 0.5, 1 / 1000

# Rows of every disc that are written in one go.
_ROWS = 4


def _boundaries(g: Graph, defocus: Value) -> Value:
    """Largest radius around each boundary pixel, 0 elsewhere, (H, W)."""
    height, width = defocus.size(0), defocus.size(1)
    batch = defocus.reshape(1, 1, height, width)
    window = {"kernel_shape": [3, 3], "pads": [1, 1, 1, 1]}
    high = g.op("MaxPool", batch, **window).reshape(height, width)
    low = -g.op("MaxPool", -batch, **window).reshape(height, width)
    shorter = g.minimum(height, width).astype(np.float32)
    threshold = g.maximum(shorter * _SPAN_PER_PIXEL, _SPAN)
    radius = g.maximum(g.maximum(abs(low), abs(high)), 1)
    return g.where(high - low > threshold, radius, 0)


def _cover_discs(g: Graph, reach: Value) -> Value:
    """Where one of the discs of radius ``reach`` (H, W) lies, bool (H, W); by differences along the rows."""
    height, width = reach.size(0), reach.size(1)
    stride = width + 1
    radii = reach.reshape(-1)
    found = g.op("NonZero", radii, dtype=np.int64).reshape(-1)
    radii, order = g.sorted(radii.take(found))
    found = found.take(order)
    row, column = found // width, found % width
    squares = radii.astype(np.float64) * radii.astype(np.float64)
    # One row above the picture and one below take what falls outside.
    counts = g.zeros(np.float32, (height + 2) * stride)

    def add(turn: Value, counts: Value) -> tuple[list[Value], list[Value]]:
        offsets = g.constant(np.arange(_ROWS)) + turn * _ROWS
        distance = offsets.astype(np.float64)
        active = (radii >= (turn * _ROWS).astype(np.float32)).astype(np.int64).sum()

        def head(x: Value) -> Value:
            return x.cut(0, 0, active).reshape(-1, 1)

        rest = head(squares) - distance * distance
        half = g.op("Sqrt", g.maximum(rest, 0)).astype(np.int64)
        left = g.maximum(head(column) - half, 0)
        right = g.minimum(head(column) + half + 1, width)
        weight = (rest >= 0).astype(np.float32).reshape(-1)
        upper = g.maximum(head(row) - offsets, -1) + 1
        lower = g.minimum(head(row) + offsets, height) + 1
        for line in (upper, lower):
            for places, strength in ((left, weight), (right, -weight)):
                place = (line * stride + places).reshape(-1)
                counts = g.op("ScatterElements", counts, place, strength, axis=0, reduction="add")
        return [counts], []

    most = g.concat([radii, g.constant([-1], np.float32)]).max()
    last = g.minimum(most, height.astype(np.float32)).astype(np.int64)
    turns = (last + _ROWS) // _ROWS
    counts = g.loop(add, [counts], times=g.where(most > 0, turns, 0))[0]
    rows = counts.reshape(height + 2, stride).cut(0, 1, height + 1)
    return g.op("CumSum", rows, g.constant(1)).cut(1, 0, width) > 0


def geometric_error_map(g: Graph, defocus: Value) -> Value:
    """Map (H, W) float32 in [0, 1] of a defocus map (H, W), as the function of this name in ``classical``."""
    height, width = defocus.size(0), defocus.size(1)
    reach = _boundaries(g, defocus)
    reach = g.where(reach > 0, reach + _SOFTNESS, 0)
    mask = _cover_discs(g, reach).astype(np.float32).reshape(1, 1, height, width)
    margin = g.constant([0, 0, *[_SOFTNESS] * 2] * 2, np.int64)
    padded = g.op("Pad", mask, margin, mode="edge")
    side = 2 * _SOFTNESS + 1
    return g.op("AveragePool", padded, kernel_shape=[side, side]).reshape(height, width)
