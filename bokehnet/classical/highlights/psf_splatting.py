"""Splatting of PSF images of lights: each pixel receives the fraction that nearer surfaces leave visible.

The ray from a pixel to a light is known from both its ends. In a tile of 8 by 8 pixels each sends one such
ray; if some of them arrive and others do not, an edge clips the disc, and each pixel of the tile sends
four more, from positions inside the pixel and against four levels of the coverage.

Source: "Efficient and expressive rendering for real-time defocus blur and bokeh" (dissertation), 5.1, for
separate visibility of each light; rays through layers and the refinement at edges are ours.
"""

import math

import numpy as np
from numba import prange

from bokehnet.classical.layered.depth_discontinuities import DISCONTINUITY_THRESHOLD
from bokehnet.classical.layered.march.defocus_bins import BINS, TILE, bin_runs, tile_sets
from bokehnet.classical.layered.march.intersection import intersect
from bokehnet.classical.layered.march.ray_marching import fair_stride
from bokehnet.classical.simd.float8 import LANES, ORDER, broadcast8, indices8, load8
from bokehnet.kernels import njit

__all__ = ["splat_psf_images"]

# Positions inside a pixel from which it tests a light near an edge: four rooks.
_OFFSETS = np.array([[-0.375, -0.125], [-0.125, 0.375], [0.125, -0.375], [0.375, 0.125]])


@njit(cache=True)
def _test_visibility(
    scene, runs, count, light, columns, y, transverse, offset_x, offset_y, chance, visibility, work
):
    """Add 1 to ``visibility`` (8,) for each of eight pixels of a row whose ray arrives at the light.

    Args:
        scene: Flat cells, their size and their tiles.
        runs: Ranges of the defocus that contain surfaces.
        count: Number of runs.
        light: x, y and defocus of the light.
        columns: Columns of the pixels, lanes.
        y: Row of the pixels.
        transverse: Transverse aberration E of the pixels' rays, x in the first eight, y in the
            others, in lane order.
        offset_x: Origin of the rays, from the centres of their pixels.
        offset_y: Origin of the rays, down.
        chance: Surfaces with less coverage are ignored.
        visibility: Counts, in pixel order.
        work: Results of :func:`bokehnet.classical.layered.march.intersection.intersect`.
    """
    flat, size, tiles = scene
    per_pixel, half = broadcast8(np.float32(1.0 / light[2])), broadcast8(np.float32(0.5))
    row = broadcast8(np.float32(y))
    start_x = broadcast8(np.float32(offset_x)) - load8(transverse, 0)
    start_y = broadcast8(np.float32(offset_y)) - load8(transverse, LANES)
    across = (columns + start_x - broadcast8(np.float32(light[0]))) * per_pixel
    down = (row + start_y - broadcast8(np.float32(light[1]))) * per_pixel
    level = broadcast8(np.float32(chance))
    intersect(
        flat,
        size,
        tiles,
        runs,
        count,
        columns,
        row,
        half + start_x,
        half + start_y,
        across,
        down,
        level,
        work,
    )
    for lane in range(LANES):
        if work[2 * LANES + lane] >= 0 and work[3 * LANES + lane] > light[2] + DISCONTINUITY_THRESHOLD:
            continue
        visibility[ORDER[lane]] += 1.0


@njit(cache=True)
def _bins_on_way(bins, bits, light, corner, shift):
    """Return those of ``bits`` in which a ray from a tile can meet a surface in front of a light.

    At the defocus s the rays of a tile pass the tile scaled by ``1 - s / d`` about the light at defocus d.

    Args:
        bins: See :func:`splat_psf_images`.
        bits: Bins of all rays of the tile.
        light: See :func:`_test_visibility`.
        corner: First row and column of the tile.
        shift: Maximum distance of the start of a ray from the centre of its pixel, pixels.
    """
    met = np.uint64(0)
    rows, columns = bins.held.shape
    away_x, away_y = corner[1] + 0.5 * (TILE - 1) - light[0], corner[0] + 0.5 * (TILE - 1) - light[1]
    half = 0.5 * TILE + shift
    for i in range(BINS - 1, -1, -1):
        front = bins.low + (i + 1) * bins.thickness
        if front <= light[2] + DISCONTINUITY_THRESHOLD:
            break
        bit = np.uint64(1) << np.uint64(i)
        if not bits & bit:
            continue
        back = max(front - bins.thickness, light[2] + DISCONTINUITY_THRESHOLD)
        begin, end = 1.0 - front / light[2], 1.0 - back / light[2]
        margin = half * max(abs(begin), abs(end)) + 1.0  # 1: rounding to pixels
        left = light[0] + min(begin * away_x, end * away_x) - margin
        right = light[0] + max(begin * away_x, end * away_x) + margin
        top = light[1] + min(begin * away_y, end * away_y) - margin
        bottom = light[1] + max(begin * away_y, end * away_y) + margin
        first_row, last_row = _tile_at(top, rows), _tile_at(bottom, rows)
        first_column, last_column = _tile_at(left, columns), _tile_at(right, columns)
        for row in range(first_row, last_row + 1):
            for column in range(first_column, last_column + 1):
                met |= bins.held[row, column] & bit
    return met


@njit(cache=True)
def _tile_at(position, tiles):
    """Return the tile at a position, pixels; beyond the border that of the border."""
    return min(max(int(math.floor(position / TILE)), 0), tiles - 1)


@njit(cache=True)
def _tile_visibility(scene, runs, count, light, corner, box, psf_image, transverse, visibility, work):
    """Fill ``visibility`` (TILE, TILE) with the fraction of a light that each lit pixel of a tile sees.

    Args:
        scene: See :func:`_test_visibility`.
        runs: See :func:`_test_visibility`.
        count: See :func:`_test_visibility`.
        light: See :func:`_test_visibility`.
        corner: First row and column of the tile.
        box: Top, bottom, left and right of the PSF image.
        psf_image: Its pixels, (pixels, 1 or 5).
        transverse: Buffer, (TILE, 2 * LANES).
        visibility: Output.
        work: See :func:`_test_visibility`.
    """
    top, bottom, left, right = box
    low, high = max(corner[0], top), min(corner[0] + TILE, bottom)
    begin, end = max(corner[1], left), min(corner[1] + TILE, right)
    columns = indices8(np.float32(corner[1]))
    visibility[:] = 0.0
    transverse[:] = 0.0
    any_visible, all_visible = False, True
    for y in range(low, high):
        i = y - corner[0]
        first = (y - top) * (right - left) - left
        if psf_image.shape[1] > 1:
            for lane in range(LANES):
                x = corner[1] + ORDER[lane]
                if begin <= x < end:
                    transverse[i, lane], transverse[i, LANES + lane] = (
                        psf_image[first + x, 3],
                        psf_image[first + x, 4],
                    )
        level = (0.5 + i % 4) / 4
        _test_visibility(
            scene,
            runs,
            count,
            light,
            columns,
            y,
            transverse[i],
            0.0,
            0.0,
            level,
            visibility[i],
            work,
        )
        for x in range(begin, end):
            if psf_image[first + x, 0] > 0.0:
                arrives = visibility[i, x - corner[1]] > 0.0
                any_visible, all_visible = any_visible or arrives, all_visible and arrives
    if any_visible and not all_visible:
        visibility[:] = 0.0
        for y in range(low, high):
            i = y - corner[0]
            for k in range(4):
                offset_x, offset_y, level = _OFFSETS[k, 0], _OFFSETS[k, 1], (0.5 + (k + i) % 4) / 4
                _test_visibility(
                    scene,
                    runs,
                    count,
                    light,
                    columns,
                    y,
                    transverse[i],
                    offset_x,
                    offset_y,
                    level,
                    visibility[i],
                    work,
                )
            visibility[i] *= 0.25


@njit(cache=True, parallel=True)
def splat_psf_images(lights, boxes, starts, psf_images, cells, rays_mask, bins, result):
    """Add PSF images to the pixels of ``rays_mask``, tile row by tile row and in the order of the lights.

    Args:
        lights: (N, 8), see :func:`bokehnet.classical.highlights.lights.separate_lights`.
        boxes: Top, bottom, left and right of each PSF image, (N, 4).
        starts: First pixel of each PSF image, (N,).
        psf_images: Fractions of a light's energy, (pixels, 1); or fractions of red, green and blue, and the
            transverse aberration E in pixels at the start of rays, (pixels, 5).
        cells: From :func:`bokehnet.classical.layered.march.intersection.layer_cells`.
        rays_mask: (H, W) bool.
        bins: From :func:`bokehnet.classical.layered.march.defocus_bins.occupied_bins`.
        result: Changed in place, (H, W, 3).
    """
    height, width = rays_mask.shape
    flat, tiles = cells.reshape(-1), tile_sets(bins)
    shifts = np.full(lights.shape[0], np.abs(_OFFSETS).max())
    for i in prange(lights.shape[0]):
        end = starts[i] + (boxes[i, 1] - boxes[i, 0]) * (boxes[i, 3] - boxes[i, 2])
        for plane in range(3, psf_images.shape[1]):
            shifts[i] += np.abs(psf_images[starts[i] : end, plane]).max()
    stride = fair_stride(bins.bits.shape[0])
    for number in prange(bins.bits.shape[0]):
        tile_row = np.int64(number) * stride % bins.bits.shape[0]
        scene = (flat, (height, width, cells.shape[2]), tiles)
        runs = np.empty((BINS // 2, 2))
        visibility, transverse = np.empty((TILE, TILE)), np.empty((TILE, 2 * LANES), np.float32)
        work = np.empty(4 * LANES, np.float32)
        for i in range(lights.shape[0]):
            top, bottom, left, right = boxes[i]
            if top >= (tile_row + 1) * TILE or bottom <= tile_row * TILE or left >= right:
                continue
            psf_image = psf_images[starts[i] : starts[i] + (bottom - top) * (right - left)]
            for tile_column in range(left // TILE, (right + TILE - 1) // TILE):
                lit = False
                for y in range(max(tile_row * TILE, top), min((tile_row + 1) * TILE, bottom)):
                    first = (y - top) * (right - left) - left
                    for x in range(max(tile_column * TILE, left), min((tile_column + 1) * TILE, right)):
                        lit = lit or (rays_mask[y, x] and psf_image[first + x, 0] > 0.0)
                if not lit:
                    continue
                corner = (tile_row * TILE, tile_column * TILE)
                light = (lights[i, 0], lights[i, 1], lights[i, 2])
                bits = _bins_on_way(bins, bins.bits[tile_row, tile_column], light, corner, shifts[i])
                count = bin_runs(bits, bins.low, bins.thickness, runs)
                if count > 0:
                    runs[count - 1, 1] = max(runs[count - 1, 1], light[2] + DISCONTINUITY_THRESHOLD)
                    _tile_visibility(
                        scene,
                        runs,
                        count,
                        light,
                        corner,
                        boxes[i],
                        psf_image,
                        transverse,
                        visibility,
                        work,
                    )
                for y in range(max(tile_row * TILE, top), min((tile_row + 1) * TILE, bottom)):
                    first = (y - top) * (right - left) - left
                    for x in range(max(tile_column * TILE, left), min((tile_column + 1) * TILE, right)):
                        if not rays_mask[y, x]:
                            continue
                        visible = 1.0
                        if count > 0:
                            visible = visibility[y - tile_row * TILE, x - tile_column * TILE]
                        for c in range(3):
                            fraction = psf_image[first + x, c if psf_image.shape[1] > 1 else 0]
                            result[y, x, c] += visible * fraction * lights[i, 3 + c]
