"""The neural half as ONNX operators: :mod:`bokehnet.coarse_to_fine` with the sizes and loops of a graph.

The formulas are those of that module, called with values of the graph.
"""

from collections.abc import Callable

import numpy as np
import onnx

from bokehnet.coarse_to_fine import BLOCK, ask_arnet, find_change, lay_over
from bokehnet.onnx_file.builder import Graph, Value
from bokehnet.onnx_file.pictures import double, pad_to_multiple, shrink

__all__ = ["render_neural"]

# More halvings than any picture allows.
_MOST_HALVINGS = 40


def _count_halvings(g: Graph, defocus: Value, network_max_radius: float) -> Value:
    """How often the picture must be halved until no blur exceeds ``network_max_radius``, as a size."""
    limits = g.constant(network_max_radius * 2.0 ** np.arange(_MOST_HALVINGS), np.float32)
    return (abs(defocus).max() > limits).astype(np.int64).sum()


def _written_in(g: Graph, network: onnx.ModelProto) -> Callable[..., tuple[Value, Value]]:
    """An ARNet, which wants batches, as part of the graph: a :class:`CoarseNetwork` for (C, H, W)."""

    def call(image: Value, defocus: Value, classical: Value, _: None) -> tuple[Value, Value]:
        inputs = {"image": image, "defocus": defocus, "classical": classical}
        results = g.inline(network, {name: g.op("Unsqueeze", x, g.sizes(0)) for name, x in inputs.items()})
        bokeh, error_map = (g.op("Squeeze", x, g.sizes(0)) for x in results)
        return bokeh, error_map

    return call


def render_neural(
    g: Graph,
    image: Value,
    defocus: Value,
    classical: Value,
    classical_error_map: Value,
    *,
    arnet: onnx.ModelProto,
    network_max_radius: float,
    max_valid_radius: float,
) -> tuple[Value, Value]:
    """Render the neural half, as :func:`bokehnet.coarse_to_fine.render_neural` without an IUNet.

    Args:
        g: The open graph.
        image: All-in-focus picture, scene-linear, (3, H, W).
        defocus: Signed blur radius in pixels, (H, W).
        classical: Classical render, (3, H, W).
        classical_error_map: Its error map, (H, W).
        arnet: The network.
        network_max_radius: Largest radius ``arnet`` was trained for, pixels.
        max_valid_radius: Largest blur radius that it may correct, pixels.

    Returns:
        Bokeh (3, H, W) and error map (1, H, W).
    """
    height, width = defocus.size(0), defocus.size(1)
    halvings = _count_halvings(g, defocus, network_max_radius)
    factor = g.constant(2 ** np.arange(_MOST_HALVINGS), np.int64).take(halvings)
    scale = factor.astype(np.float32)

    def small(x: Value) -> Value:
        return shrink(pad_to_multiple(g, x, factor * BLOCK), factor)

    low_classical = small(classical)
    bokeh, learned = ask_arnet(
        _written_in(g, arnet),
        small(image),
        small(defocus.reshape(1, height, width)) / scale,
        low_classical,
        None,
        max_valid_radius / scale,
    )
    change = find_change(bokeh, low_classical)

    def climb(_: Value, change: Value, learned: Value) -> tuple[list[Value], list[Value]]:
        return [double(g, change), double(g, learned)], []

    change, learned = (
        x.cut(1, 0, height).cut(2, 0, width) for x in g.loop(climb, [change, learned], times=halvings)
    )
    return lay_over(classical, change), learned * classical_error_map.reshape(1, height, width)
