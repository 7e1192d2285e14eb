"""Numba kernels that march pupil rays through a stack of layers seen as height fields.

The ray that meets the pupil in aperture coordinate a and the pixel p lies, at defocus s, over the place
``p - s * a`` of the picture; :mod:`bokehnet.classical.meeting` tells what it meets.

Source: Lee, Eisemann and Seidel, "Real-time lens blur effects and focus control", ACM TOG 2010, for rays
through layered height fields.
"""

import math

import numpy as np
from numba import njit, prange

from bokehnet.classical.lane_logic import floor_lanes
from bokehnet.classical.lanes import LANES, load_lanes, splat_lanes, store_lanes
from bokehnet.classical.layers import Layers
from bokehnet.classical.lens_rays import LensTable, collapse, send_rays
from bokehnet.classical.meeting import meet
from bokehnet.classical.parallel import parallel_region
from bokehnet.classical.slices import SLICES, TILE, slice_runs
from bokehnet.optics.aperture import cats_eye_shift

__all__ = ["FILTERED_RADIUS", "SETS", "fair_stride", "march"]

# Discs of at least this radius change so slowly that their rays may be averaged with the 8 neighbours'.
FILTERED_RADIUS = 4.0

# Rows worked at a time, so that the sums stay small.
_STRIP = 256

# The pixels of a 3x3 block take different pupil points.
SETS = 9

# Multiples of the golden ratio, without their whole parts: evenly spread chances for the rays of a pixel.
_GOLDEN = 0.6180339887498949


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
    colors,
    cells,
    mask,
    slices,
    low,
    thickness,
    points,
    chances,
    weights,
    lens,
    cats_eye,
    seed,
    above,
    first,
    sums,
):
    """Fill ``sums`` for the rows from ``first`` on: weighted colour, weights, and weight that is guessed.

    Where the lens parts colours there are three weights, else one.
    """
    height, width = mask.shape
    size = (height, width, colors.shape[2])
    flat = cells.reshape(-1)
    last = first + sums.shape[0]
    variants, rays = points.shape[1] // SETS, points.shape[2]
    us, vs = points[0].reshape(-1), points[1].reshape(-1)
    reach = max(abs(low), abs(low + SLICES * thickness))
    colored = False
    if lens is not None:
        colored = lens.colors.shape[0] > 0
        reach = (1.0 + lens.strayed.max()) * reach + lens.largest.max()
    top = first // TILE
    tile_rows = (last + TILE - 1) // TILE - top
    stride = fair_stride(tile_rows)
    for i in prange(tile_rows):
        tile_row = top + np.int64(i) * stride % tile_rows
        runs = np.empty((SLICES // 2, 2))
        met, way = np.empty(3 * LANES, np.float32), np.empty(4 * LANES, np.float32)
        half = splat_lanes(np.float32(0.5))
        if lens is not None:
            collapsed = np.empty((lens.coefficients.shape[0], lens.coefficients.shape[1], 10), np.float32)
        for tile_column in range(slices.shape[1]):
            count = slice_runs(slices[tile_row, tile_column], low, thickness, runs)
            for y in range(max(first, tile_row * TILE), min(last, (tile_row + 1) * TILE)):
                for x in range(tile_column * TILE, min(width, (tile_column + 1) * TILE)):
                    if not mask[y, x]:
                        continue
                    hashed = _scramble(x, y + above, seed)
                    chosen = int(hashed % np.uint64(variants)) * SETS + ((y + above) % 3) * 3 + x % 3
                    first_chance = splat_lanes(np.float32(hashed / 4294967296.0))
                    shift_x, shift_y = cats_eye_shift(cats_eye, x, y, width, height)
                    place_x, place_y = splat_lanes(np.float32(x)), splat_lanes(np.float32(y))
                    if lens is not None:
                        h_x = np.float32((x - lens.column) * lens.scale)
                        h_y = np.float32((y + above - lens.row) * lens.scale)
                        collapse(lens.coefficients, h_x * h_x + h_y * h_y, collapsed)
                        field = min(math.sqrt(h_x * h_x + h_y * h_y), 1.0) * (lens.largest.shape[0] - 1)
                        wide = splat_lanes(np.float32(lens.shaken[int(field)]))
                    near_border = min(x, y, width - 1 - x, height - 1 - y) <= reach
                    for start in range(0, rays, LANES):
                        u, v = load_lanes(us, chosen * rays + start), load_lanes(vs, chosen * rays + start)
                        chance = first_chance + load_lanes(chances, start)
                        chance = chance - floor_lanes(chance)
                        if lens is None:
                            begin_x, begin_y, a_x, a_y = half, half, u, v
                        else:
                            wave = load_lanes(lens.waves, chosen * rays + start)
                            e_x, e_y, a_x, a_y = send_rays(collapsed, lens.tilt, u, v, h_x, h_y, wave)
                            if lens.fringes.shape[1] > 0:
                                axial = load_lanes(lens.fringes[0], chosen * rays + start)
                                lateral = load_lanes(lens.fringes[1], chosen * rays + start)
                                axial = axial * splat_lanes(lens.maps[y + above, x, 0])
                                lateral = lateral * splat_lanes(lens.maps[y + above, x, 1])
                                e_x = e_x + u * axial + lateral * splat_lanes(h_x)
                                e_y = e_y + v * axial + lateral * splat_lanes(h_y)
                            start_x = load_lanes(lens.starts[0], chosen * rays + start)
                            start_y = load_lanes(lens.starts[1], chosen * rays + start)
                            begin_x, begin_y = half + wide * start_x - e_x, half + wide * start_y - e_y
                        meet(
                            flat, size, runs, count, place_x, place_y, begin_x, begin_y, a_x, a_y, chance, met
                        )
                        store_lanes(way, 0, begin_x)
                        store_lanes(way, LANES, begin_y)
                        store_lanes(way, 2 * LANES, a_x)
                        store_lanes(way, 3 * LANES, a_y)
                        for lane in range(LANES):
                            layer = int(met[2 * LANES + lane])
                            if layer < 0:
                                continue
                            k = start + lane
                            u, v = points[0, chosen, k], points[1, chosen, k]
                            if cats_eye > 0 and (u - shift_x) ** 2 + (v - shift_y) ** 2 > 1.0:
                                continue
                            if lens is not None and not _passes(lens.rims, u, v, h_x, h_y):
                                continue
                            row, column = int(met[lane]), int(met[LANES + lane])
                            depth = cells[row, column, layer, 0]
                            blur = depth * depth
                            if lens is not None:
                                blur += (way[lane] - 0.5) ** 2 + (way[LANES + lane] - 0.5) ** 2
                            group = 1
                            if blur >= FILTERED_RADIUS * FILTERED_RADIUS:
                                group = 0 if depth > 0.0 else 2
                            w = weights[0 if depth > 0 else 1, chosen, k]
                            guess = layer > 0
                            if near_border:
                                to_x = x + way[lane] - way[2 * LANES + lane] * depth
                                to_y = y + way[LANES + lane] - way[3 * LANES + lane] * depth
                                guess |= min(to_x, to_y, width - to_x, height - to_y) < 0.0
                            if not colored:
                                for c in range(3):
                                    sums[y - first, x, group, c] += w * colors[row, column, layer, c]
                                sums[y - first, x, group, 3] += w
                                if guess:
                                    sums[y - first, x, group, 4] += w
                                continue
                            for c in range(3):
                                share = w * lens.colors[chosen * rays + k, c]
                                sums[y - first, x, group, c] += share * colors[row, column, layer, c]
                                sums[y - first, x, group, 3 + c] += share
                                if guess:
                                    sums[y - first, x, group, 6] += share / 3.0


@njit(cache=True)
def _passes(rims, u, v, h_x, h_y):  # type: ignore[no-untyped-def]
    """Whether all rims (R, 2) let a ray pass."""
    for i in range(rims.shape[0]):
        shift, radius = rims[i]
        if (u - shift * h_x) ** 2 + (v - shift * h_y) ** 2 > radius * radius:
            return False
    return True


@njit(cache=True, parallel=True)
def _resolve(sums, mask, first, top, bottom, result, guessed):  # type: ignore[no-untyped-def]
    """Divide the sums of rows ``top`` to ``bottom``; ``sums`` begin at row ``first``.

    Blurred surfaces are averaged over 3x3 pixels, sharp ones and what their edges cover are not.
    """
    width, numbers = mask.shape[1], sums.shape[3]
    own = 1 if numbers == 7 else 0  # whether each colour has a weight of its own
    for y in prange(top, bottom):
        around = np.empty((3, numbers))
        for x in range(width):
            if not mask[y, x]:
                continue
            around[:] = 0.0
            for v in range(max(first, y - 1), min(first + sums.shape[0], y + 2)):
                for u in range(max(0, x - 1), min(width, x + 2)):
                    if mask[v, u]:
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
                guessed[y, x] = (around[0, last] + around[1, last] + around[2, last]) / weight


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
    lens: LensTable | None = None,
    seed: int = 0,
    above: int = 0,
) -> None:
    """March the rays of all pixels in ``mask`` and write what they meet into ``result``.

    Args:
        layers: What there is to meet, (H, W, L).
        cells: The same, from :func:`bokehnet.classical.meeting.layer_cells`.
        mask: Pixels to render, (H, W) bool.
        slices: From :func:`bokehnet.classical.slices.occupied_slices`.
        points: Aperture coordinates, (2, SETS * variants, rays), float32; ``rays`` a multiple of 8.
        weights: Of the points in front of and behind focus, (2, SETS * variants, rays), float32.
        result: (H, W, 3), float32; pixels in ``mask`` that meet a surface are overwritten.
        guessed: (H, W), float32; set alike, to the share of a pixel's light that no picture shows: from
            behind the first layer or from beyond the border.
        cats_eye: See :func:`bokehnet.optics.aperture.cats_eye_shift`.
        lens: A character, for all rays of ``points`` in their order; default: a perfect lens.
        seed: Chooses the variant of each pixel and the random numbers against coverage.
        above: Rows of the picture above these arrays, where they are a strip of it.
    """
    height, width = mask.shape
    chances = (_GOLDEN * (1 + np.arange(points.shape[2])) % 1).astype(np.float32)
    arrays = (layers.colors, cells, mask, *slices, points, chances, weights, lens)
    numbers = 7 if lens is not None and len(lens.colors) else 5
    with parallel_region:
        for top in range(0, height, _STRIP):
            bottom = min(height, top + _STRIP)
            first, last = max(0, top - 1), min(height, bottom + 1)
            sums = np.zeros((last - first, width, 3, numbers), np.float32)
            _march(*arrays, cats_eye, seed, above, first, sums)
            _resolve(sums, mask, first, top, bottom, result, guessed)
