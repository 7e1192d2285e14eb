"""The baseline ``bokehme`` as ONNX operators: :func:`bokehnet.baselines.spread.bokehme.bokehme`."""

import numpy as np
import onnx

from bokehnet.arrays.fusion import fuse
from bokehnet.inference.bokehme import (
    DISPLAY_GAMMA,
    GAMMA_RANGE,
    UNIT_PX,
    dilated_radius,
    normalised_gamma,
    refinement_mask,
    resize_matrix,
)
from bokehnet.onnx_file.builder import Graph, Value
from bokehnet.optics.coc import defocus_from_disparity
from bokehnet.version import __version__

__all__ = ["build_bokehme"]


def _scatter(g: Graph, light: Value, defocus: Value) -> Value:
    """Spread soft discs over the picture (3, H, W), one offset of all discs per iteration."""
    height, width = defocus.size(0), defocus.size(1)
    radius = abs(defocus).reshape(1, height, width)
    weight = 1 / (radius * radius + 0.2)
    reach = (radius.max() + 1).astype(np.int64)
    margin = g.concat([g.sizes(0), reach, reach] * 2)
    sources = g.op("Pad", g.concat([light * weight, weight, radius]), margin)
    side = 2 * reach + 1

    def add(iteration: Value, sums: Value) -> tuple[list[Value], list[Value]]:
        row, column = iteration / side, iteration % side
        moved = sources.cut(1, row, row + height).cut(2, column, column + width)
        down, across = ((x - reach).astype(np.float32) for x in (row, column))
        distance = g.op("Sqrt", down * down + across * across)
        covered = g.tanh((moved.cut(0, 4, 5) - distance) * 4) * 0.5 + 0.5
        return [sums + moved.cut(0, 0, 4) * covered], []

    sums = g.loop(add, [g.zeros(np.float32, 4, height, width)], times=side * side)[0]
    total = sums.cut(0, 3, 4)
    return g.where(total > 1e-9, sums.cut(0, 0, 3) / g.maximum(total, 1e-9), light)


def _weights(g: Graph, size: Value, old_size: Value) -> Value:
    scale = old_size.astype(np.float32) / size.astype(np.float32)
    rows = g.count_up(size).astype(np.float32).reshape(-1, 1)
    columns = g.count_up(old_size).astype(np.float32).reshape(1, -1)
    matrix = resize_matrix(rows, columns, scale, g.maximum(scale, 1))
    return matrix / matrix.sum(1, keep=True)


def _resize(g: Graph, x: Value, size: tuple[Value, Value]) -> Value:
    """Resize (C, H, W) as :func:`bokehnet.inference.bokehme.resize`."""
    columns = _weights(g, size[1], x.size(2)).transpose(1, 0)
    return _weights(g, size[0], x.size(1)) @ (x @ columns)


def _even(g: Graph, x: Value) -> Value:
    return (g.maximum(g.round(x * 0.5), 1) * 2).astype(np.int64)


def _dilated(g: Graph, defocus: Value) -> Value:
    """Return the dilated radius (1, h, w) of a defocus map at ARNet's size."""
    height, width, reach = defocus.size(1), defocus.size(2), int(UNIT_PX)
    padded = g.op("Pad", abs(defocus), g.constant([0, reach, reach] * 2, np.int64))

    def shifted(row: int, column: int) -> Value:
        top, left = reach + row, reach + column
        return padded.cut(1, top, height + top).cut(2, left, width + left)

    return dilated_radius(shifted, reach)


def _run(g: Graph, network: onnx.ModelProto, **inputs: Value) -> list[Value]:
    """Write a network to the graph, for (C, H, W) in and out."""
    batches = {name: g.op("Unsqueeze", x, g.sizes(0)) for name, x in inputs.items()}
    return [g.op("Squeeze", x, g.sizes(0)) for x in g.inline(network, batches)]


def _render(
    g: Graph, networks: tuple[onnx.ModelProto, onnx.ModelProto], image: Value, defocus: Value, gamma: Value
) -> tuple[Value, Value]:
    """Return picture (3, H, W) and error map (1, H, W) of the networks, as ``render_bokehme``."""
    full = (defocus.size(1) + defocus.size(1) % 2, defocus.size(2) + defocus.size(2) % 2)
    image, defocus = _resize(g, image, full), _resize(g, defocus, full)
    factor = g.maximum(abs(defocus).max() / UNIT_PX, 1)
    rows, columns = (_even(g, side.astype(np.float32) / factor) for side in full)
    size = (rows, columns)
    small, small_defocus = _resize(g, image, size), _resize(g, defocus, size) / factor
    coarse, error_map = _run(g, networks[0], image=small, defocus=small_defocus, gamma=gamma)
    dilated = _dilated(g, small_defocus)
    first = coarse.size(1).astype(np.float32)

    def climb(_: Value, __: Value, coarse: Value) -> tuple[list[Value], list[Value]]:
        sides = []
        for axis, whole in zip((1, 2), full, strict=True):
            doubled = coarse.size(axis) * 2
            sides.append(g.where(doubled >= whole, whole, _even(g, doubled.astype(np.float32))))
        rows, columns = sides
        height = rows.astype(np.float32)
        defocus_here = _resize(g, defocus, (rows, columns)) * (height / full[0].astype(np.float32))
        refined = _run(
            g,
            networks[1],
            image=_resize(g, image, (rows, columns)),
            defocus=defocus_here,
            coarse=_resize(g, coarse, (rows // 2, columns // 2)),
            gamma=gamma,
        )[0]
        mask = refinement_mask(_resize(g, dilated, (rows, columns)) * (height / first))
        smaller = (rows < full[0]) | (columns < full[1])
        return [smaller, fuse(_resize(g, coarse, (rows, columns)), refined, mask)], []

    start = (size[0] < full[0]) | (size[1] < full[1])
    return g.loop(climb, [start, coarse], while_true=True)[1], error_map


def build_bokehme(arnet: onnx.ModelProto, iunet: onnx.ModelProto) -> onnx.ModelProto:
    """Return the baseline as one model; inputs and output as in ``bokehnet.onnx_file.renderer.build_model``.

    Its ``gamma`` is that of the settings, 1 for scene-linear light; the paper's is 2.2 times as large, and
    clipped to its range of 1 to 5.

    Args:
        arnet: Coarse network, exported.
        iunet: Refining network, exported.
    """
    g = Graph()
    image = g.input("image", np.float32, ["height", "width", 3])
    disparity = g.input("disparity", np.float32, ["height", "width"])
    blur, focus, gamma = (g.input(name, np.float32, []) for name in ("K", "focus", "gamma"))
    encoded = g.maximum(image, 0).transpose(2, 0, 1) ** (1 / DISPLAY_GAMMA)
    defocus = defocus_from_disparity(disparity, blur, focus)
    height, width = defocus.size(0), defocus.size(1)
    exponent = (gamma.reshape(1) * DISPLAY_GAMMA).clip(*GAMMA_RANGE)
    classical = _scatter(g, encoded**exponent, defocus) ** (1 / exponent)
    defocus = defocus.reshape(1, height, width)
    channel = normalised_gamma(exponent).reshape(1, 1, 1)
    neural, error_map = _render(g, (arnet, iunet), encoded, defocus, channel)
    size = (height, width)
    bokeh = fuse(classical, _resize(g, neural, size), _resize(g, error_map, size))
    bokeh = (g.maximum(bokeh, 0) ** DISPLAY_GAMMA).transpose(1, 2, 0)
    about = {"producer": f"bokehnet {__version__}", "license": "Apache-2.0", "light": "scene-linear"}
    model = g.model({"bokeh": (bokeh, ["height", "width", 3])}, **about)
    onnx.checker.check_model(model, full_check=True)
    return model
