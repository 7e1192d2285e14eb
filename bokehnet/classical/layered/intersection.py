"""Which surface of a stack of layers a ray meets first, for eight rays at once.

A ray starts at a place given by its pixel, and while the defocus s falls from front to back it runs along a
straight line of pixels. A layer whose defocus the ray crosses inside a pixel is met there. Between
neighbouring pixels a layer is one surface, a riser, when its defocus differs by no more than ``JUMP``; else
there is a gap, through which rays pass behind the nearer surface and meet what lies hidden there.

Where nothing is hidden and no gap is near, a layer is one smooth surface, and the place where a ray meets it
is found in a few looks: :func:`meet_smooth`.

Source: Lee, Eisemann and Seidel, "Real-time lens blur effects and focus control", ACM TOG 2010, for rays
through layered height fields; Amanatides and Woo, "A fast voxel traversal algorithm for ray tracing",
Eurographics 1987, for the walk along the pixels. Risers and coverage are ours.
"""

import numpy as np
from numba import njit

from bokehnet.classical.layered.depth_discontinuities import JUMP
from bokehnet.classical.layered.layers import Layers
from bokehnet.classical.simd.float8 import (
    LANES,
    any_lane,
    both,
    choose_lanes,
    divide_lanes,
    floor_lanes,
    larger_lanes,
    less,
    load_pairs,
    magnitude_lanes,
    smaller_lanes,
    splat_lanes,
    store_lanes,
    without,
)

__all__ = ["layer_cells", "meet", "meet_smooth"]

_ZERO, _ONE = np.float32(0), np.float32(1)
_JUMP = np.float32(JUMP)
_NEVER = np.float32(-1e30)
_STEEPEST = np.float32(1e-6)  # rays that move less than this per pixel of defocus stay in their pixel
# The most looks of a ray at a smooth surface, and how many pixels may be between the last two.
_LOOKS, _CLOSE = 8, np.float32(0.25)


def layer_cells(layers: Layers) -> np.ndarray:
    """Defocus and coverage side by side, (H, W, L, 2), so that a look at a pixel reads one place."""
    return np.stack([layers.defocus, layers.coverage], axis=-1)


@njit(cache=True)
def meet(cells, size, runs, count, x, y, begin_x, begin_y, u, v, chance, met):  # type: ignore[no-untyped-def]
    """Write the first surface on each of eight rays.

    Places beyond the border see the border's pixel.

    Args:
        cells: From :func:`layer_cells`, flat.
        size: Its height, width and number of layers.
        runs: Stretches (front, back) of the defocus in which there can be a surface, front to back.
        count: How many.
        x: Columns of the rays' pixels, lanes of float32.
        y: Rows.
        begin_x: Where the rays are at defocus 0, from the left side of their pixel, lanes; 1/2 is its
            middle.
        begin_y: The same from its upper side.
        u: Where the rays meet the pupil, aperture coordinate along x, lanes.
        v: Along y.
        chance: A surface is met where this is below its coverage, lanes.
        met: Rows, then columns, then layers, then defocus of eight surfaces, float32; layer -1 and defocus 0
            where there is none.
    """
    height, width, layers = size
    zero, one, jump = splat_lanes(_ZERO), splat_lanes(_ONE), splat_lanes(_JUMP)
    last_x, last_y = splat_lanes(np.float32(width - 1)), splat_lanes(np.float32(height - 1))
    right, down = less(zero, u), less(zero, v)
    step_x, step_y = choose_lanes(right, one, zero - one), choose_lanes(down, one, zero - one)
    gain_x = divide_lanes(one, larger_lanes(magnitude_lanes(u), splat_lanes(_STEEPEST)))
    gain_y = divide_lanes(one, larger_lanes(magnitude_lanes(v), splat_lanes(_STEEPEST)))
    met_row, met_column, met_layer, met_depth = zero, zero, zero - one, zero
    waiting = less(zero, one)
    for run in range(count):
        front = splat_lanes(np.float32(runs[run, 0]))
        length = splat_lanes(np.float32(runs[run, 0] - runs[run, 1]))
        place_x, place_y = begin_x - u * front, begin_y - v * front
        column, row = floor_lanes(place_x), floor_lanes(place_y)
        place_x, place_y = place_x - column, place_y - row
        to_x = choose_lanes(right, one - place_x, place_x) * gain_x
        to_y = choose_lanes(down, one - place_y, place_y) * gain_y
        column, row = x + column, y + row
        below = splat_lanes(_NEVER)  # the nearest surface under the ray in the pixel before
        entry, marching = front, waiting
        while True:
            passed = smaller_lanes(smaller_lanes(to_x, to_y), length)
            leave = front - passed
            seen_x = smaller_lanes(larger_lanes(column, zero), last_x)
            seen_y = smaller_lanes(larger_lanes(row, zero), last_y)
            under = splat_lanes(_NEVER)
            for layer in range(layers):
                depth, cover = load_pairs(cells, seen_y, seen_x, width, 2 * layers, 2 * layer)
                beneath = less(depth, leave)
                under = choose_lanes(beneath, larger_lanes(under, depth), under)
                through_gap = both(less(entry, depth), less(jump, depth - below))
                hit = both(marching, less(chance, cover))
                hit = without(without(hit, beneath), through_gap)
                met_row = choose_lanes(hit, seen_y, met_row)
                met_column = choose_lanes(hit, seen_x, met_column)
                met_layer = choose_lanes(hit, splat_lanes(np.float32(layer)), met_layer)
                met_depth = choose_lanes(hit, depth, met_depth)
                marching, waiting = without(marching, hit), without(waiting, hit)
            marching = both(marching, less(passed, length))
            if not any_lane(marching):
                break
            below, entry = under, leave
            across = less(to_x, to_y)
            column = column + choose_lanes(across, step_x, zero)
            row = row + choose_lanes(across, zero, step_y)
            to_x = to_x + choose_lanes(across, gain_x, zero)
            to_y = to_y + choose_lanes(across, zero, gain_y)
        if not any_lane(waiting):
            break
    store_lanes(met, 0, met_row)
    store_lanes(met, LANES, met_column)
    store_lanes(met, 2 * LANES, met_layer)
    store_lanes(met, 3 * LANES, met_depth)


@njit(cache=True)
def meet_smooth(cells, size, x, y, begin_x, begin_y, u, v, met):  # type: ignore[no-untyped-def]
    """Write where eight rays meet the one smooth surface that there is; arguments as for :func:`meet`.

    A ray meets it at the defocus s that the surface has at the ray's place for s. Each look at the surface
    gives a better s while it rises by less than a pixel of defocus per pixel.

    Returns:
        Whether all rays came to rest; if not, ``met`` is of no use.
    """
    height, width, layers = size
    zero, close = splat_lanes(_ZERO), splat_lanes(_CLOSE)
    last_x, last_y = splat_lanes(np.float32(width - 1)), splat_lanes(np.float32(height - 1))
    stretch = larger_lanes(magnitude_lanes(u), magnitude_lanes(v))
    start_x, start_y = x + begin_x, y + begin_y
    depth, _ = load_pairs(cells, y, x, width, 2 * layers, 0)
    for _ in range(_LOOKS):
        column, row = floor_lanes(start_x - u * depth), floor_lanes(start_y - v * depth)
        column = smaller_lanes(larger_lanes(column, zero), last_x)
        row = smaller_lanes(larger_lanes(row, zero), last_y)
        found, _ = load_pairs(cells, row, column, width, 2 * layers, 0)
        moving = less(close, stretch * magnitude_lanes(found - depth))
        depth = found
        if not any_lane(moving):
            store_lanes(met, 0, row)
            store_lanes(met, LANES, column)
            store_lanes(met, 2 * LANES, zero)
            store_lanes(met, 3 * LANES, depth)
            return True
    return False
