"""Depth discontinuities of less than a pixel of defocus: steps between surfaces, not slopes.

Rays take neighbours whose defocus differs by no more than ``DISCONTINUITY_THRESHOLD`` for one surface that
goes over from the one to the other. Where there is a step, they see a surface between both, the nearer one up
to 0.13 pixels too wide. What such a step hides is a strip no wider than the step, less than a pixel. So
pixels at it need only be parted into the two surfaces that they mix, and what they hide is the farther one.

A step is told from a slope by what is around it: a surface that rises by so much to one pixel rises to the
next ones as well.
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

__all__ = ["LEAST_STEP", "SLIGHT", "half_step", "sides_with_slight_steps"]

# Bit of sides: a pixel at a slight step, and at no other.
SLIGHT = 8

# Steps of less defocus, in pixels, shift and blur their edges by too little to be seen.
LEAST_STEP = 0.25

# How many times what a slope gives a step must exceed, beside the least.
_OVER_SLOPE = 2.0


@njit(cache=True)
def half_step(near, far):  # type: ignore[no-untyped-def]
    """By how much the defocus of what belongs to either of two surfaces may differ from theirs."""
    return DISCONTINUITY_THRESHOLD if near - far > DISCONTINUITY_THRESHOLD else 0.5 * (near - far)


@njit(cache=True)
def _steepest(defocus, y, x):  # type: ignore[no-untyped-def]
    """Largest slope of the 3x3 pixels: along an axis, the lesser of the changes to both sides."""
    height, width = defocus.shape
    most = np.float32(0.0)
    for v in range(max(0, y - 1), min(height, y + 2)):
        for u in range(max(0, x - 1), min(width, x + 2)):
            own = defocus[v, u]
            up, down = own - defocus[max(v - 1, 0), u], own - defocus[min(v + 1, height - 1), u]
            left, right = own - defocus[v, max(u - 1, 0)], own - defocus[v, min(u + 1, width - 1)]
            most = max(most, min(abs(up), abs(down)), min(abs(left), abs(right)))
    return most


@njit(cache=True, parallel=True)
def _mark(defocus, reach, stepped, sides):  # type: ignore[no-untyped-def]
    """Set ``SLIGHT`` in ``sides``, in place, where nothing is set."""
    height, width = defocus.shape
    for y in prange(height):
        for x in range(width):
            if sides[y, x] != 0 or not stepped[y // STEP_TILE, x // STEP_TILE]:
                continue
            low, high = span(defocus, y, x, reach)
            step = max(high - defocus[y, x], defocus[y, x] - low)
            if step > LEAST_STEP and step > LEAST_STEP + _OVER_SLOPE * reach * _steepest(defocus, y, x):
                sides[y, x] = SLIGHT


def sides_with_slight_steps(defocus: np.ndarray, reach: int) -> np.ndarray:
    """Bits of ``depth_discontinuities.discontinuity_sides``, and ``SLIGHT``.

    Args:
        defocus: (H, W), float32.
        reach: Pixels from a step, along rows and columns, beyond which all bits are 0.

    Returns:
        (H, W) int8.
    """
    sides = discontinuity_sides(defocus, reach)
    stepped = tiles_with_steps(defocus, reach, LEAST_STEP)
    with parallel_region:
        _mark(defocus, reach, stepped, sides)
    return sides
