"""Golden-angle spiral of sample positions with equal area per sample."""

import math

import numpy as np

__all__ = ["GOLDEN_ANGLE", "spiral"]

GOLDEN_ANGLE = math.pi * (3 - math.sqrt(5))


def spiral(largest: float, scale: float) -> np.ndarray:
    """Return the samples of a spiral whose radius grows by ``scale / radius`` per step.

    Its radius after n steps is about ``sqrt(2 n scale)``, so each sample represents an area of 2 pi scale.

    Args:
        largest: Upper bound of the radii, pixels.
        scale: First radius, pixels; the area per sample is 2 pi scale.

    Returns:
        Rows of angle in radians, from right over down, and radius; (N, 2) float32.

    Source:
        Gustafsson, "Bokeh depth of field in a single pass", 2018, after thesis 004, 2.2.3.
    """
    samples, angle, radius = [], 0.0, scale
    while radius < largest:
        samples.append((angle, radius))
        radius += scale / radius
        angle += GOLDEN_ANGLE
    return np.array(samples, np.float32).reshape(-1, 2)
