"""Which surface of a stack of layers a ray meets first, for eight rays at once.

A ray starts at a place given by its pixel, and while the defocus s falls from front to back it runs along a
straight line of pixels. A layer whose defocus the ray crosses inside a pixel is met there. Between
neighbouring pixels a layer is one surface, a riser, when its defocus differs by no more than
``DISCONTINUITY_THRESHOLD``; else there is a depth discontinuity, through which rays pass behind the nearer
surface and meet what lies hidden there.

Where nothing is hidden and no depth discontinuity is near, a layer is one smooth surface, and the place where
a ray meets it is found in a few looks: :func:`intersect_smooth`.

Source: Lee, Eisemann and Seidel, "Real-time lens blur effects and focus control", ACM TOG 2010, for rays
through layered height fields; Amanatides and Woo, "A fast voxel traversal algorithm for ray tracing",
Eurographics 1987, for the walk along the pixels. Risers and coverage are ours.
"""

import numpy as np

from bokehnet.classical.layered.depth_discontinuities import DISCONTINUITY_THRESHOLD
from bokehnet.classical.layered.layers import Layers
from bokehnet.classical.simd.float8 import (
    LANES,
    abs8,
    and8,
    and_not8,
    any8,
    broadcast8,
    divide8,
    floor8,
    gather_pairs8,
    less8,
    max8,
    min8,
    select8,
    store8,
)
from bokehnet.kernels import njit

__all__ = ["intersect", "intersect_smooth", "layer_cells"]

_ZERO, _ONE = np.float32(0), np.float32(1)
_THRESHOLD = np.float32(DISCONTINUITY_THRESHOLD)
_NEVER = np.float32(-1e30)
_STEEPEST = np.float32(1e-6)  # rays that move less than this per pixel of defocus stay in their pixel
# The most looks of a ray at a smooth surface, and how many pixels may be between the last two.
_LOOKS, _CLOSE = 8, np.float32(0.25)


def layer_cells(layers: Layers) -> np.ndarray:
    """Defocus and coverage side by side, (H, W, L, 2), so that a look at a pixel reads one place."""
    return np.stack([layers.defocus, layers.coverage], axis=-1)


@njit(cache=True)
def intersect(cells, size, runs, count, x, y, begin_x, begin_y, u, v, chance, hits):  # type: ignore[no-untyped-def]
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
        hits: Rows, then columns, then layers, then defocus of eight surfaces, float32; layer -1 and defocus 0
            where there is none.
    """
    height, width, layers = size
    zero, one, threshold = broadcast8(_ZERO), broadcast8(_ONE), broadcast8(_THRESHOLD)
    last_x, last_y = broadcast8(np.float32(width - 1)), broadcast8(np.float32(height - 1))
    right, down = less8(zero, u), less8(zero, v)
    step_x, step_y = select8(right, one, zero - one), select8(down, one, zero - one)
    gain_x = divide8(one, max8(abs8(u), broadcast8(_STEEPEST)))
    gain_y = divide8(one, max8(abs8(v), broadcast8(_STEEPEST)))
    hit_row, hit_column, hit_layer, hit_depth = zero, zero, zero - one, zero
    waiting = less8(zero, one)
    for run in range(count):
        front = broadcast8(np.float32(runs[run, 0]))
        length = broadcast8(np.float32(runs[run, 0] - runs[run, 1]))
        place_x, place_y = begin_x - u * front, begin_y - v * front
        column, row = floor8(place_x), floor8(place_y)
        place_x, place_y = place_x - column, place_y - row
        to_x = select8(right, one - place_x, place_x) * gain_x
        to_y = select8(down, one - place_y, place_y) * gain_y
        column, row = x + column, y + row
        below = broadcast8(_NEVER)  # the nearest surface under the ray in the pixel before
        entry, marching = front, waiting
        while True:
            passed = min8(min8(to_x, to_y), length)
            leave = front - passed
            inside_x = min8(max8(column, zero), last_x)
            inside_y = min8(max8(row, zero), last_y)
            under = broadcast8(_NEVER)
            for layer in range(layers):
                depth, cover = gather_pairs8(cells, inside_y, inside_x, width, 2 * layers, 2 * layer)
                beneath = less8(depth, leave)
                under = select8(beneath, max8(under, depth), under)
                through_discontinuity = and8(less8(entry, depth), less8(threshold, depth - below))
                hit = and8(marching, less8(chance, cover))
                hit = and_not8(and_not8(hit, beneath), through_discontinuity)
                hit_row = select8(hit, inside_y, hit_row)
                hit_column = select8(hit, inside_x, hit_column)
                hit_layer = select8(hit, broadcast8(np.float32(layer)), hit_layer)
                hit_depth = select8(hit, depth, hit_depth)
                marching, waiting = and_not8(marching, hit), and_not8(waiting, hit)
            marching = and8(marching, less8(passed, length))
            if not any8(marching):
                break
            below, entry = under, leave
            across = less8(to_x, to_y)
            column = column + select8(across, step_x, zero)
            row = row + select8(across, zero, step_y)
            to_x = to_x + select8(across, gain_x, zero)
            to_y = to_y + select8(across, zero, gain_y)
        if not any8(waiting):
            break
    store8(hits, 0, hit_row)
    store8(hits, LANES, hit_column)
    store8(hits, 2 * LANES, hit_layer)
    store8(hits, 3 * LANES, hit_depth)


@njit(cache=True)
def intersect_smooth(cells, size, x, y, begin_x, begin_y, u, v, hits):  # type: ignore[no-untyped-def]
    """Write where eight rays meet the one smooth surface that there is; arguments as for :func:`intersect`.

    A ray meets it at the defocus s that the surface has at the ray's place for s. Each look at the surface
    gives a better s while it rises by less than a pixel of defocus per pixel.

    Returns:
        Whether all rays came to rest; if not, ``hits`` is of no use.
    """
    height, width, layers = size
    zero, close = broadcast8(_ZERO), broadcast8(_CLOSE)
    last_x, last_y = broadcast8(np.float32(width - 1)), broadcast8(np.float32(height - 1))
    stretch = max8(abs8(u), abs8(v))
    start_x, start_y = x + begin_x, y + begin_y
    depth, _ = gather_pairs8(cells, y, x, width, 2 * layers, 0)
    for _ in range(_LOOKS):
        column, row = floor8(start_x - u * depth), floor8(start_y - v * depth)
        column = min8(max8(column, zero), last_x)
        row = min8(max8(row, zero), last_y)
        found, _ = gather_pairs8(cells, row, column, width, 2 * layers, 0)
        moving = less8(close, stretch * abs8(found - depth))
        depth = found
        if not any8(moving):
            store8(hits, 0, row)
            store8(hits, LANES, column)
            store8(hits, 2 * LANES, zero)
            store8(hits, 3 * LANES, depth)
            return True
    return False
