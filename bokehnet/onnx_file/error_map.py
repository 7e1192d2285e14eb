"""Error map of the scatter as ONNX operators: same result as ``geometric_error_map``."""

import numpy as np

from bokehnet.onnx_file.builder import Graph, Value
from bokehnet.onnx_file.pictures import local_extremes

__all__ = ["geometric_error_map"]

# Half-width of the soft edge, pixels.
_SOFTNESS = 2

# Minimum span of the defocus at a boundary, pixels, and per pixel of the shorter side.
_MIN_SPAN_PX, _SPAN_PER_PIXEL = 0.5, 1 / 1000

# Rows of every disc that are written per iteration.
_ROWS = 4


def _boundaries(g: Graph, defocus: Value) -> Value:
    """Return the largest radius around each boundary pixel, 0 elsewhere, (H, W)."""
    height, width = defocus.size(0), defocus.size(1)
    low, high = local_extremes(g, defocus, 1)
    shorter = g.minimum(height, width).astype(np.float32)
    threshold = g.maximum(shorter * _SPAN_PER_PIXEL, _MIN_SPAN_PX)
    radius = g.maximum(g.maximum(abs(low), abs(high)), 1)
    return g.where(high - low > threshold, radius, 0)


def _cover_discs(g: Graph, reach: Value) -> Value:
    """Return the mask of the discs of radius ``reach`` (H, W), bool (H, W); by differences along the rows."""
    height, width = reach.size(0), reach.size(1)
    stride = width + 1
    radii = reach.reshape(-1)
    indices = g.op("NonZero", radii, dtype=np.int64).reshape(-1)
    radii, order = g.sorted(radii.take(indices))
    indices = indices.take(order)
    row, column = indices // width, indices % width
    squares = radii.astype(np.float64) * radii.astype(np.float64)
    # One row above the picture and one below collect values outside the picture.
    counts = g.zeros(np.float32, (height + 2) * stride)

    def add(iteration: Value, counts: Value) -> tuple[list[Value], list[Value]]:
        offsets = g.constant(np.arange(_ROWS)) + iteration * _ROWS
        distance = offsets.astype(np.float64)
        active = (radii >= (iteration * _ROWS).astype(np.float32)).astype(np.int64).sum()

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
            for ends, strength in ((left, weight), (right, -weight)):
                index = (line * stride + ends).reshape(-1)
                counts = g.op("ScatterElements", counts, index, strength, axis=0, reduction="add")
        return [counts], []

    max_radius = g.concat([radii, g.constant([-1], np.float32)]).max()
    last = g.minimum(max_radius, height.astype(np.float32)).astype(np.int64)
    iterations = (last + _ROWS) // _ROWS
    counts = g.loop(add, [counts], times=g.where(max_radius > 0, iterations, 0))[0]
    rows = counts.reshape(height + 2, stride).cut(0, 1, height + 1)
    return g.op("CumSum", rows, g.constant(1)).cut(1, 0, width) > 0


def geometric_error_map(g: Graph, defocus: Value) -> Value:
    """Return the error map (H, W) float32 in [0, 1] of a defocus map (H, W), as in ``classical``."""
    height, width = defocus.size(0), defocus.size(1)
    reach = _boundaries(g, defocus)
    reach = g.where(reach > 0, reach + _SOFTNESS, 0)
    mask = _cover_discs(g, reach).astype(np.float32).reshape(1, 1, height, width)
    margin = g.constant([0, 0, *[_SOFTNESS] * 2] * 2, np.int64)
    padded = g.op("Pad", mask, margin, mode="edge")
    side = 2 * _SOFTNESS + 1
    return g.op("AveragePool", padded, kernel_shape=[side, side]).reshape(height, width)
