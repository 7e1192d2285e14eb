"""Bright lights apart from the rest: found in the picture, and laid out as whole aperture shapes.

A small light fills a wide disc evenly, but only a few of a pixel's rays would find it. So lights that
stand far above their surroundings are taken out of what the rays gather, and each is added to every pixel
of its disc from which it can be seen.

Source: "Efficient and expressive rendering for real-time defocus blur and bokeh" (dissertation), chapter 5,
for lights apart from the rest with visibility of their own; visibility by rays through layers is ours.
"""

import math

import numpy as np
from numba import njit, prange

from bokehnet.classical.brightness import brightest, light_limit
from bokehnet.classical.gaps import JUMP
from bokehnet.classical.lanes import LANES, ORDER, count_lanes, splat_lanes
from bokehnet.classical.layers import Layers
from bokehnet.classical.meeting import meet
from bokehnet.classical.parallel import parallel_region
from bokehnet.classical.ray_kernels import SLICES, TILE, fair_stride, slice_runs
from bokehnet.optics.aperture import Aperture, cats_eye_shift, transmission

__all__ = ["add_lights", "separate_lights"]

# Sharper lights stay in the picture.
_SMALLEST_RADIUS = 3.0

# At most this share of the pixels are lights, the brightest ones, so that their discs stay affordable.
_MOST = 1 / 20

# Lights are gathered in cells of this share of their radius.
_CELL = 1 / 16

_GRID = 256


def separate_lights(layers: Layers, reach: int | None = None) -> tuple[Layers, np.ndarray]:
    """Part layers into lights and the rest.

    A light is what outshines the window around it. Where nearer layers cover a part of its
    pixel, only the share that they leave is its light; where they cover all, it stays in its layer.

    Args:
        layers: As split from a picture, or true ones.
        reach: Half-width in pixels of the window that a light outshines; default: the largest radius.

    Returns:
        Layers without lights, and the lights as rows (x, y, defocus, red, green, blue), lights of like
        defocus in one small cell gathered into one of their energy. If more than a twentieth of the pixels
        are lights, the brightest are taken.
    """
    if reach is None:
        reach = math.ceil(float(np.abs(layers.defocus).max()))
    limit = light_limit(layers.colors[:, :, 0], reach)
    colors, lights = layers.colors.copy(), []
    seen: np.ndarray = np.ones(limit.shape, np.float32)
    for layer in range(layers.defocus.shape[2]):
        brightness, coverage = brightest(layers.colors[:, :, layer]), layers.coverage[:, :, layer]
        share = seen * coverage
        blurred = np.abs(layers.defocus[:, :, layer]) >= _SMALLEST_RADIUS
        y, x = np.nonzero((share > 0) & (brightness > limit) & blurred)
        amount = share[y, x]
        excess = 1.0 - limit[y, x] / brightness[y, x]
        most = int(_MOST * limit.size)
        if len(y) > most:
            kept = np.argsort(-amount * excess * brightness[y, x], kind="stable")[:most]
            y, x, amount, excess = y[kept], x[kept], amount[kept], excess[kept]
        color = colors[y, x, layer] * excess[:, None]
        colors[y, x, layer] -= color
        lights.append(np.column_stack([x, y, layers.defocus[y, x, layer], amount[:, None] * color]))
        seen = seen * (1.0 - coverage)
    rest = Layers(colors=colors, defocus=layers.defocus, coverage=layers.coverage)
    return rest, _gather(np.concatenate(lights).astype(np.float64))


def _gather(lights: np.ndarray) -> np.ndarray:
    """Make one light of those of like defocus in one cell.

    A cell is a square of a power of two pixels, at most ``_CELL`` of the radius wide.
    """
    x, y, depth = lights[:, 0], lights[:, 1], lights[:, 2]
    size = 2.0 ** np.floor(np.log2(np.maximum(np.abs(depth) * _CELL, 1.0)))
    keys = np.stack([size, x // size, y // size, np.round(depth / JUMP)], axis=1)
    _, group = np.unique(keys, axis=0, return_inverse=True)
    group = group.reshape(-1)
    weight = lights[:, 3:].sum(axis=1)
    total = np.bincount(group, weight)
    mean = [np.bincount(group, weight * value) / total for value in (x, y, depth)]
    return np.stack(mean + [np.bincount(group, lights[:, c]) for c in (3, 4, 5)], axis=1)


@njit(cache=True)
def _light_at(grids, radius, depth, x, y):  # type: ignore[no-untyped-def]
    """Transmission at a pixel (x, y) from the light's centre, averaged over the pixel."""
    size = grids.shape[1]
    steps = 1 if radius >= 16.0 else (2 if radius >= 8.0 else 4)
    grid = grids[0 if depth > 0 else 1]
    total = 0.0
    for i in range(steps):
        v = (y + (i + 0.5) / steps - 0.5) / depth
        row = int(math.floor((v + 1.0) * 0.5 * size))
        if row < 0 or row >= size:
            continue
        for j in range(steps):
            u = (x + (j + 0.5) / steps - 0.5) / depth
            column = int(math.floor((u + 1.0) * 0.5 * size))
            if 0 <= column < size:
                total += grid[row, column]
    return total / (steps * steps)


@njit(cache=True, parallel=True)
def _totals(found, grids, totals):  # type: ignore[no-untyped-def]
    """Sum of each light's disc on whole pixels, so that its energy is exact."""
    for i in prange(found.shape[0]):
        depth = found[i, 2]
        radius = abs(depth)
        reach = int(math.ceil(radius + 0.5))
        fraction_x, fraction_y = found[i, 0] - math.floor(found[i, 0]), found[i, 1] - math.floor(found[i, 1])
        for y in range(-reach, reach + 2):
            for x in range(-reach, reach + 2):
                totals[i] += _light_at(grids, radius, depth, x - fraction_x, y - fraction_y)


@njit(cache=True, parallel=True)
def _add_lights(found, totals, cells, mask, slices, low, thickness, grids, cats_eye, result):  # type: ignore[no-untyped-def]
    height, width = mask.shape
    size = (height, width, cells.shape[2])
    flat = cells.reshape(-1)
    stride = fair_stride(slices.shape[0])
    for number in prange(slices.shape[0]):
        tile_row = np.int64(number) * stride % slices.shape[0]
        runs = np.empty((SLICES // 2, 2))
        met, strength = np.empty(3 * LANES, np.float32), np.empty(TILE)
        top, bottom = tile_row * TILE, min(height, (tile_row + 1) * TILE)
        for i in range(found.shape[0]):
            light_x, light_y, depth = found[i, 0], found[i, 1], found[i, 2]
            radius = abs(depth)
            if light_y + radius + 1.0 < top or light_y - radius - 1.0 > bottom or totals[i] <= 0.0:
                continue
            left = max(0, int(math.floor(light_x - radius - 0.5)))
            right = min(width, int(math.ceil(light_x + radius + 0.5)) + 1)
            per_pixel = splat_lanes(np.float32(1.0 / depth))
            for tile_column in range(left // TILE, (right + TILE - 1) // TILE):
                count = slice_runs(slices[tile_row, tile_column], low, thickness, runs)
                while count > 0 and runs[count - 1, 0] <= depth + JUMP:  # nothing there is in front
                    count -= 1
                begin = tile_column * TILE
                for y in range(top, bottom):
                    brightest_here = 0.0
                    for x in range(begin, min(width, begin + TILE)):
                        w = 0.0
                        if mask[y, x]:
                            u, v = (x - light_x) / depth, (y - light_y) / depth
                            shift_x, shift_y = cats_eye_shift(cats_eye, x, y, width, height)
                            if cats_eye <= 0 or (u - shift_x) ** 2 + (v - shift_y) ** 2 <= 1.0:
                                w = _light_at(grids, radius, depth, x - light_x, y - light_y) / totals[i]
                        strength[x - begin] = w
                        brightest_here = max(brightest_here, w)
                    if brightest_here <= 0.0:
                        continue
                    if count > 0:
                        place_x = count_lanes(np.float32(begin))
                        place_y = splat_lanes(np.float32(y))
                        across = (place_x - splat_lanes(np.float32(light_x))) * per_pixel
                        down = splat_lanes(np.float32((y - light_y) / depth))
                        half = splat_lanes(np.float32(0.5))
                        meet(flat, size, runs, count, place_x, place_y, across, down, half, met)
                    for lane in range(LANES):
                        x = begin + ORDER[lane]
                        w = strength[ORDER[lane]] if x < width else 0.0
                        if w <= 0.0:
                            continue
                        layer = int(met[2 * LANES + lane]) if count > 0 else -1
                        if layer >= 0:
                            row, column = int(met[lane]), int(met[LANES + lane])
                            if cells[row, column, layer, 0] > depth + JUMP:
                                continue
                        for c in range(3):
                            result[y, x, c] += w * found[i, 3 + c]


def add_lights(
    lights: np.ndarray,
    cells: np.ndarray,
    mask: np.ndarray,
    slices: tuple[np.ndarray, float, float],
    aperture: Aperture,
    result: np.ndarray,
) -> None:
    """Add every light's disc to the pixels of ``mask`` that see it past what stands in front.

    Args:
        lights: From :func:`separate_lights`, (N, 6).
        cells: What can stand in front of them, from :func:`bokehnet.classical.meeting.layer_cells`.
        mask: Pixels to add to, (H, W) bool.
        slices: From :func:`bokehnet.classical.ray_kernels.occupied_slices`.
        aperture: Shape of the discs.
        result: Changed in place, (H, W, 3), float32.
    """
    if not len(lights):
        return
    axis = (np.arange(_GRID) + 0.5) * (2 / _GRID) - 1
    grids = np.stack([transmission(aperture, axis[None], axis[:, None], side) for side in (1, -1)])
    totals = np.zeros(len(lights))
    with parallel_region:
        _totals(lights, grids, totals)
        _add_lights(
            lights,
            totals,
            cells,
            mask,
            *slices,
            grids,
            aperture.cats_eye,
            result,
        )
