"""Soft steps of a map made sharp: each value goes to the nearer one of the extremes around it."""

import numpy as np

__all__ = ["share_of_soft_steps", "sharpen_steps"]

# A span of the map's values, as a share of the whole map's, that makes a step.
STEP = 0.05

# Between the extremes, in shares of the step, from which on a pixel stands on a slope of it.
_BETWEEN = 0.2

# Half widths of the windows, one after the other; together they turn ramps of ten pixels into steps.
_RADII = (3, 2)


def _extremes(values: np.ndarray, radius: int) -> tuple[np.ndarray, np.ndarray]:
    """Smallest and largest value of the square window around each pixel, the border repeated."""
    results = []
    for choose in (np.minimum, np.maximum):
        found = values
        for axis in (0, 1):
            padding = [(radius, radius) if a == axis else (0, 0) for a in (0, 1)]
            padded = np.pad(found, padding, "edge")
            size = found.shape[axis]
            parts = [np.take(padded, np.arange(i, i + size), axis) for i in range(2 * radius + 1)]
            found = choose.reduce(parts)
        results.append(found)
    return results[0], results[1]


def share_of_soft_steps(disparity: np.ndarray) -> float:
    """How many of the pixels at steps stand between the two sides: 0 = all steps are sharp.

    Args:
        disparity: (H, W), any unit.
    """
    low, high = _extremes(disparity, 2)
    width = high - low
    steps = width > STEP * np.ptp(disparity)
    between = np.minimum(high - disparity, disparity - low) > _BETWEEN * width
    return float((steps & between).sum()) / max(float(steps.sum()), 1.0)


def sharpen_steps(disparity: np.ndarray) -> np.ndarray:
    """Return the map (H, W) with soft steps made sharp where they pass the middle between both sides.

    Source:
        Kramer and Bruckner, "Iterations of a non-linear transformation for enhancement of digital images",
        Pattern Recognition 1975.
    """
    sharp = disparity
    for radius in _RADII:
        low, high = _extremes(sharp, radius)
        nearer = np.where(high - sharp < sharp - low, high, low)
        sharp = np.where(high - low > STEP * np.ptp(disparity), nearer, sharp)
    return np.ascontiguousarray(sharp, np.float32)
