"""Continuation of a picture beyond its border as ONNX operators: ``bokehnet.arrays.beyond_border``."""

import numpy as np

from bokehnet.arrays.beyond_border import COMPARED_PX, LAMP_RATIOS, LIGHT_FLOOR, LINE_RATIOS
from bokehnet.onnx_file.builder import Graph, Value

__all__ = ["beyond_border"]


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


def beyond_border(g: Graph, picture: Value, reach: Value) -> Value:
    """Return a picture (3, H, W) with ``reach`` more pixels, shape (1,), on every side."""
    wider = _with_rows(g, picture.transpose(0, 2, 1), reach).transpose(0, 2, 1)
    return _with_rows(g, wider, reach)
