"""Rays of red, green and blue behind a lens that parts colours: one march for all three where it serves them.

The rays of the three channels through one point of the pupil run side by side, mostly within a pixel of each
other. The green one is marched. Red and blue meet the same surface, a little beside, unless one of two things
is between: the surface ends there, or another one that green just misses stands before it. Both are told by
outlines: pixels at which a surface ends, kept for all pixels about them with the defocus that they have.
Where green is beside an outline at its defocus, it is looked whether red or blue are at one; these are
marched themselves.

Source: Wilkie, Nawaz, Droske, Weidlich and Hanika, "Hero wavelength spectral sampling", EGSR 2014, for one
path that serves several wavelengths. When it does, by outlines, is ours.
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

__all__ = ["KEPT", "REACHES", "follow", "keep_rays", "outlines_of", "reach_between", "with_neighbours"]

# Outlines are kept for pixels up to so many beside them; where channels run farther apart, each is marched.
REACHES = 4

# What is kept of a ray to be marched: where it begins, where it runs, the chance against coverage, its
# weights in front of and behind focus, and the share of it that is red.
KEPT = 8

_NEVER = 1e30
_CLOSE = np.float32(0.25)
_THRESHOLD = np.float32(DISCONTINUITY_THRESHOLD)


@njit(cache=True, forceinline=True)
def _goes_on(cells, y, x, depth):  # type: ignore[no-untyped-def]
    """Whether a surface of that defocus in a pixel next to (y, x) goes on there."""
    for layer in range(cells.shape[2]):
        if cells[y, x, layer, 1] >= 1.0 and abs(cells[y, x, layer, 0] - depth) <= DISCONTINUITY_THRESHOLD:
            return True
    return False


@njit(cache=True, forceinline=True)
def _is_smooth(cells, y, x):  # type: ignore[no-untyped-def]
    """Whether nothing is hidden at a pixel and its surface goes on in the first layer of all neighbours."""
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
def _fill_outlines(cells, outlines):  # type: ignore[no-untyped-def]
    """Fill ``outlines`` (H, W, 2) with the farthest and nearest surface of each pixel that ends beside it."""
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
                        ends = ends or not _goes_on(cells, v, u, depth)
                if ends:
                    low, high = min(low, depth), max(high, depth)
            outlines[y, x, 0], outlines[y, x, 1] = low, high


@njit(cache=True, parallel=True)
def _widen(outlines, wider):  # type: ignore[no-untyped-def]
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
    """Farthest and nearest defocus of outlines within 0, 1, ... pixels of each.

    Float32, (1 + REACHES, H, W, 2); where there is none the first is above the second.

    Args:
        cells: From :func:`bokehnet.classical.layered.march.intersection.layer_cells`.
    """
    outlines = np.empty((1 + REACHES, *cells.shape[:2], 2), np.float32)
    with parallel_region:
        _fill_outlines(cells, outlines[0])
        for reach in range(REACHES):
            _widen(outlines[reach], outlines[reach + 1])
    return outlines


def with_neighbours(bins: DefocusBins) -> DefocusBins:
    """Tiles that hold what those around them hold, too, so that no outline beside a ray is passed over."""
    rows, columns = bins.held.shape
    padded = np.pad(bins.held, 1)
    held = np.bitwise_or.reduce([padded[v : v + rows, u : u + columns] for v in range(3) for u in range(3)])
    return bins._replace(held=np.ascontiguousarray(held))


@njit(cache=True, forceinline=True)
def reach_between(ways, others, front, back):  # type: ignore[no-untyped-def]
    """How many pixels beside eight rays eight others run at most, 1 up; above ``REACHES`` if too many.

    Args:
        ways: Where they begin and how they run, lanes (begin_x, begin_y, a_x, a_y).
        others: Likewise.
        front: Nearest defocus that they pass.
        back: Farthest.
    """
    begin_x, begin_y = others[0] - ways[0], others[1] - ways[1]
    run_x, run_y = others[2] - ways[2], others[3] - ways[3]
    near, far = broadcast8(np.float32(front)), broadcast8(np.float32(back))
    apart = max8(
        max8(abs8(begin_x - run_x * near), abs8(begin_x - run_x * far)),
        max8(abs8(begin_y - run_y * near), abs8(begin_y - run_y * far)),
    )
    reach = 1
    while reach <= REACHES and any8(less8(broadcast8(np.float32(reach)), apart)):
        reach += 1
    return reach


@njit(cache=True, forceinline=True)
def follow(cells, size, x, y, way, hits, apart, places):  # type: ignore[no-untyped-def]
    """Find where eight rays meet the surfaces that eight others, next to them, have met.

    Args:
        cells: From :func:`bokehnet.classical.layered.march.intersection.layer_cells`, flat.
        size: Its height, width and number of layers.
        x: Columns of the rays' pixels, lanes.
        y: Rows.
        way: Where they begin and how they run, lanes (begin_x, begin_y, a_x, a_y).
        hits: What the others met, see :func:`bokehnet.classical.layered.march.intersection.intersect`.
        apart: Which of them were over other pixels at an outline, lanes of 1 and 0.
        places: Filled with rows, then columns of what these meet, float32.

    Returns:
        Which of them do meet it.
    """
    height, width, layers = size
    begin_x, begin_y, a_x, a_y = way
    zero, one, close = broadcast8(np.float32(0)), broadcast8(np.float32(1)), broadcast8(_CLOSE)
    last_x, last_y = broadcast8(np.float32(width - 1)), broadcast8(np.float32(height - 1))
    layer, met = load8(hits, 2 * LANES), load8(hits, 3 * LANES)
    known = and_not8(less8(apart, one), less8(layer, zero))
    layer = max8(layer, zero)
    start_x, start_y = x + begin_x, y + begin_y
    stretch, count = max8(abs8(a_x), abs8(a_y)), broadcast8(np.float32(layers))
    depth, found, cover = met, met, one
    row, column = zero, zero
    for _ in range(2):
        column = min8(max8(floor8(start_x - a_x * depth), zero), last_x)
        row = min8(max8(floor8(start_y - a_y * depth), zero), last_y)
        found, cover = gather_pairs8(cells, row, column * count + layer, width * layers, 2, 0)
        if not any8(and8(known, less8(close, stretch * abs8(found - depth)))):
            break
        depth = select8(less8(broadcast8(_THRESHOLD), abs8(found - met)), met, found)
    store8(places, 0, row)
    store8(places, LANES, column)
    known = and_not8(known, less8(broadcast8(_THRESHOLD), abs8(found - met)))
    return and_not8(known, less8(cover, one))


@njit(cache=True, forceinline=True)
def keep_rays(lost, way, chance, weights, red, work, kept, count):  # type: ignore[no-untyped-def]
    """Add those of eight rays that are to be marched to ``kept`` (KEPT, n), which holds ``count``.

    Args:
        lost: Which ones, lanes of 1 and 0.
        way: Where they begin and how they run, lanes (begin_x, begin_y, a_x, a_y).
        chance: Against coverage, lanes.
        weights: In front of and behind focus, lanes.
        red: 1 if they are red, 0 if they are blue.
        work: Room for (KEPT * LANES,) numbers.
        kept: Each number of all rays after the other, (KEPT * room,), with room for ``LANES`` rays more than
            there are to keep.
        count: How many it holds.

    Returns:
        How many it holds then.
    """
    room = kept.size // KEPT
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
            for i in range(KEPT - 1):
                kept[i * room + count] = work[i * LANES + lane]
            kept[(KEPT - 1) * room + count] = red
            count += 1
    return count
