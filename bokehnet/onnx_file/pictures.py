"""Resizing of pictures as ONNX operators, as in :mod:`bokehnet.arrays.pyramid`, and extremes of windows.

All are (..., H, W).
"""

import numpy as np

from bokehnet.onnx_file.builder import END, Graph, Value

__all__ = ["double", "local_extremes", "pad_to_multiple", "repeat", "shrink"]


def pad_to_multiple(g: Graph, x: Value, multiple: Value | int, mode: str = "edge") -> Value:
    """Add rows and columns at the end until both are multiples of ``multiple``.

    Args:
        g: Open graph.
        x: (..., H, W).
        multiple: A number, or a size.
        mode: "edge" repeats the last row and column, "constant" adds zeros.
    """
    multiple = g.sizes(multiple)
    if mode == "edge":  # not Pad, which onnxruntime-web 1.30 computes wrongly with WebGPU
        for axis in (-2, -1):
            side = g.op("Shape", x, dtype=np.int64).cut(0, axis, END if axis == -1 else -1)
            length = (side + multiple - 1) // multiple * multiple
            x = x.take(g.minimum(g.count_up(length), side - 1), axis)
        return x
    shape = g.op("Shape", x, dtype=np.int64)
    sides = shape.cut(0, -2, END)
    missing = (multiple - sides % multiple) % multiple
    return g.op("Pad", x, g.concat([g.constant([0, 0], np.int64), missing]), g.none(), g.sizes(-2, -1))


def double(g: Graph, x: Value) -> Value:
    """Double by bilinear interpolation, (C, H, W) to (C, 2H, 2W); the border is repeated."""
    channels, height, width = x.size(0), x.size(1), x.size(2)
    scales = g.constant([1, 1, 2, 2], np.float32)
    doubled = g.op("Resize", x.reshape(1, channels, height, width), g.none(), scales, mode="linear")
    return doubled.reshape(channels, height * 2, width * 2)


def local_extremes(g: Graph, x: Value, radius: int) -> tuple[Value, Value]:
    """Return the smallest and the largest value of the square window around each pixel, (H, W)."""
    height, width = x.size(0), x.size(1)
    batch, side = x.reshape(1, 1, height, width), 2 * radius + 1
    window = {"kernel_shape": [side, side], "pads": [radius] * 4}
    low = -g.op("MaxPool", -batch, **window).reshape(height, width)
    return low, g.op("MaxPool", batch, **window).reshape(height, width)


def repeat(g: Graph, x: Value) -> Value:
    """Repeat every pixel twice along both axes, (H, W) to (2H, 2W)."""
    height, width = x.size(0), x.size(1)
    twice = g.op("Expand", x.reshape(height, 1, width, 1), g.sizes(1, 2, 1, 2))
    return twice.reshape(height * 2, width * 2)


def shrink(x: Value, factor: Value) -> Value:
    """Return the mean of every block of ``factor`` x ``factor`` pixels, (C, H, W), sides multiples."""
    channels, height, width = x.size(0), x.size(1) // factor, x.size(2) // factor
    return x.reshape(channels, height, factor, width, factor).mean(2, 4)
