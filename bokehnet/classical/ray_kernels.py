"""Numba kernels that march pupil rays through a stack of layers seen as height fields.

The ray that meets the pupil in aperture coordinate a and the pixel p lies, at defocus s, over the place
``p - s * a`` of the picture; :mod:`bokehnet.classical.meeting` tells what it meets.

Most of a ray's length is empty. A histogram of the defocus in each tile of the picture tells which slices
of s can hold a surface for the rays of a tile at all; a ray is marched through those alone.

Source: Lee, Eisemann and Seidel, "Real-time lens blur effects and focus control", ACM TOG 2010, for rays
through layered height fields; Decoret, "N-buffers for efficient depth map query", Computer Graphics Forum
2005, for the bounds on a footprint. Slices are ours.
"""

import math

import numpy as np
from numba import njit, prange

from bokehnet.classical.gaps import JUMP
from bokehnet.classical.lane_logic import floor_lanes
from bokehnet.classical.lanes import LANES, load_lanes, splat_lanes
from bokehnet.classical.layers import Layers
from bokehnet.classical.meeting import meet
from bokehnet.classical.parallel import parallel_region
from bokehnet.optics.aperture import cats_eye_shift

__all__ = [
    "FILTERED_RADIUS",
    "SETS",
    "SLICES",
    "TILE",
    "fair_stride",
    "march",
    "occupied_slices",
    "slice_runs",
]


TILE = 8
SLICES = 64

# Discs of at least this radius change so slowly that their rays may be averaged with the 8 neighbours'.
FILTERED_RADIUS = 4.0

# Rows worked at a time, so that the sums stay small.
_STRIP = 256

# The pixels of a 3x3 block take different pupil points.
SETS = 9

# Multiples of the golden ratio, without their whole parts: evenly spread chances for the rays of a pixel.
_GOLDEN = 0.6180339887498949


@njit(cache=True)
def _slice_of(value, low, scale):  # type: ignore[no-untyped-def]
    return min(max(int((value - low) * scale), 0), SLICES - 1)


@njit(cache=True)
def _fill_slices(first, second, low, scale):  # type: ignore[no-untyped-def]
    """Bits of all slices between two values of the defocus."""
    a, b = _slice_of(min(first, second), low, scale), _slice_of(max(first, second), low, scale)
    bits = np.uint64(0)
    for i in range(a, b + 1):
        bits |= np.uint64(1) << np.uint64(i)
    return bits


@njit(cache=True, parallel=True)
def _tile_slices(depths, low, scale):  # type: ignore[no-untyped-def]
    """Which slices of defocus each tile holds in any layer, risers included; (rows, columns) of bits."""
    height, width, layers = depths.shape
    bits = np.zeros(((height + TILE - 1) // TILE, (width + TILE - 1) // TILE), np.uint64)
    for row in prange(bits.shape[0]):
        for y in range(row * TILE, min(height, (row + 1) * TILE)):
            for x in range(width):
                for layer in range(layers):
                    value = depths[y, x, layer]
                    found = np.uint64(1) << np.uint64(_slice_of(value, low, scale))
                    if x + 1 < width and abs(depths[y, x + 1, layer] - value) <= JUMP:
                        found |= _fill_slices(value, depths[y, x + 1, layer], low, scale)
                    if y + 1 < height and abs(depths[y + 1, x, layer] - value) <= JUMP:
                        found |= _fill_slices(value, depths[y + 1, x, layer], low, scale)
                    bits[row, x // TILE] |= found
    return bits


@njit(cache=True, parallel=True)
def _reached_slices(own, low, thickness, reach):  # type: ignore[no-untyped-def]
    """Bits of all slices of which a surface lies within its blur's reach of each tile."""
    rows, columns = own.shape
    near = np.zeros((reach + 1) * (reach + 1) * 2, np.uint64)  # by squared distance in tiles
    for square in range(near.shape[0]):
        gap = max(0.0, math.sqrt(square) - math.sqrt(2.0)) * TILE
        for i in range(SLICES):
            if max(abs(low + i * thickness), abs(low + (i + 1) * thickness)) + 1.0 >= gap:
                near[square] |= np.uint64(1) << np.uint64(i)
    found = np.empty_like(own)
    for row in prange(rows):
        for column in range(columns):
            bits = np.uint64(0)
            for v in range(max(0, row - reach), min(rows, row + reach + 1)):
                for u in range(max(0, column - reach), min(columns, column + reach + 1)):
                    bits |= own[v, u] & near[(v - row) * (v - row) + (u - column) * (u - column)]
            found[row, column] = bits
    return found


def occupied_slices(depths: np.ndarray) -> tuple[np.ndarray, float, float]:
    """For each tile, the slices of defocus in which its rays can meet a surface.

    A surface at defocus s lies on a ray of a pixel only within |s| pixels of it.

    Args:
        depths: Defocus of all layers, (H, W, L).

    Returns:
        Bits (rows, columns) of the tiles, and the lowest value and thickness of the slices.
    """
    low, high = float(depths.min()) - 1e-3, float(depths.max()) + 1e-3
    thickness = (high - low) / SLICES
    with parallel_region:
        own = _tile_slices(depths, low, 1.0 / thickness)
        reach = min(math.ceil(max(abs(low), abs(high)) / TILE) + 1, max(own.shape))
        found: np.ndarray = _reached_slices(own, low, thickness, reach)
    return found, low, thickness


@njit(cache=True)
def slice_runs(bits, low, thickness, runs):  # type: ignore[no-untyped-def]
    """Write the runs of set bits as pairs (front, back) of defocus, front to back; return their number."""
    count = 0
    i = SLICES - 1
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


@njit(cache=True)
def _scramble(x, y, seed):  # type: ignore[no-untyped-def]
    """A hash of a pixel, 0 up to 2^32."""
    whole = np.uint64(0xFFFFFFFF)
    h = np.uint64(x) * np.uint64(0x9E3779B1) ^ np.uint64(y) * np.uint64(0x85EBCA77)
    h = (h ^ np.uint64(seed) * np.uint64(0xC2B2AE3D)) & whole
    h ^= h >> np.uint64(15)
    h = h * np.uint64(0x2C1B3C6D) & whole
    h ^= h >> np.uint64(12)
    h = h * np.uint64(0x297A2D39) & whole
    return h ^ h >> np.uint64(15)


@njit(cache=True)
def fair_stride(count):  # type: ignore[no-untyped-def]
    """A step through ``count`` rows that visits all and gives each thread rows from all over the picture."""
    stride = max(1, int(0.618 * count))
    while math.gcd(stride, count) > 1:
        stride += 1
    return stride


@njit(cache=True, parallel=True)
def _march(  # type: ignore[no-untyped-def]
    colors, cells, mask, slices, low, thickness, points, chances, weights, cats_eye, seed, above, first, sums
):
    """Fill ``sums`` for the rows from ``first`` on: weighted colour, weight, and weight that is guessed."""
    height, width = mask.shape
    size = (height, width, colors.shape[2])
    flat = cells.reshape(-1)
    last = first + sums.shape[0]
    variants, rays = points.shape[1] // SETS, points.shape[2]
    us, vs = points[0].reshape(-1), points[1].reshape(-1)
    reach = max(abs(low), abs(low + SLICES * thickness))
    top = first // TILE
    tile_rows = (last + TILE - 1) // TILE - top
    stride = fair_stride(tile_rows)
    for i in prange(tile_rows):
        tile_row = top + np.int64(i) * stride % tile_rows
        runs = np.empty((SLICES // 2, 2))
        met = np.empty(3 * LANES, np.float32)
        for tile_column in range(slices.shape[1]):
            count = slice_runs(slices[tile_row, tile_column], low, thickness, runs)
            for y in range(max(first, tile_row * TILE), min(last, (tile_row + 1) * TILE)):
                for x in range(tile_column * TILE, min(width, (tile_column + 1) * TILE)):
                    if not mask[y, x]:
                        continue
                    hashed = _scramble(x, y + above, seed)
                    chosen = int(hashed % np.uint64(variants)) * SETS + ((y + above) % 3) * 3 + x % 3
                    first_chance = splat_lanes(np.float32(hashed / 4294967296.0))
                    near_border = min(x, y, width - 1 - x, height - 1 - y) <= reach
                    shift_x, shift_y = cats_eye_shift(cats_eye, x, y, width, height)
                    place_x, place_y = splat_lanes(np.float32(x)), splat_lanes(np.float32(y))
                    for start in range(0, rays, LANES):
                        u, v = load_lanes(us, chosen * rays + start), load_lanes(vs, chosen * rays + start)
                        chance = first_chance + load_lanes(chances, start)
                        chance = chance - floor_lanes(chance)
                        meet(flat, size, runs, count, place_x, place_y, u, v, chance, met)
                        for lane in range(LANES):
                            layer = int(met[2 * LANES + lane])
                            if layer < 0:
                                continue
                            k = start + lane
                            u, v = points[0, chosen, k], points[1, chosen, k]
                            if cats_eye > 0 and (u - shift_x) ** 2 + (v - shift_y) ** 2 > 1.0:
                                continue
                            row, column = int(met[lane]), int(met[LANES + lane])
                            depth = cells[row, column, layer, 0]
                            group = 0 if depth >= FILTERED_RADIUS else (2 if depth <= -FILTERED_RADIUS else 1)
                            w = weights[0 if depth > 0 else 1, chosen, k]
                            for c in range(3):
                                sums[y - first, x, group, c] += w * colors[row, column, layer, c]
                            sums[y - first, x, group, 3] += w
                            guess = layer > 0
                            if near_border:
                                to_x, to_y = x - u * depth, y - v * depth
                                guess |= min(to_x, to_y, width - 1 - to_x, height - 1 - to_y) < -0.5
                            if guess:
                                sums[y - first, x, group, 4] += w


@njit(cache=True, parallel=True)
def _resolve(sums, mask, first, top, bottom, result, guessed):  # type: ignore[no-untyped-def]
    """Divide the sums of rows ``top`` to ``bottom``; ``sums`` begin at row ``first``.

    Blurred surfaces are averaged over 3x3 pixels, sharp ones and what their edges cover are not.
    """
    width = mask.shape[1]
    for y in prange(top, bottom):
        around = np.empty((3, 5))
        for x in range(width):
            if not mask[y, x]:
                continue
            around[:] = 0.0
            for v in range(max(first, y - 1), min(first + sums.shape[0], y + 2)):
                for u in range(max(0, x - 1), min(width, x + 2)):
                    if mask[v, u]:
                        for group in range(3):
                            for c in range(5):
                                around[group, c] += sums[v - first, u, group, c]
            total = around[0, 3] + around[1, 3] + around[2, 3]
            if total <= 0.0:
                continue
            guessed[y, x] = (around[0, 4] + around[1, 4] + around[2, 4]) / total
            front = around[0, 3] / total
            sharp, back = sums[y - first, x, 1, 3], sums[y - first, x, 2, 3]
            for c in range(3):
                rest = 0.0
                if sharp > 0.0:
                    rest += sums[y - first, x, 1, c] / (sharp + back)
                if back > 0.0:
                    rest += back / (sharp + back) * around[2, c] / around[2, 3]
                if sharp + back == 0.0 and front < 1.0:
                    rest = (around[1, c] + around[2, c]) / (around[1, 3] + around[2, 3])
                result[y, x, c] = around[0, c] / total + (1.0 - front) * rest


def march(
    layers: Layers,
    cells: np.ndarray,
    mask: np.ndarray,
    slices: tuple[np.ndarray, float, float],
    points: np.ndarray,
    weights: np.ndarray,
    result: np.ndarray,
    *,
    guessed: np.ndarray,
    cats_eye: float = 0.0,
    seed: int = 0,
    above: int = 0,
) -> None:
    """March the rays of all pixels in ``mask`` and write what they meet into ``result``.

    Args:
        layers: What there is to meet, (H, W, L).
        cells: The same, from :func:`bokehnet.classical.meeting.layer_cells`.
        mask: Pixels to render, (H, W) bool.
        slices: From :func:`occupied_slices`.
        points: Aperture coordinates, (2, SETS * variants, rays), float32; ``rays`` a multiple of 8.
        weights: Of the points in front of and behind focus, (2, SETS * variants, rays), float32.
        result: (H, W, 3), float32; pixels in ``mask`` that meet a surface are overwritten.
        guessed: (H, W), float32; set alike, to the share of a pixel's light that no picture shows: from
            behind the first layer or from beyond the border.
        cats_eye: See :func:`bokehnet.optics.aperture.cats_eye_shift`.
        seed: Chooses the variant of each pixel and the random numbers against coverage.
        above: Rows of the picture above these arrays, where they are a strip of it.
    """
    height, width = mask.shape
    chances = (_GOLDEN * (1 + np.arange(points.shape[2])) % 1).astype(np.float32)
    arrays = (layers.colors, cells, mask, *slices, points, chances, weights)
    with parallel_region:
        for top in range(0, height, _STRIP):
            bottom = min(height, top + _STRIP)
            first, last = max(0, top - 1), min(height, bottom + 1)
            sums = np.zeros((last - first, width, 3, 5), np.float32)
            _march(*arrays, cats_eye, seed, above, first, sums)
            _resolve(sums, mask, first, top, bottom, result, guessed)
