"""Neural half as ONNX operators, with the sizes and loops of a graph.

The formulas are those of :mod:`bokehnet.inference.coarse_to_fine`, called with values of the graph.
"""

import numpy as np
import onnx

from bokehnet.arrays.fusion import fuse
from bokehnet.inference.coarse_to_fine import (
    BLOCK,
    apply_change,
    encoded_change,
    run_arnet,
    suppress_foreground_outlines,
)
from bokehnet.onnx_file.builder import Graph, Value
from bokehnet.onnx_file.pictures import double, pad_to_multiple, shrink

__all__ = ["render_neural"]

# Upper bound of the halvings of any picture.
_MAX_HALVINGS = 40


def _count_halvings(g: Graph, defocus: Value, network_max_radius: float) -> Value:
    """Return the number of halvings until no blur exceeds ``network_max_radius``, as a size."""
    limits = g.constant(network_max_radius * 2.0 ** np.arange(_MAX_HALVINGS), np.float32)
    return (abs(defocus).max() > limits).astype(np.int64).sum()


def _run(g: Graph, network: onnx.ModelProto, **inputs: Value) -> list[Value]:
    """Write a network, which expects batches, to the graph, for (C, H, W) in and out."""
    batches = {name: g.op("Unsqueeze", x, g.sizes(0)) for name, x in inputs.items()}
    return [g.op("Squeeze", x, g.sizes(0)) for x in g.inline(network, batches)]


def render_neural(
    g: Graph,
    image: Value,
    defocus: Value,
    classical: Value,
    classical_error_map: Value,
    *,
    arnet: onnx.ModelProto,
    iunet: onnx.ModelProto | None,
    network_max_radius: float,
    max_valid_radius: float,
) -> Value:
    """Blend as :func:`bokehnet.inference.coarse_to_fine.render_neural`, IUNet over whole pictures.

    Args:
        g: Open graph.
        image: All-in-focus picture, scene-linear, (3, H, W).
        defocus: Signed blur radius in pixels, (H, W).
        classical: Render of the scatter, (3, H, W).
        classical_error_map: Error map of the scatter, (H, W).
        arnet: Coarse network.
        iunet: Refining network; without it ARNet's change is applied to the classical render.
        network_max_radius: Largest radius in the training of ``arnet``, pixels.
        max_valid_radius: Largest blur radius that the networks may correct, pixels.

    Returns:
        Bokeh (3, H, W).
    """
    height, width = defocus.size(0), defocus.size(1)
    halvings = _count_halvings(g, defocus, network_max_radius)
    powers = g.constant(2 ** np.arange(_MAX_HALVINGS), np.int64)
    factor = powers.take(halvings)
    scale = factor.astype(np.float32)
    pictures = {"image": image, "defocus": defocus.reshape(1, height, width), "classical": classical}
    padded = {name: pad_to_multiple(g, x, factor * BLOCK) for name, x in pictures.items()}

    def level(factor: Value) -> dict[str, Value]:
        """Return all inputs at the size at which a pixel is ``factor`` of the picture's."""
        small = {name: shrink(x, factor) for name, x in padded.items()}
        return small | {"defocus": small["defocus"] / factor.astype(np.float32)}

    def arnet_in_graph(image: Value, defocus: Value, classical: Value, _: None) -> tuple[Value, Value]:
        bokeh, error_map = _run(g, arnet, image=image, defocus=defocus, classical=classical)
        return bokeh, error_map

    low = level(factor)
    bokeh, learned = run_arnet(
        arnet_in_graph, low["image"], low["defocus"], low["classical"], None, max_valid_radius / scale
    )

    def climb(iteration: Value, *state: Value) -> tuple[list[Value], list[Value]]:
        doubled = [double(g, x) for x in state[: len(initial_state)]]
        if iunet is None:
            return doubled, []
        inputs = level(powers.take(halvings - 1 - iteration))
        return [*doubled, *_run(g, iunet, **inputs, coarse=state[-1])], []

    initial_state = [encoded_change(bokeh, low["classical"]), learned, low["classical"], low["defocus"]]
    change, learned, coarse, coarse_defocus, *refined = (
        x.cut(1, 0, height).cut(2, 0, width)
        for x in g.loop(climb, [*initial_state, *([] if iunet is None else [bokeh])], times=halvings)
    )
    error_map = learned * classical_error_map.reshape(1, height, width)
    radius = pictures["defocus"] / scale
    classical, error_map = suppress_foreground_outlines(classical, radius, coarse, coarse_defocus, error_map)
    picture = apply_change(classical, change)
    if iunet is not None:
        picture = 0.5 * (picture + refined[0])
    return fuse(classical, picture, error_map)
