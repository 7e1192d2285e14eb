"""Where the boundary of a surface runs inside a pixel that it covers in part.

A coverage alone spreads the surface evenly over its pixel, which blurs every outline by a pixel. But coverage
is what the pixel filter makes of the outline, so around the centre of the pixel it falls the way the filter
does: it rises towards the side on which the neighbours are covered, and the steeper the nearer it is to one
half. A surface's coverage at the place (x, y) from the centre is taken to be ``c + g . (x, y)``, of which the
slope g is written into the lower bits of the coverage: what is read as a number between 0 and 1 remains the
coverage to a thousandth. Where no neighbour is all covered or all clear, the outline is softer than a pixel
filter makes it, and the slope is less by the cube of what the neighbours differ.

Source: Youngs, "Time-dependent multi-material flow with large fluid distortion", in Numerical Methods for
Fluid Dynamics, 1982, for boundaries inside cells from the shares of the 3x3 cells around; the slopes of
renderers' filters are ours.
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

# Slope, per pixel, where half is covered, times 4: that of a Blackman-Harris filter 1.5 pixels wide.
_STEEPNESS = 7.4

# Levels of coverage; steps of a slope, per axis, and how many make a slope of 1 per pixel.
LEVELS, STEPS, PER_SLOPE = 1024, 64, 16
_WHOLE = LEVELS * STEPS * STEPS

# Sobel sums below which no side is told to be covered more than the others.
_UNDECIDED = 0.2


@njit(cache=True)
def _share(defocus, coverage, y, x, own, apart, unknown):  # type: ignore[no-untyped-def]
    """Share of a pixel that shows what is within ``apart`` of ``own``; ``unknown`` behind what is nearer."""
    share, clear = 0.0, 1.0
    for layer in range(defocus.shape[2]):
        seen = clear * coverage[y, x, layer]
        if abs(defocus[y, x, layer] - own) <= apart:
            share += seen
        elif defocus[y, x, layer] > own:
            share += unknown * seen
        clear -= seen
    return share


@njit(cache=True, parallel=True)
def _with_slopes(defocus, coverage, result):  # type: ignore[no-untyped-def]
    height, width, layers = defocus.shape
    middle = STEPS // 2
    for y in prange(height):
        for x in range(width):
            for layer in range(layers):
                own = coverage[y, x, layer]
                if own <= 0.0 or own >= 1.0:
                    result[y, x, layer] = own
                    continue
                apart = DISCONTINUITY_THRESHOLD
                if layer + 1 < layers:
                    apart = half_step(defocus[y, x, layer], defocus[y, x, layer + 1])
                right = down = most = 0.0
                least = 1.0
                for i in range(-1, 2):
                    for j in range(-1, 2):
                        v, u = min(max(y + i, 0), height - 1), min(max(x + j, 0), width - 1)
                        share = _share(defocus, coverage, v, u, defocus[y, x, layer], apart, own)
                        least, most = min(least, share), max(most, share)
                        weight = 2.0 if i == 0 or j == 0 else 1.0
                        right += weight * j * share
                        down += weight * i * share
                length = math.sqrt(right * right + down * down)
                slope = 0.0
                if length > _UNDECIDED:
                    hard = max(most - least, 0.0) ** 3
                    slope = PER_SLOPE * _STEEPNESS * hard * own * (1.0 - own) / length
                level = min(int(own * LEVELS), LEVELS - 1)
                across = min(max(int(round(slope * right)) + middle, 0), STEPS - 1)
                along = min(max(int(round(slope * down)) + middle, 0), STEPS - 1)
                result[y, x, layer] = ((level * STEPS + across) * STEPS + along) / _WHOLE


def with_slopes(defocus: np.ndarray, coverage: np.ndarray) -> np.ndarray:
    """Write into every coverage how it changes inside its pixel.

    Args:
        defocus: Of the layers, (H, W, L), float32.
        coverage: Of the same, (H, W, L), float32 in [0, 1]; 0 and 1 stay as they are.

    Returns:
        (H, W, L), float32, for :func:`coverage_at`.
    """
    result = np.empty_like(coverage)
    with parallel_region:
        _with_slopes(defocus, coverage, result)
    return result


@njit(cache=True, forceinline=True)
def coverage_at(coverage, x, y):  # type: ignore[no-untyped-def]
    """Coverage of eight surfaces at places inside their pixels.

    Args:
        coverage: From :func:`with_slopes`, above 0 and below 1, lanes of float32.
        x: Right of the centre, pixels, lanes.
        y: Below it.

    Returns:
        Lanes; below 0 or above 1 beyond the boundary's soft rim.
    """
    steps, middle = broadcast8(np.float32(STEPS)), broadcast8(np.float32(STEPS // 2))
    per_step = broadcast8(np.float32(1.0 / STEPS))
    code = coverage * broadcast8(np.float32(_WHOLE))
    upper = floor8(code * per_step)
    level = floor8(upper * per_step)
    across, along = upper - level * steps - middle, code - upper * steps - middle
    slope = (across * x + along * y) * broadcast8(np.float32(1.0 / PER_SLOPE))
    return (level + broadcast8(np.float32(0.5))) * broadcast8(np.float32(1.0 / LEVELS)) + slope
