"""Bins of the defocus in which the rays of a tile of the picture can meet a surface.

Most of a ray's length is empty. A histogram of the defocus in each tile gives the bins that can contain a
surface for the rays of a tile; a ray is marched through those alone. Where no occluded surface can be met and
no surface is steep, only the first layer is tested.

Source: Decoret, "N-buffers for efficient depth map query", Computer Graphics Forum 2005, for bounds on a
footprint. DefocusBins are ours.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numba import prange

from bokehnet.classical.layered.depth_discontinuities import DISCONTINUITY_THRESHOLD
from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit

__all__ = [
    "BINS",
    "STEEP",
    "TILE",
    "DefocusBins",
    "bin_runs",
    "occupied_bins",
    "perfect_lens_reach",
    "tile_sets",
]

TILE = 8
BINS = 64

# Change of the defocus per pixel that counts as steep. At 1 a ray can meet a surface at several positions; on
# soft disparity maps, errors occurred down to a half.
STEEP = 0.25

# Bins within reach are found for tiles enlarged until discs reach over no more of them than this.
_MAX_REACH_TILES = 12

# Surfaces of adjacent pixels are connected up to this difference; the factor covers float32 rounding.
_RISER = 1.01 * DISCONTINUITY_THRESHOLD


class DefocusBins(NamedTuple):
    """Bins in which rays can meet a surface, by tile of the pixels of the rays.

    Attributes:
        bits: Bins of defocus in which they can, (rows, columns) uint64.
        smooth: True where no surface is occluded by the first and the first is nowhere steep, (rows, columns)
            bool.
        held: Bins of the surfaces in the tile itself, or within the height of a riser, (rows, columns)
            uint64.
        low: Smallest defocus.
        thickness: Defocus range of a bin.
    """

    bits: np.ndarray
    smooth: np.ndarray
    held: np.ndarray
    low: float
    thickness: float


@njit(cache=True)
def _bin_of(value, low, scale):
    return min(max(int((value - low) * scale), 0), BINS - 1)


@njit(cache=True)
def _fill_bins(first, second, low, scale):
    """Return the bits of all bins between two values of the defocus."""
    a, b = _bin_of(min(first, second), low, scale), _bin_of(max(first, second), low, scale)
    every = np.uint64(0xFFFFFFFFFFFFFFFF)
    return every << np.uint64(a) & every >> np.uint64(BINS - 1 - b)


@njit(cache=True, parallel=True)
def _tile_bins(cells, low, scale):
    """Return the bins of defocus that each tile contains in any layer, risers included; (3, rows, columns).

    The second set contains the pixels of which more than the first layer can be hit, or where that is steep;
    the third is ``held`` of :class:`DefocusBins`.
    """
    height, width, layers = cells.shape[:3]
    bits = np.zeros((3, (height + TILE - 1) // TILE, (width + TILE - 1) // TILE), np.uint64)
    for row in prange(bits.shape[1]):
        for y in range(row * TILE, min(height, (row + 1) * TILE)):
            for x in range(width):
                pixel_bits, held, layered = np.uint64(0), np.uint64(0), cells[y, x, 0, 1] < 1
                for layer in range(layers):
                    value = cells[y, x, layer, 0]
                    layered = layered or value != cells[y, x, 0, 0]
                    pixel_bits |= np.uint64(1) << np.uint64(_bin_of(value, low, scale))
                    held |= _fill_bins(value - _RISER, value + _RISER, low, scale)
                    for right, below in ((1, 0), (0, 1)):
                        if x + right == width or y + below == height:
                            continue
                        other = cells[y + below, x + right, layer, 0]
                        layered = layered or abs(other - value) > STEEP
                        if abs(other - value) <= DISCONTINUITY_THRESHOLD:
                            pixel_bits |= _fill_bins(value, other, low, scale)
                bits[0, row, x // TILE] |= pixel_bits
                bits[2, row, x // TILE] |= held
                if layered:
                    bits[1, row, x // TILE] |= pixel_bits
    return bits


@njit(cache=True, parallel=True)
def _reached_bins(own, side, reaches, frame):
    """Return the bits (2, rows, columns) of all bins with a surface within its blur's reach of each tile.

    ``side``: side of a tile, pixels. ``reaches``: reach of the rays by ring and bin, pixels, (rings, BINS).
    ``frame``: see :func:`occupied_bins`.
    """
    rows, columns = own.shape[1:]
    rings, max_tiles = reaches.shape[0], max(rows, columns)
    tiles = np.empty(rings, np.int64)
    for ring in range(rings):
        tiles[ring] = min(int(math.ceil(reaches[ring].max() / side)) + 1, max_tiles)
    widest = tiles.max()
    near = np.zeros((rings, (widest + 1) * (widest + 1) * 2), np.uint64)  # by squared distance in tiles
    for ring in range(rings):
        for square in range(near.shape[1]):
            gap = max(0.0, math.sqrt(square) - math.sqrt(2.0)) * side
            for i in range(BINS):
                if reaches[ring, i] + 1.0 >= gap:
                    near[ring, square] |= np.uint64(1) << np.uint64(i)
    reached = np.empty((2, rows, columns), np.uint64)
    for row in prange(rows):
        for column in range(columns):
            away_x = (column + 0.5) * side - 0.5 - frame[0]
            away_y = (row + 0.5) * side - 0.5 - frame[1]
            away = math.sqrt(away_x * away_x + away_y * away_y) * frame[2]
            ring = min(int(away * rings), rings - 1)
            reach = tiles[ring]
            bits, layered = np.uint64(0), np.uint64(0)
            for v in range(max(0, row - reach), min(rows, row + reach + 1)):
                for u in range(max(0, column - reach), min(columns, column + reach + 1)):
                    within = near[ring, (v - row) * (v - row) + (u - column) * (u - column)]
                    bits |= own[0, v, u] & within
                    layered |= own[1, v, u] & within
            reached[0, row, column] = bits
            reached[1, row, column] = layered
    return reached


def _joined_tiles(sets: np.ndarray) -> np.ndarray:
    """Return the bits of squares of 2x2 tiles, (2, rows, columns)."""
    padded = np.pad(sets, ((0, 0), (0, sets.shape[1] % 2), (0, sets.shape[2] % 2)))
    pairs = padded[:, ::2] | padded[:, 1::2]
    joined: np.ndarray = pairs[:, :, ::2] | pairs[:, :, 1::2]
    return np.ascontiguousarray(joined)


def perfect_lens_reach(defocus: np.ndarray) -> np.ndarray:
    """Return the reach of the rays of a perfect lens by defocus, pixels; one ring."""
    return np.abs(defocus)[None]


def occupied_bins(
    cells: np.ndarray,
    reach_at: Callable[[np.ndarray], np.ndarray] = perfect_lens_reach,
    frame: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> DefocusBins:
    """Return, for each tile, the bins of defocus in which its rays can meet a surface.

    Args:
        cells: From :func:`bokehnet.classical.layered.march.intersection.layer_cells`.
        reach_at: Function of a defocus (n,) that returns the distance from a pixel at which its rays meet a
            surface there, pixels, for rings of one width around the centre of the picture, (rings, n). It
            must be convex.
        frame: Column and row of the centre, and the reciprocal of the outer radius of the last ring in
            pixels; pixels beyond belong to the last ring.
    """
    depths = cells[..., 0]
    low, high = float(depths.min()) - 1e-3, float(depths.max()) + 1e-3
    thickness = (high - low) / BINS
    ends = np.asarray(reach_at(low + thickness * np.arange(BINS + 1)), np.float64)
    reaches = np.maximum(ends[:, :-1], ends[:, 1:])
    with parallel_region:
        own = _tile_bins(cells, low, 1.0 / thickness)
    sets, side = own[:2], TILE
    while reaches.max() > _MAX_REACH_TILES * side:
        sets, side = _joined_tiles(sets), 2 * side
    with parallel_region:
        reached = _reached_bins(sets, side, reaches, tuple(map(float, frame)))
    if side > TILE:
        rows, columns = own.shape[1:]
        reached = np.repeat(np.repeat(reached, side // TILE, 1), side // TILE, 2)[:, :rows, :columns]
    bits, layered = np.ascontiguousarray(reached)
    return DefocusBins(bits=bits, smooth=layered == 0, held=own[2], low=low, thickness=thickness)


@njit(cache=True, forceinline=True)
def tile_sets(bins):
    """Return the tile data that rays read: ``held``, flat; rows, columns; lowest defocus, bins per pixel."""
    return bins.held.reshape(-1), bins.held.shape[0], bins.held.shape[1], bins.low, 1.0 / bins.thickness


@njit(cache=True)
def bin_runs(bits, low, thickness, runs):
    """Write the runs of set bits as pairs (front, back) of defocus, front to back; return their number."""
    count = 0
    i = BINS - 1
    while i >= 0:
        if bits >> np.uint64(i) & np.uint64(1):
            j = i
            while j > 0 and bits >> np.uint64(j - 1) & np.uint64(1):
                j -= 1
            runs[count, 0] = low + (i + 1) * thickness
            runs[count, 1] = low + j * thickness
            count += 1
            i = j
        i -= 1
    return count
