"""What the rays of a pixel bring, as means over its rays in three groups.

The groups are blurred surfaces in front of focus, sharp ones, and blurred ones behind focus. Each holds
weighted red, green and blue, the weights, a second moment, and the weight of what no picture shows:
``PLAIN`` numbers, or ``COLORED`` where each colour has a weight of its own. The second moment of blurred
surfaces is the mean of 1 / radius, which tells over how many pixels they may be averaged; of sharp ones it
is that of the squared brightness, which tells how many rays they take.
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

# Discs of at least this radius change so slowly that their rays may be averaged with the 8 neighbours'.
FILTERED_RADIUS = 4.0


@njit(cache=True, forceinline=True)
def _add(totals, at, member, lanes):  # type: ignore[no-untyped-def]
    """Add those of eight numbers that belong to a group to the ones that begin at ``at``."""
    zero = broadcast8(np.float32(0))
    store8(totals, at, load8(totals, at) + select8(member, lanes, zero))


@njit(cache=True, forceinline=True)
def add_light(totals, numbers, blur, depth, shares, colors, weight, disocclusion_weight):  # type: ignore[no-untyped-def]
    """Add what eight rays bring to the totals of their groups.

    Args:
        totals: (GROUPS * numbers * LANES,), float32.
        numbers: ``PLAIN`` or ``COLORED``.
        blur: Squared radius of the discs that the rays belong to, lanes.
        depth: Defocus of what they met.
        shares: Weights of red, green and blue, a tuple of lanes; for ``PLAIN`` the first is used.
        colors: Red, green and blue of what they met.
        weight: Mean of ``shares``.
        disocclusion_weight: Weight of what no picture shows.
    """
    zero, large = broadcast8(np.float32(0)), broadcast8(np.float32(FILTERED_RADIUS**2))
    sharp, front = less8(blur, large), less8(zero, depth)
    back = and_not8(and_not8(less8(zero, large), sharp), front)
    for group, member in enumerate((and_not8(front, sharp), sharp, back)):
        if not any8(member):
            continue
        at = group * numbers * LANES
        for c in range(3):
            _add(totals, at + c * LANES, member, shares[c] * colors[c])
        _add(totals, at + 3 * LANES, member, shares[0])
        if numbers == COLORED:
            _add(totals, at + 4 * LANES, member, shares[1])
            _add(totals, at + 5 * LANES, member, shares[2])
        if group == SHARP_GROUP:
            brightness = broadcast8(np.float32(1 / 3)) * (colors[0] + colors[1] + colors[2])
            _add(totals, at + (numbers - 2) * LANES, member, weight * brightness * brightness)
        else:
            _add(totals, at + (numbers - 2) * LANES, member, divide8(weight, sqrt8(max8(blur, large))))
        _add(totals, at + (numbers - 1) * LANES, member, disocclusion_weight)


@njit(cache=True, forceinline=True)
def sum_light(totals, before, rays, sums):  # type: ignore[no-untyped-def]
    """Add totals to a pixel's means (GROUPS, numbers) of ``before`` rays, which become those of ``rays``."""
    numbers = sums.shape[1]
    kept, added = np.float32(before / rays), np.float32(1.0 / rays)
    for group in range(GROUPS):
        for c in range(numbers):
            found = sum8(load8(totals, (group * numbers + c) * LANES))
            sums[group, c] = kept * sums[group, c] + added * found
