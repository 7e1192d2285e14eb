"""First intersection of a ray with a stack of layers, for eight rays at once.

A ray starts at a position given by its pixel; while the defocus s falls from front to back it follows a
straight line of pixels. It meets a layer if it crosses the layer's defocus inside a pixel. Between adjacent
pixels a layer is one surface, a riser, if its defocus differs by no more than ``DISCONTINUITY_THRESHOLD``;
otherwise there is a depth discontinuity, through which rays pass behind the nearer surface and meet the
occluded background. A surface that covers its pixel in part has no riser: rays that enter behind it have
already passed it, and blades of grass in a row, at slightly different depths, are not a wall.

Where nothing is occluded and no depth discontinuity is near, a layer is one smooth surface, and a few
iterations find the intersection: :func:`intersect_smooth`.

Source: Lee, Eisemann and Seidel, "Real-time lens blur effects and focus control", ACM TOG 2010, for rays
through layered height fields; Amanatides and Woo, "A fast voxel traversal algorithm for ray tracing",
Eurographics 1987, for the traversal of the pixels. Risers and coverage are ours.
"""

import numpy as np
from numba import prange

from bokehnet.classical.layered.boundaries.pixel_boundaries import coverage_at, with_slopes
from bokehnet.classical.layered.depth_discontinuities import DISCONTINUITY_THRESHOLD
from bokehnet.classical.layered.layers import Layers
from bokehnet.classical.layered.march.defocus_bins import BINS, TILE
from bokehnet.classical.parallel import parallel_region
from bokehnet.classical.simd.bits8 import meets8
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

__all__ = [
    "BELOW_ONE",
    "CLOSE",
    "HIDES_NOTHING",
    "LOOKS",
    "SHORT",
    "STEEPEST",
    "intersect",
    "intersect_smooth",
    "layer_cells",
]

_ZERO, _HALF, _ONE = np.float32(0), np.float32(0.5), np.float32(1)
_THRESHOLD = np.float32(DISCONTINUITY_THRESHOLD)
_NEVER = np.float32(-1e30)
BELOW_ONE = np.float32(1 - 2**-24)  # the largest random number
_TILE_SIDE, _TILES_PER_PX, _LAST_BIN = np.float32(TILE), np.float32(1 / TILE), np.float32(BINS - 1)
SHORT = 16.0  # defocus range, pixels, from which on skipping tiles is faster
STEEPEST = np.float32(1e-6)  # rays that move less than this per pixel of defocus stay in their pixel
# Maximum iterations on a smooth surface, and the distance of the last two positions at convergence, pixels.
LOOKS, CLOSE = 8, np.float32(0.25)
# Coverage of a layer that has no other surface behind it at that pixel.
HIDES_NOTHING = np.float32(2)


@njit(cache=True, parallel=True)
def _fill_cells(defocus, coverage, cells):
    """Write defocus and coverage, (H, W, L), to ``cells``, (H, W, L, 2); see :func:`layer_cells`."""
    height, width, layers = defocus.shape
    for y in prange(height):
        for x in range(width):
            hides_nothing = True
            for layer in range(layers - 1, -1, -1):
                own = coverage[y, x, layer]
                if layer < layers - 1:
                    hides_nothing = (
                        hides_nothing
                        and coverage[y, x, layer + 1] >= 1.0
                        and own >= 1.0
                        and defocus[y, x, layer] == defocus[y, x, layer + 1]
                    )
                    if hides_nothing:
                        own = HIDES_NOTHING
                cells[y, x, layer, 0], cells[y, x, layer, 1] = defocus[y, x, layer], own


def layer_cells(layers: Layers) -> np.ndarray:
    """Return defocus and coverage interleaved, (H, W, L, 2), so that a lookup reads one address.

    Coverage includes its slope inside the pixel, see
    :mod:`bokehnet.classical.layered.boundaries.pixel_boundaries`; where no other surface is behind a layer it
    is ``HIDES_NOTHING``.
    """
    cells = np.empty((*layers.defocus.shape, 2), np.float32)
    coverage = with_slopes(layers.defocus, layers.coverage)
    with parallel_region:
        _fill_cells(layers.defocus, coverage, cells)
    return cells


@njit(cache=True, forceinline=True)
def _at_other_outline(where, way, column, row):
    """Return the mask of rays at an outline in another pixel than the adjacent rays, which cross theirs.

    Args:
        where: Columns and rows of the rays' pixels, the defocus at which the others enter and leave the pixel
            that they cross, lanes; outlines of each pixel alone, flat; size of the cells.
        way: Origins and directions of the rays, lanes (begin_x, begin_y, a_x, a_y).
        column: Column of the pixel that the others cross.
        row: Row of the pixel that the others cross.
    """
    x, y, entry, leave, outlines, size = where
    half, zero = broadcast8(_HALF), broadcast8(_ZERO)
    depth = half * (entry + leave)
    across, down = x + floor8(way[0] - way[2] * depth), y + floor8(way[1] - way[3] * depth)
    away = less8(half, max8(abs8(across - column), abs8(down - row)))
    across = min8(max8(across, zero), broadcast8(np.float32(size[1] - 1)))
    down = min8(max8(down, zero), broadcast8(np.float32(size[0] - 1)))
    low, high = gather_pairs8(outlines, down, across, size[1], 2, 0)
    return and_not8(and_not8(away, less8(entry, low)), less8(high, leave))


@njit(cache=True)
def intersect(cells, size, tiles, runs, count, x, y, begin_x, begin_y, u, v, chance, hits, outlines=None):
    """Write the first surface on each of eight rays.

    Positions beyond the border read the border's pixel. In long ranges of the defocus, tiles in which a ray
    can meet nothing are skipped in one step.

    Args:
        cells: From :func:`layer_cells`, flat.
        size: Height, width and number of layers of the cells.
        tiles: From :func:`bokehnet.classical.layered.march.defocus_bins.tile_sets`.
        runs: Ranges (front, back) of the defocus that can contain a surface, front to back.
        count: Number of runs.
        x: Columns of the rays' pixels, lanes of float32.
        y: Rows of the rays' pixels, lanes.
        begin_x: Position of the rays at defocus 0, from the left side of their pixel, lanes; 1/2 is its
            centre.
        begin_y: Position from the upper side of their pixel, lanes.
        u: Position of the rays in the pupil, aperture coordinate along x, lanes.
        v: Aperture coordinate along y, lanes.
        chance: Random number per ray: a surface is met if it is below the coverage c at that position of the
            pixel, lanes, 0 up to 1. Behind it (chance - c) / (1 - c) is used, so that each surface is met
            with the probability of its own coverage, whatever is in front of it.
        hits: Rows, then columns, then layers, then defocus of eight surfaces, float32; layer -1 and defocus 0
            where there is none.
        outlines: If not None, two more rays run next to each, and ``hits`` continues with a mask of those
            that are at an outline in another pixel: 1, else 0. A tuple: farthest and nearest defocus of
            outlines, see ``outlines_of`` of :mod:`bokehnet.classical.layered.march.channel_rays`, flat;
            offset in it of the outlines within reach; origins and directions of the two, lanes (begin_x,
            begin_y, a_x, a_y).
    """
    height, width, layers = size
    occupied, tile_rows, tile_columns, lowest_bin, scale = tiles
    zero, one, threshold = broadcast8(_ZERO), broadcast8(_ONE), broadcast8(_THRESHOLD)
    hides_nothing = broadcast8(HIDES_NOTHING)
    half, below_one = broadcast8(_HALF), broadcast8(BELOW_ONE)
    never, side, lowest = broadcast8(_NEVER), broadcast8(_TILE_SIDE), broadcast8(np.float32(lowest_bin))
    per_bin, last_bin = broadcast8(np.float32(scale)), broadcast8(_LAST_BIN)
    last_x, last_y = broadcast8(np.float32(width - 1)), broadcast8(np.float32(height - 1))
    last_tile_x, last_tile_y = broadcast8(np.float32(tile_columns - 1)), broadcast8(np.float32(tile_rows - 1))
    right, down = less8(zero, u), less8(zero, v)
    step_x, step_y = select8(right, one, zero - one), select8(down, one, zero - one)
    gain_x = divide8(one, max8(abs8(u), broadcast8(STEEPEST)))
    gain_y = divide8(one, max8(abs8(v), broadcast8(STEEPEST)))
    tile_gain_x, tile_gain_y = side * gain_x, side * gain_y
    hit_row, hit_column, hit_layer, hit_depth = zero, zero, zero - one, zero
    waiting = less8(zero, one)
    first_apart, second_apart = zero, zero
    for run in range(count):
        front = broadcast8(np.float32(runs[run, 0]))
        length = broadcast8(np.float32(runs[run, 0] - runs[run, 1]))
        place_x, place_y = begin_x - u * front, begin_y - v * front
        column, row = floor8(place_x), floor8(place_y)
        part_x, part_y = place_x - column, place_y - row
        column, row = x + column, y + row
        tile_x, tile_y = floor8(column * broadcast8(_TILES_PER_PX)), floor8(row * broadcast8(_TILES_PER_PX))
        part_x, part_y = column - side * tile_x + part_x, row - side * tile_y + part_y
        tile_to_x = select8(right, side - part_x, part_x) * gain_x
        tile_to_y = select8(down, side - part_y, part_y) * gain_y
        if runs[run, 0] - runs[run, 1] < SHORT:  # traversed without skipping tiles
            tile_to_x = tile_to_y = length
        below = never  # the nearest surface under the ray in the previous pixel
        passed, marching = zero, waiting
        while True:
            seeking = marching
            while runs[run, 0] - runs[run, 1] >= SHORT and any8(seeking):
                end = min8(min8(tile_to_x, tile_to_y), length)
                first = (front - end - lowest) * per_bin
                last = (front - passed - lowest) * per_bin
                occupied_here = meets8(
                    occupied,
                    min8(max8(tile_y, zero), last_tile_y),
                    min8(max8(tile_x, zero), last_tile_x),
                    tile_columns,
                    min8(max8(first, zero), last_bin),
                    min8(max8(last, zero), last_bin),
                )
                seeking = and_not8(seeking, occupied_here)
                below = select8(seeking, never, below)
                passed = select8(seeking, end, passed)
                ended = and_not8(seeking, less8(end, length))
                marching, seeking = and_not8(marching, ended), and_not8(seeking, ended)
                across = less8(tile_to_x, tile_to_y)
                step = and8(seeking, across)
                tile_x = select8(step, tile_x + step_x, tile_x)
                tile_to_x = select8(step, tile_to_x + tile_gain_x, tile_to_x)
                step = and_not8(seeking, across)
                tile_y = select8(step, tile_y + step_y, tile_y)
                tile_to_y = select8(step, tile_to_y + tile_gain_y, tile_to_y)
            if not any8(marching):
                break
            end = min8(min8(tile_to_x, tile_to_y), length)
            start, within = front - passed, end - passed
            place_x, place_y = begin_x - u * start, begin_y - v * start
            column, row = floor8(place_x), floor8(place_y)
            place_x, place_y = place_x - column, place_y - row
            to_x = select8(right, one - place_x, place_x) * gain_x
            to_y = select8(down, one - place_y, place_y) * gain_y
            column, row = x + column, y + row
            entry, walking = start, marching
            while True:
                gone = min8(min8(to_x, to_y), within)
                leave = start - gone
                inside_x = min8(max8(column, zero), last_x)
                inside_y = min8(max8(row, zero), last_y)
                under = never
                if outlines is not None:
                    low, high = gather_pairs8(outlines[0], inside_y, inside_x, width, 2, outlines[1])
                    at_outline = and_not8(and_not8(walking, less8(entry, low)), less8(high, leave))
                    if any8(at_outline):
                        ways = (x, y, entry, leave, outlines[0], size)
                        first = and8(at_outline, _at_other_outline(ways, outlines[2], column, row))
                        second = and8(at_outline, _at_other_outline(ways, outlines[3], column, row))
                        first_apart = select8(first, one, first_apart)
                        second_apart = select8(second, one, second_apart)
                for layer in range(layers):
                    depth, cover = gather_pairs8(cells, inside_y, inside_x, width, 2 * layers, 2 * layer)
                    hides = less8(cover, hides_nothing)
                    beneath = less8(depth, leave)
                    under = select8(beneath, max8(under, depth), under)
                    partly = and8(less8(zero, cover), less8(cover, one))
                    apart = select8(partly, zero - never, depth - below)
                    through_discontinuity = and8(less8(entry, depth), less8(threshold, apart))
                    crossed = and_not8(and_not8(walking, beneath), through_discontinuity)
                    hit, veiled = and8(crossed, less8(chance, cover)), and8(crossed, partly)
                    if any8(veiled):
                        away_x = x + begin_x - u * depth - column - half
                        away_y = y + begin_y - v * depth - row - half
                        cover = select8(partly, max8(coverage_at(cover, away_x, away_y), zero), cover)
                        hit = and8(crossed, less8(chance, cover))
                        rest = divide8(chance - cover, one - min8(cover, below_one))
                        missed = and_not8(veiled, hit)
                        chance = select8(missed, min8(rest, below_one), chance)
                    hit_row = select8(hit, inside_y, hit_row)
                    hit_column = select8(hit, inside_x, hit_column)
                    hit_layer = select8(hit, broadcast8(np.float32(layer)), hit_layer)
                    hit_depth = select8(hit, depth, hit_depth)
                    walking, marching = and_not8(walking, hit), and_not8(marching, hit)
                    waiting = and_not8(waiting, hit)
                    if layer + 1 < layers and not any8(and8(walking, hides)):
                        break
                below, entry = select8(walking, under, below), leave
                walking = and8(walking, less8(gone, within))
                if not any8(walking):
                    break
                across = less8(to_x, to_y)
                column = column + select8(across, step_x, zero)
                row = row + select8(across, zero, step_y)
                to_x = to_x + select8(across, gain_x, zero)
                to_y = to_y + select8(across, zero, gain_y)
            marching = and8(marching, less8(end, length))
            if not any8(marching):
                break
            passed = end
            across = less8(tile_to_x, tile_to_y)
            tile_x = tile_x + select8(across, step_x, zero)
            tile_y = tile_y + select8(across, zero, step_y)
            tile_to_x = tile_to_x + select8(across, tile_gain_x, zero)
            tile_to_y = tile_to_y + select8(across, zero, tile_gain_y)
        if not any8(waiting):
            break
    store8(hits, 0, hit_row)
    store8(hits, LANES, hit_column)
    store8(hits, 2 * LANES, hit_layer)
    store8(hits, 3 * LANES, hit_depth)
    if outlines is not None:
        store8(hits, 4 * LANES, first_apart)
        store8(hits, 5 * LANES, second_apart)


@njit(cache=True)
def intersect_smooth(cells, size, x, y, begin_x, begin_y, u, v, hits):
    """Write where eight rays meet the only, smooth surface; arguments as for :func:`intersect`.

    A ray meets the surface at the defocus s that the surface has at the ray's position for s. Each iteration
    improves s while the surface rises by less than a pixel of defocus per pixel.

    Returns:
        True if all rays converged; otherwise ``hits`` is invalid.
    """
    height, width, layers = size
    zero, close = broadcast8(_ZERO), broadcast8(CLOSE)
    last_x, last_y = broadcast8(np.float32(width - 1)), broadcast8(np.float32(height - 1))
    stretch = max8(abs8(u), abs8(v))
    start_x, start_y = x + begin_x, y + begin_y
    depth, _ = gather_pairs8(cells, y, x, width, 2 * layers, 0)
    for _ in range(LOOKS):
        column, row = floor8(start_x - u * depth), floor8(start_y - v * depth)
        column = min8(max8(column, zero), last_x)
        row = min8(max8(row, zero), last_y)
        surface_depth, _ = gather_pairs8(cells, row, column, width, 2 * layers, 0)
        moving = less8(close, stretch * abs8(surface_depth - depth))
        depth = surface_depth
        if not any8(moving):
            store8(hits, 0, row)
            store8(hits, LANES, column)
            store8(hits, 2 * LANES, zero)
            store8(hits, 3 * LANES, depth)
            return True
    return False
