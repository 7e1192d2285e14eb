"""Perceptual encoding of light for the networks; operators only, for NumPy, torch and ONNX graphs."""

import math

from bokehnet.checks import Array, array_namespace

__all__ = ["STEEPNESS", "WHITE", "decode", "encode"]

# Steepness near black; 20 weighs a difference in the shadows about as much as sRGB does.
STEEPNESS = 20.0
WHITE = math.log1p(STEEPNESS)


def encode(linear: Array) -> Array:
    """Map scene-linear light to a perceptual scale: 0 to 0, 1 to 1, unbounded above, clipped at 0 below."""
    xp = array_namespace(linear)
    return xp.log1p(STEEPNESS * linear.clip(min=0)) / WHITE


def decode(encoded: Array) -> Array:
    """Invert :func:`encode`; continues smoothly below 0, so that the gradient never vanishes."""
    xp = array_namespace(encoded)
    return xp.expm1(encoded * WHITE) / STEEPNESS
