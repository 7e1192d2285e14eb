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

from bokehnet.classical.brightness import brightest, outshining
from bokehnet.classical.gaps import JUMP
from bokehnet.classical.layers import Layers
from bokehnet.classical.parallel import parallel_region
from bokehnet.classical.ray_kernels import SLICES, TILE, fair_stride, meet, slice_runs
from bokehnet.optics.aperture import Aperture, cats_eye_shift, transmission

__all__ = ["add_lights", "separate_lights"]

# Sharper lights stay in the picture.
_SMALLEST_RADIUS = 6.0

# At most this share of the pixels are lights, the brightest ones, so that their discs stay affordable.
_MOST = 1 / 20

# Lights are gathered in cells of this share of their radius.
_CELL = 1 / 16

_GRID = 256


def separate_lights(image: np.ndarray, defocus: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Part a picture into lights and the rest; their sum is the picture.

    Args:
        image: Scene-linear, (H, W, 3), float32.
        defocus: Signed blur radius in pixels, (H, W).

    Returns:
        The rest and the lights, both (H, W, 3). A light is what outshines the window that the largest disc
        spans. If more than a twentieth of the pixels does, the brightest are taken.
    """
    share = outshining(image, math.ceil(float(np.abs(defocus).max())))
    share[np.abs(defocus) < _SMALLEST_RADIUS] = 0.0
    excess, most = share * brightest(image), int(_MOST * share.size)
    if np.count_nonzero(excess) > most:
        share[excess < np.partition(excess, -most - 1, axis=None)[-most - 1]] = 0.0
    lights = image * share[..., None]
    return image - lights, lights


def _gather(lights: np.ndarray, defocus: np.ndarray) -> np.ndarray:
    """Lights as rows (x, y, defocus, red, green, blue); neighbours in one cell of like defocus become one.

    A cell is a square of a power of two pixels, at most ``_CELL`` of the radius.
    """
    y, x = np.nonzero(brightest(lights) > 0)
    depth, color = defocus[y, x].astype(np.float64), lights[y, x].astype(np.float64)
    size = 2.0 ** np.floor(np.log2(np.maximum(np.abs(depth) * _CELL, 1.0)))
    keys = np.stack([size, x // size, y // size, np.round(depth / JUMP)], axis=1)
    _, group = np.unique(keys, axis=0, return_inverse=True)
    group = group.reshape(-1)
    weight = color.sum(axis=1)
    total = np.bincount(group, weight)
    mean = [np.bincount(group, weight * value) / total for value in (x, y, depth)]
    return np.stack(mean + [np.bincount(group, color[:, c]) for c in range(3)], axis=1)


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
def _add_lights(found, totals, depths, coverage, mask, slices, low, thickness, grids, cats_eye, result):  # type: ignore[no-untyped-def]
    height, width = mask.shape
    stride = fair_stride(slices.shape[0])
    for number in prange(slices.shape[0]):
        tile_row = np.int64(number) * stride % slices.shape[0]
        runs = np.empty((SLICES // 2, 2))
        top, bottom = tile_row * TILE, min(height, (tile_row + 1) * TILE)
        for i in range(found.shape[0]):
            light_x, light_y, depth = found[i, 0], found[i, 1], found[i, 2]
            radius = abs(depth)
            if light_y + radius + 1.0 < top or light_y - radius - 1.0 > bottom or totals[i] <= 0.0:
                continue
            left = max(0, int(math.floor(light_x - radius - 0.5)))
            right = min(width, int(math.ceil(light_x + radius + 0.5)) + 1)
            tile_before = -1
            count = 0
            for x in range(left, right):
                if x // TILE != tile_before:
                    tile_before = x // TILE
                    count = slice_runs(slices[tile_row, tile_before], low, thickness, runs)
                    while count > 0 and runs[count - 1, 0] <= depth + JUMP:  # nothing there is in front
                        count -= 1
                for y in range(top, bottom):
                    if not mask[y, x]:
                        continue
                    w = _light_at(grids, radius, depth, x - light_x, y - light_y) / totals[i]
                    if w <= 0.0:
                        continue
                    u, v = (x - light_x) / depth, (y - light_y) / depth
                    shift_x, shift_y = cats_eye_shift(cats_eye, x, y, width, height)
                    if cats_eye > 0 and (u - shift_x) ** 2 + (v - shift_y) ** 2 > 1.0:
                        continue
                    row, column, layer = meet(depths, coverage, runs, count, x, y, u, v, 0.5)
                    if layer >= 0 and depths[row, column, layer] > depth + JUMP:
                        continue
                    for c in range(3):
                        result[y, x, c] += w * found[i, 3 + c]


def add_lights(
    lights: np.ndarray,
    defocus: np.ndarray,
    layers: Layers,
    mask: np.ndarray,
    slices: tuple[np.ndarray, float, float],
    aperture: Aperture,
    result: np.ndarray,
) -> None:
    """Add every light's disc to the pixels of ``mask`` that see it past what stands in front.

    Args:
        lights: From :func:`separate_lights`, (H, W, 3).
        defocus: Of the lights, (H, W).
        layers: What can stand in front of them.
        mask: Pixels to add to, (H, W) bool.
        slices: From :func:`bokehnet.classical.ray_kernels.occupied_slices`.
        aperture: Shape of the discs.
        result: Changed in place, (H, W, 3), float32.
    """
    found = _gather(lights, defocus)
    if not len(found):
        return
    axis = (np.arange(_GRID) + 0.5) * (2 / _GRID) - 1
    grids = np.stack([transmission(aperture, axis[None], axis[:, None], side) for side in (1, -1)])
    totals = np.zeros(len(found))
    with parallel_region:
        _totals(found, grids, totals)
        _add_lights(
            found,
            totals,
            layers.defocus,
            layers.coverage,
            mask,
            *slices,
            grids,
            aperture.cats_eye,
            result,
        )
