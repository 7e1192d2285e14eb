"""Overlap filter: columns, then rows, each neighbour weighed by how far its blur covers the pixel.

Faults: the blur is a square; where it changes, the second pass spreads what the first has moved, which leaves
streaks; a blurred foreground hides nothing completely.
"""

import math

import numpy as np
from numba import prange

from bokehnet.baselines.openings import check_baseline
from bokehnet.checks import check_range
from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit
from bokehnet.optics.aperture import Aperture

__all__ = ["overlap", "overlap_share", "overlap_weight"]

# Half the side of a square over the radius of a disc of its area.
_HALF_SIDE = 0.5 * math.sqrt(math.pi)


@njit(cache=True)
def overlap_share(radius, distance):  # type: ignore[no-untyped-def]
    """How far a circle of confusion reaches over the pixel at a whole distance, 0 to 1: eq. 3.18."""
    return min(max(radius - distance, 0.0), 1.0)


@njit(cache=True)
def overlap_weight(defocus, distance, centre, leakage):  # type: ignore[no-untyped-def]
    """Weight of a pixel on another one: overlap, light and leakage.

    Args:
        defocus: Of the pixel whose light it is.
        distance: Between both, whole pixels.
        centre: Defocus of the pixel on which it falls.
        leakage: What is left of light from behind focus on a pixel in focus.
    """
    radius = max(_HALF_SIDE * abs(defocus), 0.5)
    overlap = 1.0 if distance == 0 else overlap_share(radius + 0.5, distance)
    light = 1.0 / (2.0 * radius)
    control = 1.0
    if defocus < 0.0 and distance > 0:
        control = max(min(abs(centre), 1.0), leakage)
    return overlap * light * control


@njit(cache=True, parallel=True)
def _filter_rows(values, defocus, leakage, result):  # type: ignore[no-untyped-def]
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
        aperture: A plain disc or None.
        leakage: What is left of the weight of pixels behind focus on a pixel that is in focus, 0 to 1.

    Returns:
        Picture (H, W, 3), float32.

    Source:
        Zhou, Chen and Pullen, "Accurate depth of field simulation in real time", Computer Graphics Forum
        2007; thesis 000, eq. 3.18. Light and leakage it names without a formula: here one over the width of
        the blur, as a pass spreads along a line (over an area it would count twice), and nothing from behind
        focus on what is sharp. A length of 2 r pixels is covered, and as both passes together make a square,
        r is half the side of one of the disc's area: with the disc's own radius the blur is a third too wide.
    """
    check_range("leakage", leakage, 0, 1)
    image, defocus, _ = check_baseline("overlap", "disc", image, defocus, aperture)
    turned, result = np.ascontiguousarray(image.transpose(1, 0, 2)), np.empty_like(image)
    upright = np.empty_like(turned)
    with parallel_region:
        _filter_rows(turned, np.ascontiguousarray(defocus.T), leakage, upright)
        _filter_rows(np.ascontiguousarray(upright.transpose(1, 0, 2)), defocus, leakage, result)
    return result
