"""Overlap filter: columns, then rows, with each neighbour weighted by the coverage of the pixel by its blur.

Faults: the blur is a square; where it changes, the second pass spreads light that the first has moved, which
    leaves streaks; a blurred foreground never fully occludes.
"""

import math

import numpy as np
from numba import prange

from bokehnet.baselines.apertures import check_baseline
from bokehnet.checks import check_range
from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit
from bokehnet.optics.aperture import Aperture

__all__ = ["overlap", "overlap_coverage", "overlap_weight"]

# Half side of a square divided by the radius of a disc of the same area.
_HALF_SIDE = 0.5 * math.sqrt(math.pi)


@njit(cache=True)
def overlap_coverage(radius, distance):
    """Return the coverage of a pixel at an integer distance by a circle of confusion, 0 to 1: eq. 3.18."""
    return min(max(radius - distance, 0.0), 1.0)


@njit(cache=True)
def overlap_weight(defocus, distance, centre, leakage):
    """Return the weight of a pixel on another one: overlap, light and leakage.

    Args:
        defocus: Defocus of the emitting pixel.
        distance: Distance between both, whole pixels.
        centre: Defocus of the receiving pixel.
        leakage: Remaining fraction of light from behind focus on a pixel in focus.
    """
    radius = max(_HALF_SIDE * abs(defocus), 0.5)
    overlap = 1.0 if distance == 0 else overlap_coverage(radius + 0.5, distance)
    light = 1.0 / (2.0 * radius)
    control = 1.0
    if defocus < 0.0 and distance > 0:
        control = max(min(abs(centre), 1.0), leakage)
    return overlap * light * control


@njit(cache=True, parallel=True)
def _filter_rows(values, defocus, leakage, result):
    height, width, channels = values.shape
    for y in prange(height):
        largest = 0.0
        for x in range(width):
            largest = max(largest, abs(defocus[y, x]))
        reach = int(math.ceil(largest + 0.5))
        sums = np.zeros(channels)
        for x in range(width):
            total = 0.0
            sums[:] = 0.0
            for column in range(max(0, x - reach), min(width, x + reach + 1)):
                weight = overlap_weight(defocus[y, column], abs(column - x), defocus[y, x], leakage)
                if weight == 0.0:
                    continue
                total += weight
                for c in range(channels):
                    sums[c] += weight * values[y, column, c]
            for c in range(channels):
                result[y, x, c] = sums[c] / total


def overlap(
    image: np.ndarray, defocus: np.ndarray, aperture: Aperture | None = None, *, leakage: float = 0.0
) -> np.ndarray:
    """Render by the overlap filter.

    Args:
        image: Scene-linear, (H, W, 3).
        defocus: Signed blur radius in pixels, (H, W), + in front of focus.
        aperture: Plain disc or None.
        leakage: Remaining fraction of the weight of pixels behind focus on a pixel in focus, 0 to 1.

    Returns:
        Picture (H, W, 3), float32.

    Source:
        Zhou, Chen and Pullen, "Accurate depth of field simulation in real time", Computer Graphics Forum
        2007; thesis 000, eq. 3.18. It gives no formula for light and leakage: here light is one over the
        width of the blur, as a pass spreads along a line (an area would count twice), and leakage is 0 by
        default. A pass covers 2 r pixels; both passes form a square, so r is half the side of a square of the
        disc's area: with the disc's radius the blur is a third too wide.
    """
    check_range("leakage", leakage, 0, 1)
    image, defocus, _ = check_baseline("overlap", "disc", image, defocus, aperture)
    transposed, result = np.ascontiguousarray(image.transpose(1, 0, 2)), np.empty_like(image)
    filtered_columns = np.empty_like(transposed)
    with parallel_region:
        _filter_rows(transposed, np.ascontiguousarray(defocus.T), leakage, filtered_columns)
        _filter_rows(np.ascontiguousarray(filtered_columns.transpose(1, 0, 2)), defocus, leakage, result)
    return result
