"""The neural half as ONNX operators: what :mod:`bokehnet.inference.coarse_to_fine` does."""

import numpy as np
import onnx

from bokehnet.coarse_to_fine import BLOCK
from bokehnet.onnx_file.builder import Graph
from bokehnet.onnx_file.pictures import double, pad_to_multiple, shrink
from bokehnet.onnx_file.tone import decode, encode
from bokehnet.onnx_file.values import Value

__all__ = ["render_neural"]

# More halvings than any picture allows.
_MOST_HALVINGS = 40


def _count_halvings(g: Graph, defocus: Value, network_max_radius: float) -> Value:
    """How often the picture must be halved until no blur exceeds ``network_max_radius``, as a size."""
    limits = g.constant(network_max_radius * 2.0 ** np.arange(_MOST_HALVINGS), np.float32)
    return (abs(defocus).max() > limits).astype(np.int64).sum()


def _run(g: Graph, network: onnx.ModelProto, inputs: dict[str, Value]) -> list[Value]:
    """Run a network, which wants batches, on arrays (C, H, W)."""
    results = g.inline(network, {name: g.op("Unsqueeze", x, g.sizes(0)) for name, x in inputs.items()})
    return [g.op("Squeeze", x, g.sizes(0)) for x in results]


def render_neural(
    g: Graph,
    image: Value,
    defocus: Value,
    classical: Value,
    classical_error_map: Value,
    *,
    arnet: onnx.ModelProto,
    network_max_radius: float,
) -> tuple[Value, Value]:
    """Render the neural half, as :class:`bokehnet.inference.coarse_to_fine.CoarseCorrection`, on every pixel.

    Args:
        g: The open graph.
        image: All-in-focus picture, scene-linear, (3, H, W).
        defocus: Signed blur radius in pixels, (H, W).
        classical: Classical render, (3, H, W).
        classical_error_map: Its error map, (H, W).
        arnet: The network.
        network_max_radius: Largest radius ``arnet`` was trained for, pixels.

    Returns:
        Bokeh (3, H, W) and error map (1, H, W).
    """
    height, width = defocus.size(0), defocus.size(1)
    halvings = _count_halvings(g, defocus, network_max_radius)
    powers = g.constant(2 ** np.arange(_MOST_HALVINGS), np.int64)
    factor = powers.take(halvings)

    def small(x: Value) -> Value:
        return shrink(pad_to_multiple(g, x, factor * BLOCK), factor)

    inputs = {
        "image": small(image),
        "defocus": small(defocus.reshape(1, height, width)) / factor.astype(np.float32),
        "classical": small(classical),
    }
    bokeh, learned = _run(g, arnet, inputs)
    change = encode(g, bokeh) - encode(g, inputs["classical"])

    def climb(_: Value, change: Value, learned: Value) -> tuple[list[Value], list[Value]]:
        return [double(g, change), double(g, learned)], []

    change, learned = (
        x.cut(1, 0, height).cut(2, 0, width) for x in g.loop(climb, [change, learned], times=halvings)
    )
    neural = decode(g, encode(g, classical) + change)
    return neural, learned * classical_error_map.reshape(1, height, width)
