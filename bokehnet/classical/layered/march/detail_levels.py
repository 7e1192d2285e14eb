"""Level of detail along a ray: the farther from focus, the smaller the layers that it marches through.

A surface that is blurred by r pixels shows no detail much finer than r. A ray therefore reads the layers at
full size only while its defocus is below ``DETAIL_RADIUS_PX``; between that and twice that, it reads layers
of half the size, and so on. The number of pixels that a ray passes grows with the logarithm of the radius
instead of the radius.

Source: Crassin et al., "Interactive indirect illumination using voxel cone tracing", 2011, for coarser cells
farther along a cone; the levels by defocus are ours.
"""

from typing import NamedTuple

import numpy as np

from bokehnet.classical.known_layers import Layers
from bokehnet.classical.layered.depth_discontinuities import DISCONTINUITY_THRESHOLD
from bokehnet.classical.layered.march.defocus_bins import BINS, bin_runs, occupied_bins
from bokehnet.classical.layered.march.intersection import intersect, layer_cells
from bokehnet.classical.layered.march.layer_reduction import half_layers
from bokehnet.classical.simd.float8 import (
    LANES,
    and_not8,
    any8,
    broadcast8,
    floor8,
    gather_triples8,
    less8,
    load8,
    select8,
    store8,
)
from bokehnet.kernels import njit

__all__ = ["DETAIL_RADIUS_PX", "DetailLevels", "detail_levels", "intersect_levels", "runs_of_levels"]

# Blur radius up to which rays read the layers at full size, pixels.
DETAIL_RADIUS_PX = 16.0

# Maximum number of halvings.
_MAX_HALVINGS = 5

# Overlap of the defocus ranges of two levels, pixels of the larger one. Surfaces that slope from one range
# into the other must have no gap.
_OVERLAP_PX = 1.5 * DISCONTINUITY_THRESHOLD


class DetailLevels(NamedTuple):
    """Layers of a picture at half its size, a quarter, and so on, one after the other.

    Attributes:
        cells: Cells of all levels, flat.
        colors: Colors of all levels, flat.
        held: Bins of the surfaces in each tile, of all levels, flat.
        bits: Bins that rays can meet, of all levels, flat.
        shapes: Height and width of each level, rows and columns of its tiles, (N, 4).
        offsets: Index in ``cells``, ``colors``, and ``held`` at which each level begins, (N, 3).
        bounds: Smallest defocus and thickness of a bin of each level, in its pixels, (N, 2).
        limits: Smallest blur radius of each level, pixels of the full size, (N,).
    """

    cells: np.ndarray
    colors: np.ndarray
    held: np.ndarray
    bits: np.ndarray
    shapes: np.ndarray
    offsets: np.ndarray
    bounds: np.ndarray
    limits: np.ndarray


def detail_levels(layers: Layers, radius: float, limit: float = DETAIL_RADIUS_PX) -> DetailLevels | None:
    """Return the smaller layers for rays of discs of up to ``radius`` pixels; ``None`` if none would be used.

    Args:
        layers: Layers at full size.
        radius: Largest blur radius, pixels.
        limit: Blur radius up to which the full size is read, pixels.
    """
    cells, colors, held, bits, shapes, bounds, limits = [], [], [], [], [], [], []
    while 2 * limit * 2 ** len(limits) <= radius and len(limits) < _MAX_HALVINGS:
        layers = half_layers(layers)
        level_cells = layer_cells(layers)
        bins = occupied_bins(level_cells)
        cells.append(level_cells.reshape(-1))
        colors.append(layers.colors.reshape(-1))
        held.append(bins.held.reshape(-1))
        bits.append(bins.bits.reshape(-1))
        shapes.append((*level_cells.shape[:2], *bins.held.shape))
        bounds.append((bins.low, bins.thickness))
        limits.append(limit * 2 ** len(limits))
    if not limits:
        return None
    offsets = [np.cumsum([0, *map(len, parts)])[:-1] for parts in (cells, colors, held)]
    return DetailLevels(
        cells=np.concatenate(cells),
        colors=np.concatenate(colors),
        held=np.concatenate(held),
        bits=np.concatenate(bits),
        shapes=np.array(shapes),
        offsets=np.stack(offsets, 1),
        bounds=np.array(bounds),
        limits=np.array(limits),
    )


@njit(cache=True)
def _clip_runs(runs, count, front, back, clipped):  # type: ignore[no-untyped-def]
    """Write the parts of runs between two values of the defocus to ``clipped``; return their number."""
    kept = 0
    for run in range(count):
        high, low = min(runs[run, 0], front), max(runs[run, 1], back)
        if high > low:
            clipped[kept, 0], clipped[kept, 1] = high, low
            kept += 1
    return kept


@njit(cache=True)
def runs_of_levels(levels, bins, tile_row, tile_column, runs, level_runs, level_counts):  # type: ignore[no-untyped-def]
    """Write the ranges of the defocus in which the rays of a tile can meet a surface, for each level.

    Args:
        levels: From :func:`detail_levels`.
        bins: Bins of the full size.
        tile_row: Row of the tile.
        tile_column: Column of the tile.
        runs: Work space, (BINS / 2, 2).
        level_runs: Ranges, front to back, in pixels of their level: the smallest size in front of focus
            first, the full size in the middle, the smallest size behind focus last, (2 N + 1, BINS, 2).
        level_counts: Number of ranges, (2 N + 1,).
    """
    number = len(levels.limits)
    count = bin_runs(bins.bits[tile_row, tile_column], bins.low, bins.thickness, runs)
    middle = levels.limits[0] + _OVERLAP_PX
    level_counts[number] = _clip_runs(runs, count, middle, -middle, level_runs[number])
    for level in range(number):
        scale = 0.5 ** (level + 1)
        row = min(tile_row >> (level + 1), levels.shapes[level, 2] - 1)
        column = min(tile_column >> (level + 1), levels.shapes[level, 3] - 1)
        bits = levels.bits[levels.offsets[level, 2] + row * levels.shapes[level, 3] + column]
        count = bin_runs(bits, levels.bounds[level, 0], levels.bounds[level, 1], runs)
        near, far = scale * levels.limits[level], np.inf
        if level + 1 < number:
            far = scale * levels.limits[level + 1] + _OVERLAP_PX
        level_counts[number - 1 - level] = _clip_runs(runs, count, far, near, level_runs[number - 1 - level])
        level_counts[number + 1 + level] = _clip_runs(runs, count, -near, -far, level_runs[number + 1 + level])


@njit(cache=True)
def intersect_levels(cells, colors, size, tiles, levels, level_runs, level_counts, x, y, u, v, chance, hits):  # type: ignore[no-untyped-def]
    """Write the first surface on each of eight rays of a perfect lens, and return their colors, lanes.

    Arguments are those of :func:`bokehnet.classical.layered.march.intersection.intersect`; rows and columns
    in ``hits`` are those of the level in which a ray meets its surface, its defocus that of the full size.
    """
    zero, one, half = broadcast8(np.float32(0)), broadcast8(np.float32(1)), broadcast8(np.float32(0.5))
    waiting = less8(zero, one)
    red, green, blue, depth, layer = zero, zero, zero, zero, zero - one
    number = len(levels.limits)
    for part in range(2 * number + 1):
        if level_counts[part] == 0:
            continue
        level = abs(part - number)
        if level == 0:
            intersect(
                *(cells, size, tiles, level_runs[part], level_counts[part]),
                *(broadcast8(np.float32(x)), broadcast8(np.float32(y)), half, half, u, v, chance, hits),
                *(None, (waiting,)),
            )
            hit_layer = load8(hits, 2 * LANES)
            new = and_not8(waiting, less8(hit_layer, zero))
            if any8(new):
                light = gather_triples8(
                    colors, load8(hits, 0), load8(hits, LANES), select8(new, hit_layer, zero), size[1], size[2]
                )
        else:
            scale = 0.5**level
            height, width, rows, columns = levels.shapes[level - 1]
            first, first_color, first_tile = levels.offsets[level - 1]
            place_x, place_y = (x + 0.5) * scale, (y + 0.5) * scale
            column, row = np.floor(place_x), np.floor(place_y)
            level_size = (height, width, size[2])
            low, thickness = levels.bounds[level - 1]
            level_tiles = (levels.held[first_tile:], rows, columns, low, 1.0 / thickness)
            intersect(
                *(levels.cells[first:], level_size, level_tiles, level_runs[part], level_counts[part]),
                *(broadcast8(np.float32(column)), broadcast8(np.float32(row))),
                *(broadcast8(np.float32(place_x - column)), broadcast8(np.float32(place_y - row))),
                *(u, v, chance, hits, None, (waiting,)),
            )
            hit_layer = load8(hits, 2 * LANES)
            new = and_not8(waiting, less8(hit_layer, zero))
            if any8(new):
                light = gather_triples8(
                    levels.colors[first_color:],
                    *(load8(hits, 0), load8(hits, LANES), select8(new, hit_layer, zero), width, size[2]),
                )
        chance = load8(hits, 4 * LANES)
        if any8(new):
            red, green, blue = (
                select8(new, light[0], red),
                select8(new, light[1], green),
                select8(new, light[2], blue),
            )
            depth = select8(new, load8(hits, 3 * LANES) * broadcast8(np.float32(2.0**level)), depth)
            layer = select8(new, hit_layer, layer)
            waiting = and_not8(waiting, new)
            if not any8(waiting):
                break
    store8(hits, 2 * LANES, layer)
    store8(hits, 3 * LANES, depth)
    return red, green, blue
