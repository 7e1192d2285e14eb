"""Rays of red, green and blue behind a dispersive lens: one march for all three where possible.

The rays of the three channels through one point of the pupil run side by side, mostly within a pixel of each
other. Only the green ray is marched. Red and blue meet the same surface, at a nearby position, unless one of
two things is between: the surface ends, or another one that green just misses is in front of it. Outlines
detect both: they are pixels at which a surface ends, stored with their defocus for all pixels around them.
Where green is next to an outline at its defocus, red and blue are tested against the outline, and are marched
themselves if they are at one.

Source: Wilkie, Nawaz, Droske, Weidlich and Hanika, "Hero wavelength spectral sampling", EGSR 2014, for one
path that serves several wavelengths. The condition by outlines is ours.
"""

import numpy as np
from numba import prange

from bokehnet.classical.layered.depth_discontinuities import DISCONTINUITY_THRESHOLD
from bokehnet.classical.layered.march.defocus_bins import DefocusBins
from bokehnet.classical.parallel import parallel_region
from bokehnet.classical.simd.float8 import (
    LANES,
    abs8,
    and8,
    and_not8,
    any8,
    broadcast8,
    floor8,
    gather_pairs8,
    less8,
    load8,
    max8,
    min8,
    select8,
    store8,
)
from bokehnet.kernels import njit

__all__ = [
    "MAX_OUTLINE_REACH_PX",
    "RAY_FIELDS",
    "dilate_bins",
    "follow",
    "keep_rays",
    "outlines_of",
    "reach_between",
]

# Outlines are stored for pixels up to this distance; where channels are farther apart, each is marched.
MAX_OUTLINE_REACH_PX = 4

# Values stored per ray to be marched: origin, direction, random number for coverage, weights in front of and
# behind focus, and the fraction that is red.
RAY_FIELDS = 8

_NEVER = 1e30
_CLOSE_PX = np.float32(0.25)
_THRESHOLD = np.float32(DISCONTINUITY_THRESHOLD)


@njit(cache=True, forceinline=True)
def _continues(cells, y, x, depth):
    """Return whether a surface of this defocus, in a pixel next to (y, x), continues there."""
    for layer in range(cells.shape[2]):
        if cells[y, x, layer, 1] >= 1.0 and abs(cells[y, x, layer, 0] - depth) <= DISCONTINUITY_THRESHOLD:
            return True
    return False


@njit(cache=True, forceinline=True)
def _is_smooth(cells, y, x):
    """Return whether nothing is occluded at a pixel and its surface continues in all neighbours."""
    height, width, layers = cells.shape[:3]
    depth = cells[y, x, 0, 0]
    if cells[y, x, 0, 1] < 1.0 or cells[y, x, layers - 1, 0] != depth:
        return False
    for v in range(max(0, y - 1), min(height, y + 2)):
        for u in range(max(0, x - 1), min(width, x + 2)):
            if cells[v, u, 0, 1] < 1.0 or abs(cells[v, u, 0, 0] - depth) > DISCONTINUITY_THRESHOLD:
                return False
    return True


@njit(cache=True, parallel=True)
def _fill_outlines(cells, outlines):
    """Fill ``outlines`` (H, W, 2) with the farthest and nearest surface of each pixel that ends there."""
    height, width, layers = cells.shape[:3]
    for y in prange(height):
        for x in range(width):
            low, high = _NEVER, -_NEVER
            outlines[y, x, 0], outlines[y, x, 1] = low, high
            if _is_smooth(cells, y, x):
                continue
            for layer in range(layers):
                depth, cover = cells[y, x, layer, 0], cells[y, x, layer, 1]
                if cover <= 0.0 or (layer > 0 and depth == cells[y, x, layer - 1, 0] and cover >= 1.0):
                    continue
                ends = cover < 1.0
                for v in range(max(0, y - 1), min(height, y + 2)):
                    for u in range(max(0, x - 1), min(width, x + 2)):
                        ends = ends or not _continues(cells, v, u, depth)
                if ends:
                    low, high = min(low, depth), max(high, depth)
            outlines[y, x, 0], outlines[y, x, 1] = low, high


@njit(cache=True, parallel=True)
def _widen(outlines, wider):
    """Fill ``wider`` with the bounds over 3x3 pixels of ``outlines``, both (H, W, 2)."""
    height, width = outlines.shape[:2]
    for y in prange(height):
        for x in range(width):
            low, high = outlines[y, x]
            for v in range(max(0, y - 1), min(height, y + 2)):
                for u in range(max(0, x - 1), min(width, x + 2)):
                    low, high = min(low, outlines[v, u, 0]), max(high, outlines[v, u, 1])
            wider[y, x, 0], wider[y, x, 1] = low, high


def outlines_of(cells: np.ndarray) -> np.ndarray:
    """Return farthest and nearest defocus of outlines within 0, 1, ... pixels of each pixel.

    Float32, (1 + MAX_OUTLINE_REACH_PX, H, W, 2); where there is none the first is above the second.

    Args:
        cells: From :func:`bokehnet.classical.layered.march.intersection.layer_cells`.
    """
    outlines = np.empty((1 + MAX_OUTLINE_REACH_PX, *cells.shape[:2], 2), np.float32)
    with parallel_region:
        _fill_outlines(cells, outlines[0])
        for reach in range(MAX_OUTLINE_REACH_PX):
            _widen(outlines[reach], outlines[reach + 1])
    return outlines


def dilate_bins(bins: DefocusBins) -> DefocusBins:
    """Return bins in which tiles also contain those of adjacent tiles, so that no outline is skipped."""
    rows, columns = bins.held.shape
    padded = np.pad(bins.held, 1)
    held = np.bitwise_or.reduce([padded[v : v + rows, u : u + columns] for v in range(3) for u in range(3)])
    return bins._replace(held=np.ascontiguousarray(held))


@njit(cache=True, forceinline=True)
def reach_between(rays, others, front, back):
    """Return the distance of eight rays to eight others, in whole pixels from 1.

    Above ``MAX_OUTLINE_REACH_PX`` the value is not exact.

    Args:
        rays: Origins and directions, lanes (begin_x, begin_y, a_x, a_y).
        others: Origins and directions of the others, same lanes.
        front: Nearest defocus that they pass.
        back: Farthest defocus that they pass.
    """
    begin_x, begin_y = others[0] - rays[0], others[1] - rays[1]
    run_x, run_y = others[2] - rays[2], others[3] - rays[3]
    near, far = broadcast8(np.float32(front)), broadcast8(np.float32(back))
    distance = max8(
        max8(abs8(begin_x - run_x * near), abs8(begin_x - run_x * far)),
        max8(abs8(begin_y - run_y * near), abs8(begin_y - run_y * far)),
    )
    reach = 1
    while reach <= MAX_OUTLINE_REACH_PX and any8(less8(broadcast8(np.float32(reach)), distance)):
        reach += 1
    return reach


@njit(cache=True, forceinline=True)
def follow(cells, size, x, y, way, hits, apart, places):
    """Find where eight rays meet the surfaces that eight adjacent rays have met.

    Args:
        cells: From :func:`bokehnet.classical.layered.march.intersection.layer_cells`, flat.
        size: Height, width and number of layers of the cells.
        x: Columns of the rays' pixels, lanes.
        y: Rows of the rays' pixels, lanes.
        way: Origins and directions, lanes (begin_x, begin_y, a_x, a_y).
        hits: Hits of the others, see :func:`bokehnet.classical.layered.march.intersection.intersect`.
        apart: Mask of the others that were over other pixels at an outline, lanes of 1 and 0.
        places: Filled with rows, then columns of the hits, float32.

    Returns:
        Mask of the rays that meet the surface.
    """
    height, width, layers = size
    begin_x, begin_y, a_x, a_y = way
    zero, one, close = broadcast8(np.float32(0)), broadcast8(np.float32(1)), broadcast8(_CLOSE_PX)
    last_x, last_y = broadcast8(np.float32(width - 1)), broadcast8(np.float32(height - 1))
    layer, met = load8(hits, 2 * LANES), load8(hits, 3 * LANES)
    known = and_not8(less8(apart, one), less8(layer, zero))
    layer = max8(layer, zero)
    start_x, start_y = x + begin_x, y + begin_y
    stretch, count = max8(abs8(a_x), abs8(a_y)), broadcast8(np.float32(layers))
    depth, surface_depth, cover = met, met, one
    row, column = zero, zero
    for _ in range(2):
        column = min8(max8(floor8(start_x - a_x * depth), zero), last_x)
        row = min8(max8(floor8(start_y - a_y * depth), zero), last_y)
        surface_depth, cover = gather_pairs8(cells, row, column * count + layer, width * layers, 2, 0)
        if not any8(and8(known, less8(close, stretch * abs8(surface_depth - depth)))):
            break
        depth = select8(less8(broadcast8(_THRESHOLD), abs8(surface_depth - met)), met, surface_depth)
    store8(places, 0, row)
    store8(places, LANES, column)
    known = and_not8(known, less8(broadcast8(_THRESHOLD), abs8(surface_depth - met)))
    return and_not8(known, less8(cover, one))


@njit(cache=True, forceinline=True)
def keep_rays(lost, way, chance, weights, red, work, kept, count):
    """Append those of eight rays that must be marched to ``kept`` (RAY_FIELDS, n), which contains ``count``.

    Args:
        lost: Mask of the rays, lanes of 1 and 0.
        way: Origins and directions, lanes (begin_x, begin_y, a_x, a_y).
        chance: Random numbers for coverage, lanes.
        weights: Weights in front of and behind focus, lanes.
        red: 1 for red rays, 0 for blue rays.
        work: Buffer of (RAY_FIELDS * LANES,) values.
        kept: Each value of all rays in sequence, (RAY_FIELDS * room,), with room for ``LANES`` rays more
            than there are to append.
        count: Number of stored rays.

    Returns:
        New number of stored rays.
    """
    room = kept.size // RAY_FIELDS
    store8(work, 0, way[0])
    store8(work, LANES, way[1])
    store8(work, 2 * LANES, way[2])
    store8(work, 3 * LANES, way[3])
    store8(work, 4 * LANES, chance)
    store8(work, 5 * LANES, weights[0])
    store8(work, 6 * LANES, weights[1])
    store8(work, 7 * LANES, lost)
    for lane in range(LANES):
        if work[7 * LANES + lane] > 0.0:
            for i in range(RAY_FIELDS - 1):
                kept[i * room + count] = work[i * LANES + lane]
            kept[(RAY_FIELDS - 1) * room + count] = red
            count += 1
    return count
