"""Depth discontinuities of less than a pixel of defocus: steps between surfaces, not slopes.

Rays treat neighbours whose defocus differs by at most ``DISCONTINUITY_THRESHOLD`` as one continuous surface.
At a step they therefore meet a surface between both, and the nearer surface is up to 0.13 pixels too wide.
Such a step occludes a strip no wider than the step, less than a pixel. It is therefore enough to unmix the
pixels at the step; the occluded surface is the farther one.

The surroundings distinguish a step from a slope: a slope that rises this much to one pixel also rises to the
next pixels.
"""

import numpy as np
from numba import prange

from bokehnet.classical.layered.depth_discontinuities import (
    DISCONTINUITY_THRESHOLD,
    STEP_TILE,
    discontinuity_sides,
    span,
    tiles_with_steps,
)
from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit

__all__ = ["MIN_STEP_PX", "SLIGHT", "half_step", "sides_with_slight_steps"]

# Bit of sides: a pixel at a slight step and at no other.
SLIGHT = 8

# Smaller steps, in pixels of defocus, shift and blur their edges invisibly.
MIN_STEP_PX = 0.25

# Factor by which a step must exceed the change of defocus of a slope, in addition to the minimum.
_SLOPE_FACTOR = 2.0


@njit(cache=True)
def half_step(near, far):
    """Return the tolerance in defocus, pixels, within which a pixel belongs to one of two surfaces."""
    return DISCONTINUITY_THRESHOLD if near - far > DISCONTINUITY_THRESHOLD else 0.5 * (near - far)


@njit(cache=True)
def _largest_slope(defocus, y, x):
    """Return the largest slope of the 3x3 pixels: along an axis, the smaller of the changes to both sides."""
    height, width = defocus.shape
    largest = np.float32(0.0)
    for v in range(max(0, y - 1), min(height, y + 2)):
        for u in range(max(0, x - 1), min(width, x + 2)):
            own = defocus[v, u]
            up, down = own - defocus[max(v - 1, 0), u], own - defocus[min(v + 1, height - 1), u]
            left, right = own - defocus[v, max(u - 1, 0)], own - defocus[v, min(u + 1, width - 1)]
            largest = max(largest, min(abs(up), abs(down)), min(abs(left), abs(right)))
    return largest


@njit(cache=True, parallel=True)
def _mark(defocus, reach, stepped, sides):
    """Set ``SLIGHT`` in ``sides``, in place, where no bit is set."""
    height, width = defocus.shape
    for y in prange(height):
        for x in range(width):
            if sides[y, x] != 0 or not stepped[y // STEP_TILE, x // STEP_TILE]:
                continue
            low, high = span(defocus, y, x, reach)
            step = max(high - defocus[y, x], defocus[y, x] - low)
            if step > MIN_STEP_PX and step > MIN_STEP_PX + _SLOPE_FACTOR * reach * _largest_slope(
                defocus, y, x
            ):
                sides[y, x] = SLIGHT


def sides_with_slight_steps(defocus: np.ndarray, reach: int) -> np.ndarray:
    """Return the bits of ``depth_discontinuities.discontinuity_sides``, and ``SLIGHT``.

    Args:
        defocus: Signed blur radius, (H, W), float32, pixels.
        reach: Pixels from a step, along rows and columns, beyond which all bits are 0.

    Returns:
        (H, W) int8.
    """
    sides = discontinuity_sides(defocus, reach)
    stepped = tiles_with_steps(defocus, reach, MIN_STEP_PX)
    with parallel_region:
        _mark(defocus, reach, stepped, sides)
    return sides
