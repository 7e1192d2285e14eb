"""Tiles that see only one smooth surface through an aberrated lens: one bundle of rays for all their pixels.

Behind an aberrated lens every pixel deviates from the scatter, also far away from all edges. There the rays
of neighbouring pixels are similar: they cross one plane of the defocus, from nearly the same field position.
A tile therefore sends one dense bundle from its centre, and its hits, relative to the centre, are a kernel of
offsets and colors for each of its pixels. If no pixel of the kernel has much of its light, offsets are
aggregated in blocks of 2 or 4 pixels a side, whose means are read.

A tile uses a bundle if it has no step and is not steep. If all surfaces that its rays can meet are on the
plane of its own defocus, positions on that plane are computed; otherwise each ray of the bundle is
intersected with the surface. Pixels near a step blend with rays of their own, up to all of it.

Source: Lee, Eisemann and Seidel, "Real-time lens blur effects and focus control", ACM TOG 2010, for one
set of rays for many pixels; kernels by tile, and their validity, are ours.
"""

import math

import numpy as np
from numba import prange

from bokehnet.arrays.viewport import Viewport
from bokehnet.classical.layered.march.aberrated_rays import collapse, keep_within, send_rays
from bokehnet.classical.layered.march.bundle_extents import BUNDLE, extent_at, ring_of
from bokehnet.classical.layered.march.defocus_bins import TILE
from bokehnet.classical.layered.march.intersection import CLOSE
from bokehnet.classical.layered.march.ray_marching import RaysJob
from bokehnet.classical.parallel import parallel_region
from bokehnet.classical.simd.float8 import (
    LANES,
    abs8,
    any8,
    broadcast8,
    divide8,
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
from bokehnet.optics.aperture import cats_eye_shift

__all__ = ["BUNDLE", "render_smooth_tiles"]

# Rows per band, which bounds the memory of the planes of the picture.
_BAND = 128

# Tolerance of a surface to its tile's plane, and of its change over half a tile, in pixels of defocus and as
# a fraction of it, whichever is larger; also of the change of the transverse aberration over half a tile.
_MAX_DEVIATION_PX, _MAX_DEVIATION_FRACTION = 0.2, 0.02

# Change of the defocus per pixel, in pixels, above which a surface is not smooth.
_MAX_SLOPE = 0.5

# Maximum reach of a bundle, pixels: the rays of larger discs are too sparse.
_MAX_REACH_PX = 96

# Offsets are aggregated in blocks while no block has a larger fraction of the light of any color; largest
# side of a block, pixels.
_MAX_BLOCK_FRACTION, _MAX_BLOCK_PX = 0.012, 4

# Maximum iterations of a ray at a curved surface.
_MAX_ITERATIONS = 3

# Data of a tile: defocus at its centre, its change per pixel right and down, extreme values of defocus of any
# layer, and 1 if a surface is occluded, covers in part or is steep.
_MIDDLE, _RIGHT, _DOWN, _LOW, _HIGH, _LAYERED = range(6)

# Rendering of a tile: its own rays, a bundle that intersects the surface, or one on the plane of the tile.
_RAYS, _CURVED, _PLANE = range(3)


@njit(cache=True, parallel=True)
def _tile_surfaces(cells, surfaces):
    """Fill ``surfaces`` (rows, columns, 6); tiles that the border cuts count as layered."""
    height, width, layers = cells.shape[:3]
    moment = TILE * TILE * (TILE * TILE - 1) / 12.0
    for row in prange(surfaces.shape[0]):
        for column in range(surfaces.shape[1]):
            top, left = row * TILE, column * TILE
            layered = top + TILE > height or left + TILE > width
            total, right, down, low, high = 0.0, 0.0, 0.0, 1e30, -1e30
            for y in range(top, min(height, top + TILE)):
                for x in range(left, min(width, left + TILE)):
                    s = cells[y, x, 0, 0]
                    layered = layered or cells[y, x, 0, 1] < 1
                    for layer in range(layers):
                        other = cells[y, x, layer, 0]
                        low, high = min(low, other), max(high, other)
                        layered = layered or other != s
                    if x + 1 < width:
                        layered = layered or abs(cells[y, x + 1, 0, 0] - s) > _MAX_SLOPE
                    if y + 1 < height:
                        layered = layered or abs(cells[y + 1, x, 0, 0] - s) > _MAX_SLOPE
                    total += s
                    right += s * (x - left - 0.5 * (TILE - 1))
                    down += s * (y - top - 0.5 * (TILE - 1))
            surfaces[row, column, _MIDDLE] = total / (TILE * TILE)
            surfaces[row, column, _RIGHT] = right / moment
            surfaces[row, column, _DOWN] = down / moment
            surfaces[row, column, _LOW] = low
            surfaces[row, column, _HIGH] = high
            surfaces[row, column, _LAYERED] = 1.0 if layered else 0.0


@njit(cache=True, forceinline=True)
def _field(x, y, lens, above):
    """Return the field position, limited to the corner."""
    far_x, far_y = (x - lens.column) * lens.scale, (y + above - lens.row) * lens.scale
    shrink = 1.0 / max(math.sqrt(far_x * far_x + far_y * far_y), 1.0)
    return np.float32(far_x * shrink), np.float32(far_y * shrink)


@njit(cache=True, forceinline=True)
def _reach_of(own, line):
    """Return the reach of a tile's bundle on its plane, pixels, blocks included."""
    rise = line[-1] * (abs(own[_RIGHT]) + abs(own[_DOWN]))  # change of the radius per pixel of reach
    within = max(extent_at(line, own[_LOW]), extent_at(line, own[_HIGH]))
    return within / max(1.0 - rise, 0.01) + _MAX_BLOCK_PX


@njit(cache=True, forceinline=True)
def _plane_tolerance(own):
    """Return the tolerance of surfaces to a tile's plane, pixels of defocus."""
    return max(_MAX_DEVIATION_PX, _MAX_DEVIATION_FRACTION * max(abs(own[_LOW]), abs(own[_HIGH])))


@njit(cache=True)
def _classify(surfaces, row, column, line, flat, low, high):
    """Return ``_PLANE`` if a tile's rays meet its plane within ``flat`` pixels, else ``_CURVED``."""
    own = surfaces[row, column]
    rows, columns = surfaces.shape[:2]
    slack = flat + 0.5 * TILE * (abs(own[_RIGHT]) + abs(own[_DOWN]))
    farthest = max(extent_at(line, low), extent_at(line, high))
    reach = int(math.ceil(farthest / TILE)) + 1
    for v in range(max(0, row - reach), min(rows, row + reach + 1)):
        gap_y = TILE * max(abs(v - row) - 1, 0)
        for u in range(max(0, column - reach), min(columns, column + reach + 1)):
            gap_x, other = TILE * max(abs(u - column) - 1, 0), surfaces[v, u]
            square = gap_x * gap_x + gap_y * gap_y
            if square > farthest * farthest:
                continue
            within = max(extent_at(line, other[_LOW]), extent_at(line, other[_HIGH]))
            if square > within * within:
                continue
            if other[_LAYERED] > 0.0:
                return _CURVED
            level = own[_MIDDLE] + TILE * ((u - column) * own[_RIGHT] + (v - row) * own[_DOWN])
            if other[_LOW] < level - slack or other[_HIGH] > level + slack:
                return _CURVED
    return _PLANE


@njit(cache=True, parallel=True)
def _classify_tiles(surfaces, rays_mask, near, lens, above, extents, low, high, kinds):
    """Fill ``kinds`` (rows, columns) of the tiles; all surfaces are between ``low`` and ``high``."""
    height, width = rays_mask.shape
    half = 0.5 * (TILE - 1)
    for row in prange(kinds.shape[0]):
        for column in range(kinds.shape[1]):
            kinds[row, column] = _RAYS
            own, top, left = surfaces[row, column], row * TILE, column * TILE
            has_bundle_pixels = False
            for y in range(top, min(height, top + TILE)):
                for x in range(left, min(width, left + TILE)):
                    has_bundle_pixels = has_bundle_pixels or (rays_mask[y, x] and near[y, x] < 1.0)
            if own[_LAYERED] > 0.0 or not has_bundle_pixels:
                continue
            h_x, h_y = _field(left + half, top + half, lens, above)
            line = extents[ring_of(h_x, h_y, extents)]
            reach = _reach_of(own, line)
            inside = min(min(left, top), min(width - left, height - top) - TILE)
            flat = _plane_tolerance(own)
            steep = 0.5 * TILE * (abs(own[_RIGHT]) + abs(own[_DOWN])) > flat
            ring, per_pixel = ring_of(h_x, h_y, extents), lens.scale * (lens.max_aberration.shape[0] - 1)
            next_ring = min(ring + 1, lens.max_aberration.shape[0] - 1)
            aberration_change = abs(lens.max_aberration[next_ring] - lens.max_aberration[ring]) * per_pixel
            steep = steep or 0.5 * TILE * aberration_change > flat
            if steep or reach > _MAX_REACH_PX:
                continue
            kinds[row, column] = _classify(surfaces, row, column, line, flat, low, high)
            if kinds[row, column] == _PLANE and reach > inside:
                kinds[row, column] = _CURVED


@njit(cache=True, parallel=True)
def _fill_planes(colors, first, planes):
    """Fill the colors of the first layer and their means over blocks that begin at a pixel.

    ``planes``: (1, 2, 4 pixels a side; 3, rows, columns); they begin at row ``first`` and ``_MAX_REACH_PX``
    columns before the picture. Pixels repeat beyond the border.
    """
    rows, columns = planes.shape[2:]
    last_row, last_column = colors.shape[0] - 1, colors.shape[1] - 1
    for y in prange(rows):
        for level in range(planes.shape[0]):
            side = 1 << level
            for c in range(3):
                for x in range(columns):
                    planes[level, c, y, x] = 0.0
                for v in range(side):
                    at = min(max(first + y + v, 0), last_row)
                    for x in range(columns):
                        planes[level, c, y, x] += colors[
                            at, min(max(x - _MAX_REACH_PX, 0), last_column), 0, c
                        ]
                if side == 1:
                    continue
                scale = np.float32(1.0 / (side * side))
                for x in range(columns):
                    total = planes[level, c, y, x]
                    for u in range(1, side):
                        total += planes[level, c, y, min(x + u, columns - 1)]
                    planes[level, c, y, x] = scale * total


@njit(cache=True)
def _send_bundle(own, x, y, arrays, lens, collapsed, field, cats_eye_at, curved, rays):
    """Fill ``rays`` (5 * BUNDLE): offsets right and down of the hits, and their red, green, blue.

    ``curved``: cells, flat, and their size, for the intersection with the surface; a size of 0 means the
    tile's plane.
    """
    cells, size = curved
    corner_x, corner_y = broadcast8(np.float32(x)), broadcast8(np.float32(y))
    last_x, last_y = broadcast8(np.float32(size[1] - 1)), broadcast8(np.float32(size[0] - 1))
    close = broadcast8(CLOSE)
    points, weights = arrays
    us, vs = points[0].reshape(-1), points[1].reshape(-1)
    front_weights, back_weights = weights[0].reshape(-1), weights[1].reshape(-1)
    h_x, h_y = field
    collapse(lens.coefficients, h_x * h_x + h_y * h_y, collapsed)
    ring = min(math.sqrt(h_x * h_x + h_y * h_y), 1.0) * (lens.max_aberration.shape[0] - 1)
    jitter = broadcast8(np.float32(lens.jitter_scale[int(ring)]))
    zero, half, one = broadcast8(np.float32(0)), broadcast8(np.float32(0.5)), broadcast8(np.float32(1))
    middle = broadcast8(np.float32(own[_MIDDLE]))
    right, down = broadcast8(np.float32(own[_RIGHT])), broadcast8(np.float32(own[_DOWN]))
    for k in range(0, BUNDLE, LANES):
        u, v = load8(us, k), load8(vs, k)
        e_x, e_y, a_x, a_y = send_rays(collapsed, lens.tilt, u, v, h_x, h_y, load8(lens.waves, k))
        if lens.chromatic_aberration.shape[1] > 0:
            axial = load8(lens.chromatic_aberration[0], k) * broadcast8(lens.maps[y, x, 0])
            lateral = load8(lens.chromatic_aberration[1], k) * broadcast8(lens.maps[y, x, 1])
            e_x = e_x + u * axial + lateral * broadcast8(h_x)
            e_y = e_y + v * axial + lateral * broadcast8(h_y)
        depth = divide8(middle - right * e_x - down * e_y, one + right * a_x + down * a_y)
        if size[0] > 0:
            from_x, from_y = corner_x - e_x, corner_y - e_y
            for _ in range(_MAX_ITERATIONS):
                column = min8(max8(floor8(from_x - a_x * depth), zero), last_x)
                row = min8(max8(floor8(from_y - a_y * depth), zero), last_y)
                surface_depth, _ = gather_pairs8(cells, row, column, size[1], 2 * size[2], 0)
                error = abs8(surface_depth - depth)
                depth = surface_depth
                if not any8(less8(close, error)):
                    break
        w = select8(less8(zero, depth), load8(front_weights, k), load8(back_weights, k))
        if cats_eye_at[0] > 0:
            w = keep_within(u, v, cats_eye_at[1], cats_eye_at[2], 1.0, w)
        for rim in range(lens.vignetting_apertures.shape[0]):
            shift, radius = lens.vignetting_apertures[rim]
            w = keep_within(u, v, shift * h_x, shift * h_y, radius, w)
        store8(rays, k, floor8(half + jitter * load8(lens.starts[0], k) - e_x - a_x * depth))
        store8(rays, BUNDLE + k, floor8(half + jitter * load8(lens.starts[1], k) - e_y - a_y * depth))
        if lens.colors.shape[1] > 0:
            for c in range(3):
                store8(rays, (2 + c) * BUNDLE + k, w * load8(lens.colors[c], k))
        else:
            for c in range(3):
                store8(rays, (2 + c) * BUNDLE + k, w)


@njit(cache=True, forceinline=True)
def _first_level(reach):
    """Return the level of the largest blocks that can have little enough light for a disc of this reach."""
    level = 0
    while (2 << level) <= _MAX_BLOCK_PX and (2 << level) ** 2 <= _MAX_BLOCK_FRACTION * math.pi * (
        reach + 1
    ) ** 2:
        level += 1
    return level


@njit(cache=True)
def _gather_taps(rays, level, reach, slots, places, taps):
    """Aggregate rays that meet the same block of 2^level pixels a side.

    Args:
        rays: From :func:`_send_bundle`.
        level: Level of the blocks.
        reach: Upper bound of the offsets, pixels; rounding errors are clipped to it.
        slots: Index of each block's tap, -1 where there is none, (side, side); restored on return.
        places: Filled with offsets right and down of the blocks, (2, BUNDLE).
        taps: Filled with their red, green and blue, (3, BUNDLE), each with the sum 1.

    Returns:
        Number of taps, and the largest tap; 0 taps if a color has no light.
    """
    middle, count = slots.shape[0] // 2, 0
    for k in range(BUNDLE):
        if rays[2 * BUNDLE + k] + rays[3 * BUNDLE + k] + rays[4 * BUNDLE + k] <= 0.0:
            continue
        column = int(min(max(rays[k], -reach), reach)) >> level
        row = int(min(max(rays[BUNDLE + k], -reach), reach)) >> level
        slot = slots[middle + row, middle + column]
        if slot < 0:
            slot = count
            slots[middle + row, middle + column] = slot
            places[0, slot], places[1, slot] = column << level, row << level
            for c in range(3):
                taps[c, slot] = 0.0
            count += 1
        for c in range(3):
            taps[c, slot] += rays[(2 + c) * BUNDLE + k]
    for slot in range(count):
        slots[middle + (places[1, slot] >> level), middle + (places[0, slot] >> level)] = -1
    largest = 0.0
    for c in range(3):
        total = 0.0
        for slot in range(count):
            total += taps[c, slot]
        if total <= 0.0:
            return 0, 0.0
        for slot in range(count):
            taps[c, slot] = taps[c, slot] / total
            largest = max(largest, taps[c, slot])
    return count, largest


@njit(cache=True, forceinline=True)
def _sum_taps(plane, offsets, taps, count, start, width, sums, at):
    """Write the sums of eight pixels in each of four rows of a plane to ``sums`` from index ``at`` on."""
    zero = broadcast8(np.float32(0))
    a, b, c, d = zero, zero, zero, zero
    for i in range(count):
        tap, k = broadcast8(taps[i]), start + offsets[i]
        a = a + tap * load8(plane, k)
        b = b + tap * load8(plane, k + width)
        c = c + tap * load8(plane, k + 2 * width)
        d = d + tap * load8(plane, k + 3 * width)
    store8(sums, at, a)
    store8(sums, at + LANES, b)
    store8(sums, at + 2 * LANES, c)
    store8(sums, at + 3 * LANES, d)


@njit(cache=True, parallel=True)
def _render(
    planes, first, tile_kinds, tile_row, surfaces, cells, rays_mask, arrays, lens, extents, view, result
):
    """Render the tiles of rows of tiles from ``tile_row`` on; ``planes`` begin at row ``first``.

    ``view``: the cat's-eye, the position of the picture, and the rows above.
    """
    cats_eye, place, above = view
    width = planes.shape[3]
    flat, size = cells.reshape(-1), cells.shape
    half = 0.5 * (TILE - 1)
    middle = TILE // 2
    for i in prange(tile_kinds.shape[0]):
        collapsed = np.empty(lens.coefficients.shape[1:], np.float32)
        rays, taps = np.empty(5 * BUNDLE, np.float32), np.empty((3, BUNDLE), np.float32)
        places, offsets = np.empty((2, BUNDLE), np.int64), np.empty(BUNDLE, np.int64)
        slots = np.full((2 * _MAX_REACH_PX + 4, 2 * _MAX_REACH_PX + 4), -1, np.int32)
        tile_colors = np.empty(TILE * LANES, np.float32)
        for column in range(tile_kinds.shape[1]):
            if tile_kinds[i, column] == _RAYS:
                continue
            top, left = (tile_row + i) * TILE, column * TILE
            own = surfaces[tile_row + i, column]
            field = _field(left + half, top + half, lens, above)
            shift = cats_eye_shift(
                cats_eye, left + half + place[0], top + half + above + place[1], place[2], place[3]
            )
            cats_eye_at = (cats_eye, shift[0], shift[1])
            if tile_kinds[i, column] == _CURVED:
                curved = (flat, (size[0], size[1], size[2]))
            else:
                curved = (flat, (0, 0, 0))
            _send_bundle(
                *(own, left + middle, top + middle, arrays, lens, collapsed, field, cats_eye_at, curved, rays)
            )
            line = extents[ring_of(field[0], field[1], extents)]
            reach = math.floor(_reach_of(own, line)) - _MAX_BLOCK_PX
            count, level = 0, _first_level(reach)
            while level >= 0:
                count, largest = _gather_taps(rays, level, reach, slots, places, taps)
                if largest <= _MAX_BLOCK_FRACTION or level == 0:
                    break
                level -= 1
            if count == 0:
                continue
            for k in range(count):
                offsets[k] = places[1, k] * width + places[0, k]
            for c in range(3):
                plane = planes[level, c].reshape(-1)
                for part in range(0, TILE, 4):
                    start = (top + part - first) * width + left + _MAX_REACH_PX
                    _sum_taps(plane, offsets, taps[c], count, start, width, tile_colors, part * LANES)
                for y in range(TILE):
                    for x in range(TILE):
                        if rays_mask[top + y, left + x]:
                            result[top + y, left + x, c] = tile_colors[y * LANES + x]


def render_smooth_tiles(
    job: RaysJob, near: np.ndarray, extents: np.ndarray, result: np.ndarray
) -> np.ndarray:
    """Write tiles that see only one smooth surface to ``result``.

    Args:
        job: Layers, rays and an aberrated lens; the first ``BUNDLE`` points are used.
        near: Weight of the rays near steps, (H, W) float32 in [0, 1]; tiles with 1 in all pixels are skipped.
        extents: From :func:`bokehnet.classical.layered.march.bundle_extents.bundle_extents`.
        result: Colors, (H, W, 3), float32; pixels in ``job.rays_mask`` of the rendered tiles are overwritten.

    Returns:
        Fraction of each pixel that is left for the rays, (H, W) float32: ``near``, and 1 where no bundle is
        used.
    """
    assert job.lens is not None
    cells, rays_mask = job.cells, job.rays_mask
    height, width = rays_mask.shape
    tile_rows, tile_columns = -(-height // TILE), -(-width // TILE)
    surfaces = np.empty((tile_rows, tile_columns, 6), np.float32)
    kinds = np.empty((tile_rows, tile_columns), np.int8)
    arrays, viewport = (job.points, job.weights), job.viewport or Viewport.whole(height, width)
    with parallel_region:
        _tile_surfaces(cells, surfaces)
        low, high = float(surfaces[..., _LOW].min()), float(surfaces[..., _HIGH].max())
        _classify_tiles(surfaces, rays_mask, near, job.lens, job.above, extents, low, high, kinds)
        for top in range(0, tile_rows, _BAND // TILE):
            rows = kinds[top : top + _BAND // TILE]
            if not (rows != _RAYS).any():
                continue
            first = top * TILE - _MAX_REACH_PX
            shape = (len(rows) * TILE + 2 * _MAX_REACH_PX, width + 2 * _MAX_REACH_PX)
            planes = np.empty((1 + int(math.log2(_MAX_BLOCK_PX)), 3, *shape), np.float32)
            _fill_planes(job.colors, first, planes)
            _render(
                *(planes, first, rows, top, surfaces, cells, rays_mask, arrays, job.lens, extents),
                *((job.cats_eye, viewport.as_tuple(), job.above), result),
            )
    rendered = np.kron(kinds != _RAYS, np.ones((TILE, TILE), np.bool_))[:height, :width]
    return np.where(rendered, near, np.float32(1))
