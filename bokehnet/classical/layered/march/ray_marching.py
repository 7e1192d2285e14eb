"""Numba kernels that march pupil rays through a stack of layers as height fields.

The ray of the pixel p through the aperture coordinate a is, at defocus s, over the position ``p - s * a`` of
the picture; :mod:`bokehnet.classical.layered.march.intersection` finds the surface that it meets.

Source: Lee, Eisemann and Seidel, "Real-time lens blur effects and focus control", ACM TOG 2010, for rays
through layered height fields.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import prange

from bokehnet.arrays.viewport import Viewport
from bokehnet.classical.layered.march.aberrated_rays import (
    LensTable,
    collapse,
    keep_within,
    send_channels,
    send_rays,
)
from bokehnet.classical.layered.march.channel_rays import (
    MAX_OUTLINE_REACH_PX,
    RAY_FIELDS,
    dilate_bins,
    follow,
    keep_rays,
    outlines_of,
    reach_between,
)
from bokehnet.classical.layered.march.defocus_bins import BINS, TILE, DefocusBins, bin_runs, tile_sets
from bokehnet.classical.layered.march.intersection import intersect, intersect_smooth
from bokehnet.classical.layered.march.ray_accumulators import COLORED, GROUPS, PLAIN, add_light, sum_light
from bokehnet.classical.layered.march.ray_averages import resolve, window_halo
from bokehnet.classical.layered.march.sample_counts import (
    FIRST_RAYS,
    FirstPass,
    SampleCounts,
    counts_by_variance,
)
from bokehnet.classical.parallel import parallel_region
from bokehnet.classical.simd.float8 import (
    LANES,
    any8,
    broadcast8,
    floor8,
    gather_triples8,
    less8,
    load8,
    max8,
    min8,
    select8,
    store8,
)
from bokehnet.kernels import njit
from bokehnet.optics.aperture import cats_eye_shift

__all__ = ["SETS", "RaysJob", "fair_stride", "march", "scramble"]

# Rows per strip, which bounds the memory of the sums.
_STRIP = 192

# The pixels of a 3x3 block use different pupil points.
SETS = 9

# Multiples of the golden ratio modulo 1: evenly spread random numbers for the rays of a pixel.
_GOLDEN = 0.6180339887498949


@njit(cache=True)
def scramble(x, y, seed):
    """Return a hash of a pixel, 0 up to 2^32."""
    whole = np.uint64(0xFFFFFFFF)
    h = np.uint64(x) * np.uint64(0x9E3779B1) ^ np.uint64(y) * np.uint64(0x85EBCA77)
    h = (h ^ np.uint64(seed) * np.uint64(0xC2B2AE3D)) & whole
    h ^= h >> np.uint64(15)
    h = h * np.uint64(0x2C1B3C6D) & whole
    h ^= h >> np.uint64(12)
    h = h * np.uint64(0x297A2D39) & whole
    return h ^ h >> np.uint64(15)


@njit(cache=True)
def fair_stride(count):
    """Return a step through ``count`` rows that visits all and spreads each thread's rows evenly."""
    stride = max(1, int(0.618 * count))
    while math.gcd(stride, count) > 1:
        stride += 1
    return stride


@njit(cache=True, forceinline=True)
def _vignette(u, v, front, back, shift_x, shift_y, radius):
    """Return the weights in front of and behind focus of rays that pass a circle; see ``keep_within``."""
    return keep_within(u, v, shift_x, shift_y, radius, front), keep_within(
        u, v, shift_x, shift_y, radius, back
    )


@njit(cache=True, forceinline=True)
def _ray_of(ray, start_x, start_y):
    """Return origin and direction of rays from E and A of ``ray`` and their starts, lanes."""
    return start_x - ray[0], start_y - ray[1], ray[2], ray[3]


@njit(cache=True, forceinline=True)
def _with_fringe(ray, u, v, fringes, at, pattern, h_x, h_y, factors):
    """Return E and A of rays with chromatic aberration: axial at ``at``, lateral ``pattern`` values later."""
    axial = broadcast8(factors[0]) * load8(fringes, at)
    lateral = broadcast8(factors[1]) * load8(fringes, pattern + at)
    e_x, e_y = ray[0] + u * axial + lateral * broadcast8(h_x), ray[1] + v * axial + lateral * broadcast8(h_y)
    return e_x, e_y, ray[2], ray[3]


@njit(cache=True, forceinline=True)
def _read_hits(hits, way, pair):
    """Return weight, layer, defocus and squared blur of the hits of eight rays; weight 0 without a hit.

    ``pair``: weights in front of and behind focus.
    """
    zero, half = broadcast8(np.float32(0)), broadcast8(np.float32(0.5))
    layer, depth = load8(hits, 2 * LANES), load8(hits, 3 * LANES)
    w = select8(less8(zero, depth), pair[0], pair[1])
    w = select8(less8(layer, zero), zero, w)
    away_x, away_y = way[0] - half, way[1] - half
    return w, max8(layer, zero), depth, depth * depth + away_x * away_x + away_y * away_y


@njit(cache=True, forceinline=True)
def _disoccluded_weight(weight, layer, place_x, place_y, way, depth, near_border, right, bottom):
    """Return the part of ``weight`` that no picture shows: behind the first layer or beyond the border."""
    zero = broadcast8(np.float32(0))
    hidden = select8(less8(zero, layer), weight, zero)
    if near_border:
        to_x, to_y = place_x + way[0] - way[2] * depth, place_y + way[1] - way[3] * depth
        inside = min8(min8(to_x, to_y), min8(right - to_x, bottom - to_y))
        hidden = select8(less8(inside, zero), weight, hidden)
    return hidden


@njit(cache=True, parallel=True)
def _march(
    colors,
    cells,
    rays_mask,
    bins,
    points,
    chances,
    weights,
    lens,
    outlines,
    cats_eye,
    place,
    seed,
    above,
    first,
    before,
    counts,
    sums,
):
    """Send rays ``before`` to ``counts`` of each pixel, by its tile, and add them to their means ``sums``.

    Both begin at row ``first``, that of a tile; see :mod:`bokehnet.classical.layered.march.ray_accumulators`.
    ``outlines``: outlines of the surfaces if the lens is dispersive; else ``None``.
    """
    height, width = rays_mask.shape
    flat, tiles = cells.reshape(-1), tile_sets(bins)
    last = first + sums.shape[0]
    variants, rays = points.shape[1] // SETS, points.shape[2]
    us, vs = points[0].reshape(-1), points[1].reshape(-1)
    front_weights, back_weights = weights[0].reshape(-1), weights[1].reshape(-1)
    flat_colors, numbers = colors.reshape(-1), sums.shape[3]
    reach = max(abs(bins.low), abs(bins.low + BINS * bins.thickness))
    pattern, starts, waves, fringes = us.size, us, us, us
    if lens is not None:
        starts = lens.starts.reshape(-1)
        reach = (1.0 + lens.max_stretch.max()) * reach + lens.max_aberration.max()
    if outlines is not None:
        waves, fringes = lens.channel_waves.reshape(-1), lens.channel_aberration.reshape(-1)
    top = first // TILE
    tile_rows = counts.shape[0]
    stride = fair_stride(tile_rows)
    for i in prange(tile_rows):
        tile_row = top + np.int64(i) * stride % tile_rows
        runs = np.empty((BINS // 2, 2))
        hits, totals = np.zeros(6 * LANES, np.float32), np.empty(GROUPS * numbers * LANES, np.float32)
        zero, half = broadcast8(np.float32(0)), broadcast8(np.float32(0.5))
        one, third = broadcast8(np.float32(1)), broadcast8(np.float32(1 / 3))
        right, bottom = broadcast8(np.float32(width)), broadcast8(np.float32(height))
        if lens is not None:
            collapsed = np.empty(lens.coefficients.shape[1:], np.float32)
        if outlines is not None:
            room = 2 * rays + LANES
            kept, work = np.empty(RAY_FIELDS * room, np.float32), np.empty(RAY_FIELDS * LANES, np.float32)
            flat_outlines = outlines.reshape(-1)
        for tile_column in range(bins.bits.shape[1]):
            sent = counts[tile_row - top, tile_column]
            if sent <= before:
                continue
            smooth = bins.smooth[tile_row, tile_column]
            size = (height, width, cells.shape[2])
            count = bin_runs(bins.bits[tile_row, tile_column], bins.low, bins.thickness, runs)
            for y in range(tile_row * TILE, min(last, (tile_row + 1) * TILE)):
                for x in range(tile_column * TILE, min(width, (tile_column + 1) * TILE)):
                    if not rays_mask[y, x]:
                        continue
                    hashed = scramble(x, y + above, seed)
                    variant = int(hashed % np.uint64(variants)) * SETS + ((y + above) % 3) * 3 + x % 3
                    first_chance = broadcast8(np.float32(hashed / 4294967296.0))
                    shift_x, shift_y = cats_eye_shift(
                        cats_eye, x + place[0], y + above + place[1], place[2], place[3]
                    )
                    place_x, place_y = broadcast8(np.float32(x)), broadcast8(np.float32(y))
                    if lens is not None:
                        far_x = (x - lens.column) * lens.scale
                        far_y = (y + above - lens.row) * lens.scale
                        # The lens data end at the corner: overscan beyond it repeats the corner's.
                        shrink = 1.0 / max(math.sqrt(far_x * far_x + far_y * far_y), 1.0)
                        h_x, h_y = np.float32(far_x * shrink), np.float32(far_y * shrink)
                        collapse(lens.coefficients, h_x * h_x + h_y * h_y, collapsed)
                        ring = min(math.sqrt(h_x * h_x + h_y * h_y), 1.0) * (lens.max_aberration.shape[0] - 1)
                        jitter = broadcast8(np.float32(lens.jitter_scale[int(ring)]))
                    near_border = min(x, y, width - 1 - x, height - 1 - y) <= reach
                    totals[:] = 0.0
                    lost = 0
                    for start in range(before, sent, LANES):
                        k = variant * rays + start
                        u, v = load8(us, k), load8(vs, k)
                        chance = first_chance + load8(chances, start)
                        chance = chance - floor8(chance)
                        pair = (load8(front_weights, k), load8(back_weights, k))
                        if cats_eye > 0:
                            pair = _vignette(u, v, pair[0], pair[1], shift_x, shift_y, 1.0)
                        way = (half, half, u, v)
                        if lens is not None:
                            for rim in range(lens.vignetting_apertures.shape[0]):
                                shift = lens.vignetting_apertures[rim, 0]
                                radius = lens.vignetting_apertures[rim, 1]
                                pair = _vignette(u, v, pair[0], pair[1], shift * h_x, shift * h_y, radius)
                            start_x = half + jitter * load8(starts, k)
                            start_y = half + jitter * load8(starts, pattern + k)
                        if lens is not None and outlines is None:
                            ray = send_rays(collapsed, lens.tilt, u, v, h_x, h_y, load8(lens.waves, k))
                            way = _ray_of(ray, start_x, start_y)
                        if outlines is not None:
                            channel_waves = (
                                load8(waves, k),
                                load8(waves, pattern + k),
                                load8(waves, 2 * pattern + k),
                            )
                            red, green, blue = send_channels(
                                collapsed, lens.tilt, u, v, h_x, h_y, channel_waves
                            )
                            if fringes.size > 0:
                                factors, at = lens.maps[y, x], 2 * pattern + k
                                red = _with_fringe(red, u, v, fringes, k, pattern, h_x, h_y, factors)
                                green = _with_fringe(green, u, v, fringes, at, pattern, h_x, h_y, factors)
                                at += 2 * pattern
                                blue = _with_fringe(blue, u, v, fringes, at, pattern, h_x, h_y, factors)
                            way = _ray_of(green, start_x, start_y)
                            red_way, blue_way = (
                                _ray_of(red, start_x, start_y),
                                _ray_of(blue, start_x, start_y),
                            )
                        if outlines is None:
                            if not smooth or not intersect_smooth(
                                flat, size, place_x, place_y, way[0], way[1], way[2], way[3], hits
                            ):
                                intersect(
                                    *(flat, size, tiles, runs, count),
                                    *(place_x, place_y, way[0], way[1], way[2], way[3], chance, hits),
                                )
                        else:
                            store8(hits, 4 * LANES, zero)
                            store8(hits, 5 * LANES, zero)
                            if not smooth or not intersect_smooth(
                                flat, size, place_x, place_y, way[0], way[1], way[2], way[3], hits
                            ):
                                reach_px = max(
                                    reach_between(way, red_way, runs[0, 0], runs[count - 1, 1]),
                                    reach_between(way, blue_way, runs[0, 0], runs[count - 1, 1]),
                                )
                                level = min(reach_px, MAX_OUTLINE_REACH_PX)
                                adjacent = (flat_outlines, level * height * width * 2, red_way, blue_way)
                                intersect(
                                    *(flat, size, tiles, runs, count),
                                    *(
                                        place_x,
                                        place_y,
                                        way[0],
                                        way[1],
                                        way[2],
                                        way[3],
                                        chance,
                                        hits,
                                        adjacent,
                                    ),
                                )
                                if reach_px > MAX_OUTLINE_REACH_PX:
                                    store8(hits, 4 * LANES, one)
                                    store8(hits, 5 * LANES, one)
                        w, layer, depth, blur = _read_hits(hits, way, pair)
                        light = gather_triples8(
                            flat_colors, load8(hits, 0), load8(hits, LANES), layer, width, size[2]
                        )
                        shares, weight = (w, w, w), w
                        if outlines is not None:
                            apart = load8(hits, 4 * LANES)
                            is_same_surface = follow(flat, size, place_x, place_y, red_way, hits, apart, work)
                            reds = gather_triples8(
                                flat_colors, load8(work, 0), load8(work, LANES), layer, width, size[2]
                            )
                            red_share = select8(is_same_surface, w, zero)
                            if any8(less8(red_share, w)):
                                must_march = select8(is_same_surface, zero, one)
                                lost = keep_rays(must_march, red_way, chance, pair, 1.0, work, kept, lost)
                            apart = load8(hits, 5 * LANES)
                            is_same_surface = follow(
                                flat, size, place_x, place_y, blue_way, hits, apart, work
                            )
                            blues = gather_triples8(
                                flat_colors, load8(work, 0), load8(work, LANES), layer, width, size[2]
                            )
                            blue_share = select8(is_same_surface, w, zero)
                            if any8(less8(blue_share, w)):
                                must_march = select8(is_same_surface, zero, one)
                                lost = keep_rays(must_march, blue_way, chance, pair, 0.0, work, kept, lost)
                            light, shares = (reds[0], light[1], blues[2]), (red_share, w, blue_share)
                            weight = third * (red_share + w + blue_share)
                        hidden = _disoccluded_weight(
                            weight, layer, place_x, place_y, way, depth, near_border, right, bottom
                        )
                        add_light(totals, numbers, blur, depth, shares, light, weight, hidden)
                    if outlines is not None:
                        for n in range(lost, -(-lost // LANES) * LANES):
                            for j in range(RAY_FIELDS):
                                kept[j * room + n] = kept[j * room + lost - 1]
                            kept[5 * room + n], kept[6 * room + n] = 0.0, 0.0
                        for n in range(0, lost, LANES):
                            way = (
                                load8(kept, n),
                                load8(kept, room + n),
                                load8(kept, 2 * room + n),
                                load8(kept, 3 * room + n),
                            )
                            chance, share = load8(kept, 4 * room + n), load8(kept, 7 * room + n)
                            pair = (load8(kept, 5 * room + n), load8(kept, 6 * room + n))
                            intersect(
                                *(flat, size, tiles, runs, count, place_x, place_y),
                                *(way[0], way[1], way[2], way[3], chance, hits),
                            )
                            w, layer, depth, blur = _read_hits(hits, way, pair)
                            light = gather_triples8(
                                flat_colors, load8(hits, 0), load8(hits, LANES), layer, width, size[2]
                            )
                            shares, weight = (w * share, zero, w * (one - share)), third * w
                            hidden = _disoccluded_weight(
                                weight, layer, place_x, place_y, way, depth, near_border, right, bottom
                            )
                            add_light(totals, numbers, blur, depth, shares, light, weight, hidden)
                    sum_light(totals, before, sent, sums[y - first, x])


@dataclass(frozen=True, kw_only=True, slots=True)
class RaysJob:
    """Layers of a picture, the rays of its pixels, and the lens that sends them.

    Attributes:
        colors: Colors of the layers, (H, W, L, 3).
        cells: From :func:`bokehnet.classical.layered.march.intersection.layer_cells`.
        rays_mask: Pixels to render, (H, W) bool.
        bins: From :func:`bokehnet.classical.layered.march.defocus_bins.occupied_bins`.
        points: Aperture coordinates, (2, SETS * variants, rays), float32; ``rays`` is the maximum per pixel,
            a power of two.
        weights: Weights of the points in front of and behind focus, (2, SETS * variants, rays), float32.
        radius: Largest radius of any disc in the whole picture, pixels.
        nominal_rays: See :class:`bokehnet.classical.layered.march.sample_counts.FirstPass`.
        cats_eye: See :func:`bokehnet.optics.aperture.cats_eye_shift`.
        lens: Lens response for all rays of ``points`` in their order; default: a perfect lens.
        seed: Seed of the variant of each pixel and of the random numbers for coverage.
        above: Rows of the picture above these arrays, if they are a strip of it.
        viewport: Position of the picture in the shown one; default: all of it is shown.
    """

    colors: np.ndarray
    cells: np.ndarray
    rays_mask: np.ndarray
    bins: DefocusBins
    points: np.ndarray
    weights: np.ndarray
    radius: float
    nominal_rays: int
    cats_eye: float = 0.0
    lens: LensTable | None = None
    seed: int = 0
    above: int = 0
    viewport: Viewport | None = None


def march(
    job: RaysJob,
    result: np.ndarray,
    disocclusion_weight: np.ndarray,
    *,
    sample_counts: SampleCounts = counts_by_variance,
    progress: Callable[[float], None] | None = None,
    send: Callable[..., None] | None = None,
) -> None:
    """March the rays of all pixels in ``job.rays_mask`` and write the light of their hits to ``result``.

    Args:
        job: Layers, rays and lens.
        result: Colors, (H, W, 3), float32; pixels in ``rays_mask`` that meet a surface are overwritten.
        disocclusion_weight: (H, W), float32; set in the same pixels to the fraction of a pixel's light that
            no picture shows: from behind the first layer or from beyond the border.
        sample_counts: Function that returns the number of rays of each tile.
        progress: Callback that receives the completed fraction of the pixels, 0 to 1.
        send: Replaces the kernel of this module, with its arguments.
    """
    send = send or _march
    cells, rays_mask, points = job.cells, job.rays_mask, job.points
    height, width = rays_mask.shape
    done = np.cumsum(np.count_nonzero(rays_mask, axis=1)) if progress is not None else None
    numbers, arrays, options = _kernel_arguments(job)
    halo = window_halo(job.radius)
    marched_rows, previous_sums = 0, np.zeros((0, width, GROUPS, numbers), np.float32)
    with parallel_region:
        for top in range(0, height, _STRIP):
            bottom = min(height, top + _STRIP)
            first = max(0, top - halo) // TILE * TILE
            last = min(height, -(-(bottom + halo) // TILE) * TILE)
            first_new = max(first, marched_rows)  # the previous strip has marched the rows above
            sums = np.zeros((last - first, width, GROUPS, numbers), np.float32)
            sums[: first_new - first] = previous_sums[len(previous_sums) - (first_new - first) :]
            if last > first_new:
                new_sums, rows = sums[first_new - first :], slice(first_new, last)
                counts = np.full((-(-(last - first_new) // TILE), -(-width // TILE)), FIRST_RAYS)
                send(*arrays, *options, first_new, 0, counts, new_sums)
                first_pass = FirstPass(
                    new_sums, rays_mask[rows], cells[rows], job.nominal_rays, points.shape[2]
                )
                send(*arrays, *options, first_new, FIRST_RAYS, sample_counts(first_pass), new_sums)
            marched_rows, previous_sums = last, sums
            resolve(sums, rays_mask, first, top, bottom, result, disocclusion_weight, job.radius)
            if progress is not None and done is not None:
                progress(done[bottom - 1] / max(done[-1], 1))


def _kernel_arguments(job: RaysJob) -> tuple[int, tuple[Any, ...], tuple[Any, ...]]:
    """Return the numbers per ray, and the arrays and options that all calls of the kernel share."""
    height, width = job.rays_mask.shape
    chances = (_GOLDEN * (1 + np.arange(job.points.shape[2])) % 1).astype(np.float32)
    numbers, outlines, bins = PLAIN, None, job.bins
    if job.lens is not None and job.lens.colors.shape[1]:
        numbers, outlines, bins = COLORED, outlines_of(job.cells), dilate_bins(bins)
    viewport = (job.viewport or Viewport.whole(height, width)).as_tuple()
    arrays = (job.colors, job.cells, job.rays_mask, bins, job.points, chances, job.weights, job.lens)
    return numbers, (*arrays, outlines), (job.cats_eye, viewport, job.seed, job.above)
