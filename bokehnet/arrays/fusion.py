"""Blend of the classical and the neural half. Operators only: NumPy, torch and ONNX graphs."""

from bokehnet.checks import Array

__all__ = ["fuse"]


def fuse(classical: Array, neural: Array, error_map: Array) -> Array:
    """Blend by the error map: 0 keeps the classical render, 1 selects the neural one.

    Args:
        classical: Classical render, scene-linear.
        neural: Neural render, same shape.
        error_map: Map in [0, 1], broadcastable against both.

    Returns:
        Blend, same shape as ``classical``. Where the map is 0 it equals ``classical`` bit for bit.

    Source:
        Peng et al., "BokehMe: When neural rendering meets classical rendering", CVPR 2022.
    """
    return (1 - error_map) * classical + error_map * neural
