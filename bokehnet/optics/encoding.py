"""The scale on which networks see light. Operators only: NumPy, torch and ONNX graphs."""

import math

from bokehnet.checks import Array, array_namespace

__all__ = ["STEEPNESS", "WHITE", "decode", "encode"]

# Steepness near black; at 20 a step in the shadows weighs about as much as in sRGB.
STEEPNESS = 20.0
WHITE = math.log1p(STEEPNESS)


def encode(linear: Array) -> Array:
    """Scene-linear light to a perceptual scale; 0 to 0, 1 to 1, unbounded above, below 0 as 0."""
    xp = array_namespace(linear)
    return xp.log1p(STEEPNESS * linear.clip(min=0)) / WHITE


def decode(encoded: Array) -> Array:
    """Inverse of :func:`encode`; continues smoothly below 0, so that its gradient never vanishes."""
    xp = array_namespace(encoded)
    return xp.expm1(encoded * WHITE) / STEEPNESS
