"""Slow, simple reference for every fast variant of the scatter."""

import math

import numpy as np

from bokehnet.classical.scatter.disc_table import SMALLEST_RADIUS

__all__ = ["disc_coverage", "disc_weights", "scatter_reference"]


def disc_coverage(radius: float, reach: int, oversampling: int = 200) -> np.ndarray:
    """Return the area of a disc on each pixel of a (2 reach + 1)^2 window, by counting sub-pixels."""
    edge = (np.arange((2 * reach + 1) * oversampling) + 0.5) / oversampling - reach - 0.5
    inside = edge[:, None] ** 2 + edge[None, :] ** 2 <= radius**2
    size = 2 * reach + 1
    return inside.reshape(size, oversampling, size, oversampling).mean(axis=(1, 3))


def disc_weights(radius: float, reach: int, lines: int = 400) -> np.ndarray:
    """Return the fraction of a disc's light on each pixel of a (2 reach + 1)^2 window, without tables.

    Each row of pixels is cut into thin lines; the disc covers an interval of a line, and the weight of a
    pixel is its overlap with the interval, averaged over its lines, over the disc's area.
    """
    radius = max(radius, SMALLEST_RADIUS)
    pixels = np.arange(-reach, reach + 1)
    thin = (np.arange(lines) + 0.5) / lines - 0.5
    weights = np.empty((2 * reach + 1, 2 * reach + 1))
    for k in pixels:
        half = np.sqrt(np.maximum(radius**2 - (k + thin[:, None]) ** 2, 0.0))
        common = np.minimum(pixels + 0.5, half) - np.maximum(pixels - 0.5, -half)
        weights[k + reach] = np.maximum(common, 0.0).mean(axis=0)
    return weights / (math.pi * radius**2)


def scatter_reference(image: np.ndarray, defocus: np.ndarray) -> np.ndarray:
    """Scatter by a loop over sources, each adding its whole window; (H, W, C) and (H, W) to (H, W, C)."""
    height, width = defocus.shape
    reach = int(np.ceil(np.abs(defocus).max())) + 1
    total = np.zeros((height + 2 * reach, width + 2 * reach, image.shape[2]))
    weight = np.zeros((height + 2 * reach, width + 2 * reach))
    for y in range(height):
        for x in range(width):
            window = (slice(y, y + 2 * reach + 1), slice(x, x + 2 * reach + 1))
            weights = disc_weights(abs(float(defocus[y, x])), reach)
            total[window] += weights[..., None] * image[y, x]
            weight[window] += weights
    inner = (slice(reach, reach + height), slice(reach, reach + width))
    return np.asarray(total[inner] / weight[inner][..., None])
