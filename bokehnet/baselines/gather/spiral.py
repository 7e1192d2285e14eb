"""The spiral of the golden angle: places of samples from a pixel outwards, each for the same area."""

import math

import numpy as np

__all__ = ["GOLDEN_ANGLE", "spiral"]

GOLDEN_ANGLE = math.pi * (3 - math.sqrt(5))


def spiral(largest: float, scale: float) -> np.ndarray:
    """Samples of a spiral whose radius grows by ``scale / radius`` at each step.

    Its radius after n steps is about ``sqrt(2 n scale)``, so each sample stands for an area of 2 pi scale.

    Args:
        largest: Radii stay below it, pixels.
        scale: First radius, and twice the square of the distance between samples over 4 pi; pixels.

    Returns:
        Rows of angle in radians, from right over down, and radius; (N, 2) float32.

    Source:
        Gustafsson, "Bokeh depth of field in a single pass", 2018, as thesis 004, 2.2.3, gives it.
    """
    found, angle, radius = [], 0.0, scale
    while radius < largest:
        found.append((angle, radius))
        radius += scale / radius
        angle += GOLDEN_ANGLE
    return np.array(found, np.float32).reshape(-1, 2)
