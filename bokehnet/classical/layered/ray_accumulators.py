"""What the rays of a pixel bring, summed up in three groups, and the picture that comes of the sums.

The groups are blurred surfaces in front of focus, sharp ones, and blurred ones behind focus; blurred ones are
averaged with the neighbours'. Each holds weighted red, green and blue, the weights, and the weight of what
no picture shows: ``PLAIN`` numbers, or ``COLORED`` where each colour has a weight of its own.
"""

import numpy as np
from numba import prange

from bokehnet.classical.simd.float8 import (
    LANES,
    and_not8,
    any8,
    broadcast8,
    less8,
    load8,
    select8,
    store8,
    sum8,
)
from bokehnet.kernels import njit

__all__ = ["COLORED", "GROUPS", "PLAIN", "add_light", "resolve", "sum_light"]

GROUPS, PLAIN, COLORED = 3, 5, 7

# Discs of at least this radius change so slowly that their rays may be averaged with the 8 neighbours'.
_FILTERED_RADIUS = 4.0


@njit(cache=True, forceinline=True)
def _add(totals, at, member, lanes):  # type: ignore[no-untyped-def]
    """Add those of eight numbers that belong to a group to the ones that begin at ``at``."""
    zero = broadcast8(np.float32(0))
    store8(totals, at, load8(totals, at) + select8(member, lanes, zero))


@njit(cache=True, forceinline=True)
def add_light(totals, numbers, blur, depth, shares, colors, disocclusion_weight):  # type: ignore[no-untyped-def]
    """Add what eight rays bring to the totals of their groups.

    Args:
        totals: (GROUPS * numbers * LANES,), float32.
        numbers: ``PLAIN`` or ``COLORED``.
        blur: Squared radius of the discs that the rays belong to, lanes.
        depth: Defocus of what they met.
        shares: Weights of red, green and blue, a tuple of lanes; for ``PLAIN`` the first is used.
        colors: Red, green and blue of what they met.
        disocclusion_weight: Weight of what no picture shows.
    """
    zero, large = broadcast8(np.float32(0)), broadcast8(np.float32(_FILTERED_RADIUS**2))
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
        _add(totals, at + (numbers - 1) * LANES, member, disocclusion_weight)


@njit(cache=True, forceinline=True)
def sum_light(totals, sums):  # type: ignore[no-untyped-def]
    """Write the sums of a pixel (GROUPS, numbers)."""
    numbers = sums.shape[1]
    for group in range(GROUPS):
        for c in range(numbers):
            sums[group, c] = sum8(load8(totals, (group * numbers + c) * LANES))


@njit(cache=True, parallel=True)
def resolve(sums, rays_mask, first, top, bottom, result, disocclusion_weight):  # type: ignore[no-untyped-def]
    """Divide the sums of rows ``top`` to ``bottom``; ``sums`` begin at row ``first``.

    Blurred surfaces are averaged over 3x3 pixels, sharp ones and what their edges cover are not.
    """
    width, numbers = rays_mask.shape[1], sums.shape[3]
    own = 1 if numbers == COLORED else 0  # whether each colour has a weight of its own
    for y in prange(top, bottom):
        around = np.empty((3, numbers))
        for x in range(width):
            if not rays_mask[y, x]:
                continue
            around[:] = 0.0
            for v in range(max(first, y - 1), min(first + sums.shape[0], y + 2)):
                for u in range(max(0, x - 1), min(width, x + 2)):
                    if rays_mask[v, u]:
                        for group in range(3):
                            for c in range(numbers):
                                around[group, c] += sums[v - first, u, group, c]
            weight = 0.0
            for c in range(3):
                i = 3 + own * c
                total = around[0, i] + around[1, i] + around[2, i]
                weight += total / 3.0
                if total <= 0.0:
                    continue
                front = around[0, i] / total
                sharp, back = sums[y - first, x, 1, i], sums[y - first, x, 2, i]
                rest = 0.0
                if sharp > 0.0:
                    rest += sums[y - first, x, 1, c] / (sharp + back)
                if back > 0.0:
                    rest += back / (sharp + back) * around[2, c] / around[2, i]
                if sharp + back == 0.0 and front < 1.0:
                    rest = (around[1, c] + around[2, c]) / (around[1, i] + around[2, i])
                result[y, x, c] = around[0, c] / total + (1.0 - front) * rest
            if weight > 0.0:
                last = numbers - 1
                disocclusion_weight[y, x] = (around[0, last] + around[1, last] + around[2, last]) / weight
