"""Depth repair in one ONNX file, in a simple form: soft depth edges become sharp at edges of the picture.

Soft edges are those of blurred, enlarged and compressed maps. Their pixels, their sharpening and the weighted
medians are those of :mod:`bokehnet.depth_repair.stages.sharpen` and
:func:`bokehnet.depth_repair.stages.deblur.snap_soft_edges`. A map without a large majority of soft edges is
returned as it is. The file neither moves edges nor restores thin structures.
"""

from itertools import pairwise
from pathlib import Path

import numpy as np
import onnx

from bokehnet.depth_repair.config import (
    MAX_SLOPE_CHANGE,
    MEDIAN_PASSES,
    MIN_DISTANCE_FROM_EXTREMES,
    MIN_EDGE_HEIGHT,
    NEAR_PX,
    SHARPENING_RADII_PX,
    SLOPE_STRIDE_PX,
)
from bokehnet.depth_repair.stages.deblur import snap_soft_edges
from bokehnet.depth_repair.stages.sharpen import repair_soft_edges, soft_mask
from bokehnet.errors import ModelFileError
from bokehnet.io.files.atomic import write_bytes
from bokehnet.onnx_file.builder import Graph, Value
from bokehnet.onnx_file.occlusion.unmixing import write_rows
from bokehnet.onnx_file.pictures import local_extremes
from bokehnet.onnx_session import OnnxSession
from bokehnet.optics.encoding import encode
from bokehnet.version import __version__

__all__ = ["REPAIR_PARITY", "build_repair", "export_repair"]

# Minimum fraction of pixels that the file repairs like the stages of the package, to 1 % of the range. The
# package finds medians in bins, the file exactly.
REPAIR_PARITY = 0.995

# Fraction of soft edges from which a map is repaired. Maps of plane sweeps have up to 0.47, and would lose
# 2 dB at edges, those of networks up to 0.80: the package judges whether their edges are accurate, the file
# does not.
_MIN_SOFTNESS = 0.8

# Pixels for which weighted medians are computed at once: a pixel needs about 5 kB.
_CHUNK_PIXELS = 1 << 14


def _reflected(g: Graph, values: Value, axis: int, offset: int) -> Value:
    """Return the values ``offset`` pixels away along an axis; odd reflection continues slopes at borders."""
    last = values.size(axis) - 1
    at = g.count_up(values.size(axis)) + offset
    inside = g.minimum(g.maximum(g.where(at > last, last * 2 - at, g.op("Abs", at)), 0), last)
    shape = (-1, 1) if axis == 0 else (1, -1)
    end = values.take(g.minimum(g.maximum(at, 0), last), axis)
    moved = values.take(inside, axis)
    return g.where(((at >= 0) & (at <= last)).reshape(*shape), moved, end * 2 - moved)


def _on_slope(g: Graph, values: Value) -> Value:
    """Return which pixels lie on slopes, (H, W) bool; see the slope test of the package."""
    change = rise = values * 0
    for axis in (0, 1):
        line = [_reflected(g, values, axis, step * SLOPE_STRIDE_PX) for step in (-3, -1, 1, 3)]
        before, here, after = (b - a for a, b in pairwise(line))
        change = change + abs(here - before) + abs(here - after)
        rise = rise + abs(here)
    return change < rise * MAX_SLOPE_CHANGE


def _weighted_medians(
    g: Graph, colors: Value, values: Value, places: Value, radius: int, sigma: float, min_height: Value
) -> Value:
    """Return the map (H, W) with weighted medians at ``places`` (N,); see the filter of the package."""
    height, width = values.size(0), values.size(1)
    flat, flat_colors = values.reshape(-1), colors.reshape(-1, 3)
    down, right = (axis.reshape(1, -1) for axis in np.mgrid[-radius : radius + 1, -radius : radius + 1])
    count = g.sizes(down.size)

    def chunk(turn: Value, result: Value) -> tuple[list[Value], list[Value]]:
        start = turn.reshape(1) * _CHUNK_PIXELS
        index = places.cut(0, start, start + _CHUNK_PIXELS)
        rows, columns = index.reshape(-1, 1) // width + down, index.reshape(-1, 1) % width + right
        is_inside = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
        rows, columns = (
            g.minimum(g.maximum(x, 0), side - 1) for x, side in ((rows, height), (columns, width))
        )
        window = rows * width + columns
        own = flat.take(index)
        depths = g.where(is_inside, flat.take(window), own.reshape(-1, 1))
        difference = flat_colors.take(window) - flat_colors.take(index).reshape(-1, 1, 3)
        weights = g.op("Exp", (difference * difference).sum(2) * (-0.5 / sigma**2))
        weights = weights * is_inside.astype(np.float32)
        ascending, order = g.ops("TopK", depths, count, dtypes=[np.float32, np.int64], axis=1, largest=0)
        sums = g.op("CumSum", g.op("GatherElements", weights, order, axis=1), g.constant(1, np.int64))
        is_reached = sums >= weights.sum(1, keep=True) * 0.5
        middle = g.op("ArgMax", is_reached.astype(np.float32), dtype=np.int64, axis=1, keepdims=1)
        median = g.op("GatherElements", ascending, middle, axis=1).reshape(-1)
        is_edge = depths.max(1) - depths.min(1) > min_height
        return [write_rows(g, result, index, g.where(is_edge, median, own))], []

    turns = (places.size(0) + (_CHUNK_PIXELS - 1)) // _CHUNK_PIXELS
    return g.loop(chunk, [flat], times=turns)[0].reshape(height, width)


def _sharp(g: Graph, values: Value, on_slope: Value, min_height: Value) -> Value:
    """Return the map with soft edges made sharp at the middle between both sides."""
    sharp = values
    for radius in SHARPENING_RADII_PX:
        low, high = local_extremes(g, sharp, radius)
        nearer = g.where(high - sharp < sharp - low, high, low)
        changed = (high - low > min_height) & ~nearer.equals(sharp) & ~on_slope
        sharp = g.where(changed, nearer, sharp)
    return sharp


def build_repair() -> onnx.ModelProto:
    """Return the model: ``image`` (H, W, 3), scene-linear, and ``disparity`` (H, W) to ``repaired`` (H, W).

    All are float32; disparity has any unit. Lengths of the repair are pixels: maps of more than about two
    megapixels are repaired at a smaller size.

    Source:
        Kramer and Bruckner, "Iterations of a non-linear transformation for enhancement of digital images",
        Pattern Recognition 1975; Ma, He, Wei, Sun and Wu, "Constant time weighted median filtering for stereo
        matching and beyond", ICCV 2013.
    """
    g = Graph()
    image = g.maximum(g.input("image", np.float32, ["height", "width", 3]), 0)
    disparity = g.input("disparity", np.float32, ["height", "width"])
    span = disparity.max() - disparity.min()
    min_height = span * MIN_EDGE_HEIGHT
    low, high = local_extremes(g, disparity, NEAR_PX)
    on_slope, step = _on_slope(g, disparity), high - low
    is_edge = (step > min_height) & ~on_slope
    nearer = g.minimum(high - disparity, disparity - low)
    is_soft = is_edge & (nearer > step * MIN_DISTANCE_FROM_EXTREMES)
    weights = g.where(is_edge, step * step, 0.0)
    softness = g.where(is_soft, weights, 0.0).sum() / g.maximum(weights.sum(), 1e-30)

    def repaired() -> Value:
        values = _sharp(g, disparity, on_slope, min_height)
        near = local_extremes(g, is_soft.astype(np.float32), NEAR_PX)[1] > 0
        places = g.op("NonZero", near.reshape(-1), dtype=np.int64).reshape(-1)
        colors = encode(image)
        for radius, sigma in MEDIAN_PASSES:
            values = _weighted_medians(g, colors, values, places, radius, sigma, min_height)
        return values

    result = g.branch(softness > _MIN_SOFTNESS, repaired, lambda: disparity)
    about = {"producer": f"bokehnet {__version__}", "license": "Apache-2.0", "light": "scene-linear"}
    model = g.model({"repaired": (result, ["height", "width"])}, **about)
    onnx.checker.check_model(model, full_check=True)
    return model


def _expected(image: np.ndarray, disparity: np.ndarray) -> np.ndarray:
    """Return what the stages of the package make of a soft map."""
    span = float(np.ptp(disparity))
    return snap_soft_edges(image, repair_soft_edges(disparity), soft_mask(disparity, span), span)


def _compare(model: bytes) -> float:
    """Return the fraction of pixels of a blurred map that a file's content repairs like the package."""
    y, x = np.mgrid[:150, :203].astype(np.float32)
    disc = np.hypot(y - 70, x - 90) < 45
    rng = np.random.default_rng(0)
    image = np.where(disc[..., None], (0.7, 0.3, 0.2), (0.1, 0.2, 0.4)) + rng.uniform(0, 0.02, (150, 203, 3))
    sharp = np.where(disc, 0.8, 0.2) + 0.1 * x / 203
    lines = np.stack([np.roll(sharp, (j, i), (0, 1)) for j in range(-3, 4) for i in range(-3, 4)])
    inputs = {"image": image.astype(np.float32), "disparity": lines.mean(0).astype(np.float32)}
    repaired = OnnxSession(model, options={"log_severity_level": 3}).run(inputs)[0]
    error = np.abs(repaired - _expected(**inputs))
    return float((error < 0.01 * np.ptp(inputs["disparity"])).mean())


def export_repair(path: Path) -> float:
    """Write the depth repair as one ONNX file, after a check that it repairs like the stages of the package.

    Args:
        path: Output file.

    Returns:
        Fraction of the pixels of a blurred map that agree to 1 % of the range.

    Raises:
        ModelFileError: Fewer agree than ``REPAIR_PARITY``, or the file cannot be written; an older one is
            kept.
    """
    content = build_repair().SerializeToString()
    agreement = _compare(content)
    if agreement < REPAIR_PARITY:
        raise ModelFileError(
            f"{path}: expected {REPAIR_PARITY:.1%} of the pixels to be repaired as by the package, found "
            f"{agreement:.1%}; not written"
        )
    write_bytes(path, content, error=ModelFileError)
    return agreement
