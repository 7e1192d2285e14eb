"""Sums of the light of a pixel's rays, as means over its rays in three groups.

The groups are blurred surfaces in front of focus, sharp ones, and blurred ones behind focus. Each contains
weighted red, green and blue, the weights, a second moment, and the weight of light that no picture shows:
``PLAIN`` values, or ``COLORED`` if each color has a weight of its own. The second moment of blurred surfaces
is the mean of 1 / radius, which limits the window over which they are averaged; that of sharp ones is the
mean squared brightness, which determines the number of rays.
"""

import numpy as np

from bokehnet.classical.simd.float8 import (
    LANES,
    and_not8,
    any8,
    broadcast8,
    divide8,
    less8,
    load8,
    max8,
    select8,
    sqrt8,
    store8,
    sum8,
)
from bokehnet.kernels import njit

__all__ = [
    "BACK_GROUP",
    "COLORED",
    "FILTERED_RADIUS",
    "FRONT_GROUP",
    "GROUPS",
    "PLAIN",
    "SHARP_GROUP",
    "add_light",
    "sum_light",
]

GROUPS, PLAIN, COLORED = 3, 6, 8
FRONT_GROUP, SHARP_GROUP, BACK_GROUP = 0, 1, 2

# The rays of discs of at least this radius, pixels, may be averaged with those of the 8 neighbours.
FILTERED_RADIUS = 4.0


@njit(cache=True, forceinline=True)
def _add(totals, at, member, lanes):
    """Add the members among eight values to the totals from index ``at`` on."""
    zero = broadcast8(np.float32(0))
    store8(totals, at, load8(totals, at) + select8(member, lanes, zero))


@njit(cache=True, forceinline=True)
def add_light(totals, numbers, blur, depth, weights, colors, weight, disocclusion_weight):
    """Add the light of eight rays to the totals of their groups.

    Args:
        totals: Totals, (GROUPS * numbers * LANES,), float32.
        numbers: ``PLAIN`` or ``COLORED``.
        blur: Squared radius of the discs of the rays, lanes.
        depth: Defocus of their hits.
        weights: Weights of red, green and blue, a tuple of lanes; ``PLAIN`` uses the first.
        colors: Red, green and blue of their hits.
        weight: Mean of ``weights``.
        disocclusion_weight: Weight of light that no picture shows.
    """
    zero, large = broadcast8(np.float32(0)), broadcast8(np.float32(FILTERED_RADIUS**2))
    sharp, front = less8(blur, large), less8(zero, depth)
    back = and_not8(and_not8(less8(zero, large), sharp), front)
    for group, member in enumerate((and_not8(front, sharp), sharp, back)):
        if not any8(member):
            continue
        at = group * numbers * LANES
        for c in range(3):
            _add(totals, at + c * LANES, member, weights[c] * colors[c])
        _add(totals, at + 3 * LANES, member, weights[0])
        if numbers == COLORED:
            _add(totals, at + 4 * LANES, member, weights[1])
            _add(totals, at + 5 * LANES, member, weights[2])
        if group == SHARP_GROUP:
            brightness = broadcast8(np.float32(1 / 3)) * (colors[0] + colors[1] + colors[2])
            _add(totals, at + (numbers - 2) * LANES, member, weight * brightness * brightness)
        else:
            _add(totals, at + (numbers - 2) * LANES, member, divide8(weight, sqrt8(max8(blur, large))))
        _add(totals, at + (numbers - 1) * LANES, member, disocclusion_weight)


@njit(cache=True, forceinline=True)
def sum_light(totals, before, rays, sums):
    """Add totals to a pixel's means (GROUPS, numbers) of ``before`` rays, which become those of ``rays``."""
    numbers = sums.shape[1]
    old_weight, new_weight = np.float32(before / rays), np.float32(1.0 / rays)
    for group in range(GROUPS):
        for c in range(numbers):
            total = sum8(load8(totals, (group * numbers + c) * LANES))
            sums[group, c] = old_weight * sums[group, c] + new_weight * total
