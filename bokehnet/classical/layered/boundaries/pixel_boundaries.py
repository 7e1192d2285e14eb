"""Boundary of a surface inside a pixel that it covers in part.

A coverage alone spreads the surface evenly over its pixel, which blurs every outline by a pixel. But coverage
is the outline convolved with the pixel filter, so around the centre of the pixel it falls like the filter: it
rises towards the side on which the neighbours are covered, and the steeper the nearer it is to one half. A
surface's coverage at the position (x, y) from the centre is modelled as ``c + g . (x, y)``; the slope g is
stored in the lower bits of the coverage, and the value as a number between 0 and 1 remains the coverage to a
thousandth. If no neighbour is fully covered or fully clear, the outline is softer than the pixel filter, and
the slope is reduced by the cube of the range of the neighbours.

Source: Youngs, "Time-dependent multi-material flow with large fluid distortion", in Numerical Methods for
Fluid Dynamics, 1982, for boundaries inside cells from the volume fractions of the 3x3 cells around; the
slopes of renderers' filters are ours.
"""

import math

import numpy as np
from numba import prange

from bokehnet.classical.layered.depth_discontinuities import DISCONTINUITY_THRESHOLD
from bokehnet.classical.layered.slight_steps import half_step
from bokehnet.classical.parallel import parallel_region
from bokehnet.classical.simd.float8 import broadcast8, floor8
from bokehnet.kernels import njit

__all__ = ["LEVELS", "PER_SLOPE", "STEPS", "coverage_at", "with_slopes"]

# Slope per pixel at half coverage, times 4: that of a Blackman-Harris filter 1.5 pixels wide.
_STEEPNESS = 7.4

# Levels of coverage; steps of a slope per axis; steps for a slope of 1 per pixel.
LEVELS, STEPS, PER_SLOPE = 1024, 64, 16
_CODE_SCALE = LEVELS * STEPS * STEPS

# Length of the Sobel gradient below which no side counts as more covered.
_MIN_GRADIENT = 0.2


@njit(cache=True)
def _coverage_of(defocus, coverage, y, x, own, tolerance, unknown):
    """Return the coverage by surfaces within ``tolerance`` of ``own``; nearer surfaces count ``unknown``."""
    total, clear = 0.0, 1.0
    for layer in range(defocus.shape[2]):
        seen = clear * coverage[y, x, layer]
        if abs(defocus[y, x, layer] - own) <= tolerance:
            total += seen
        elif defocus[y, x, layer] > own:
            total += unknown * seen
        clear -= seen
    return total


@njit(cache=True, parallel=True)
def _with_slopes(defocus, coverage, result):
    height, width, layers = defocus.shape
    middle = STEPS // 2
    for y in prange(height):
        for x in range(width):
            for layer in range(layers):
                own_coverage = coverage[y, x, layer]
                if own_coverage <= 0.0 or own_coverage >= 1.0:
                    result[y, x, layer] = own_coverage
                    continue
                tolerance = DISCONTINUITY_THRESHOLD
                if layer + 1 < layers:
                    tolerance = half_step(defocus[y, x, layer], defocus[y, x, layer + 1])
                right = down = highest = 0.0
                lowest = 1.0
                for i in range(-1, 2):
                    for j in range(-1, 2):
                        v, u = min(max(y + i, 0), height - 1), min(max(x + j, 0), width - 1)
                        neighbour_coverage = _coverage_of(
                            defocus, coverage, v, u, defocus[y, x, layer], tolerance, own_coverage
                        )
                        lowest, highest = min(lowest, neighbour_coverage), max(highest, neighbour_coverage)
                        weight = 2.0 if i == 0 or j == 0 else 1.0
                        right += weight * j * neighbour_coverage
                        down += weight * i * neighbour_coverage
                length = math.sqrt(right * right + down * down)
                slope = 0.0
                if length > _MIN_GRADIENT:
                    contrast = max(highest - lowest, 0.0) ** 3
                    slope = PER_SLOPE * _STEEPNESS * contrast * own_coverage * (1.0 - own_coverage) / length
                level = min(int(own_coverage * LEVELS), LEVELS - 1)
                across = min(max(int(round(slope * right)) + middle, 0), STEPS - 1)
                along = min(max(int(round(slope * down)) + middle, 0), STEPS - 1)
                result[y, x, layer] = ((level * STEPS + across) * STEPS + along) / _CODE_SCALE


def with_slopes(defocus: np.ndarray, coverage: np.ndarray) -> np.ndarray:
    """Return the coverage with its slope inside the pixel stored in the lower bits.

    Args:
        defocus: Defocus of the layers, (H, W, L), float32.
        coverage: Coverage of the layers, (H, W, L), float32 in [0, 1]; 0 and 1 stay unchanged.

    Returns:
        (H, W, L), float32, for :func:`coverage_at`.
    """
    result = np.empty_like(coverage)
    with parallel_region:
        _with_slopes(defocus, coverage, result)
    return result


@njit(cache=True, forceinline=True)
def coverage_at(coverage, x, y):
    """Return the coverage of eight surfaces at positions inside their pixels.

    Args:
        coverage: From :func:`with_slopes`, above 0 and below 1, lanes of float32.
        x: Position to the right of the centre, pixels, lanes.
        y: Position below the centre, pixels, lanes.

    Returns:
        Lanes; below 0 or above 1 beyond the soft edge of the boundary.
    """
    steps, middle = broadcast8(np.float32(STEPS)), broadcast8(np.float32(STEPS // 2))
    per_step = broadcast8(np.float32(1.0 / STEPS))
    code = coverage * broadcast8(np.float32(_CODE_SCALE))
    upper = floor8(code * per_step)
    level = floor8(upper * per_step)
    across, along = upper - level * steps - middle, code - upper * steps - middle
    slope = (across * x + along * y) * broadcast8(np.float32(1.0 / PER_SLOPE))
    return (level + broadcast8(np.float32(0.5))) * broadcast8(np.float32(1.0 / LEVELS)) + slope
