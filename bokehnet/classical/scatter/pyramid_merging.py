"""Numba kernels between a picture and its half: merge sources on the way down, double sums on the way up.

Four sources that form a 2x2 block become one pixel of the half-size picture if their discs are large and
similar and none of them is far brighter than its surroundings. All others stay. Each kernel is followed by
its adjoint.
"""

import math

import numpy as np
from numba import prange

from bokehnet.kernels import njit

__all__ = ["TILE", "add_doubled", "halve_gradient", "merge_blocks", "split_gradients"]

# Side of the tiles over which a pixel's surroundings are averaged, pixels.
TILE = 8


@njit(cache=True)
def _merged_defocus(defocus, y, x, threshold, tolerance, excess):
    """Return the half-size defocus of the block at (y, x); 0 if its discs are small or differ."""
    a, b = np.float64(defocus[y, x]), np.float64(defocus[y, x + 1])
    c, d = np.float64(defocus[y + 1, x]), np.float64(defocus[y + 1, x + 1])
    low, high = min(min(a, b), min(c, d)), max(max(a, b), max(c, d))
    smallest = max(low, -high)
    if smallest <= threshold or high - low > tolerance * smallest:
        return 0.0
    mean = 0.25 * (a + b + c + d)
    return math.copysign(0.5 * math.sqrt(mean * mean - excess), mean)


@njit(cache=True)
def _select_blocks(defocus, top, left, bottom, right, threshold, tolerance, excess, coarse_defocus):
    """Fill a tile of ``coarse_defocus`` by the radii alone; return whether any block can be merged."""
    any_merged = False
    for y in range(top, bottom, 2):
        for x in range(left, right, 2):
            merged = 0.0
            if y + 1 < bottom and x + 1 < right:
                merged = _merged_defocus(defocus, y, x, threshold, tolerance, excess)
            coarse_defocus[y // 2, x // 2] = merged
            any_merged |= merged != 0.0
    return any_merged


@njit(cache=True)
def _mean_magnitude(values, top, left, bottom, right):
    """Return the mean magnitude of the four channels over a tile."""
    a, b, c, d = 0.0, 0.0, 0.0, 0.0
    for y in range(top, bottom):
        for x in range(left, right):
            a += abs(values[y, x, 0])
            b += abs(values[y, x, 1])
            c += abs(values[y, x, 2])
            d += abs(values[y, x, 3])
    count = (bottom - top) * (right - left)
    return a / count, b / count, c / count, d / count


@njit(cache=True)
def _outshines(values, y, x, mean, contrast):
    """Return whether one of the four pixels at (y, x) exceeds ``contrast`` times the mean in a channel."""
    above = False
    for v in range(y, y + 2):
        for u in range(x, x + 2):
            above |= abs(values[v, u, 0]) > contrast * mean[0]
            above |= abs(values[v, u, 1]) > contrast * mean[1]
            above |= abs(values[v, u, 2]) > contrast * mean[2]
            above |= abs(values[v, u, 3]) > contrast * mean[3]
    return above


@njit(cache=True, parallel=True)
def merge_blocks(values, defocus, threshold, tolerance, contrast, excess, coarse_values, coarse_defocus):
    """Move sources from the picture to its half.

    Args:
        values: Values to spread, (H, W, 4); set to 0 where they are merged.
        defocus: Signed radius, (H, W); set to 0 where it is merged.
        threshold: Radius above which discs are merged, pixels.
        tolerance: Largest difference of the radii in a block, as a fraction of the smallest.
        contrast: A pixel above ``contrast`` times the mean of its tile prevents the merge of its block.
        excess: Amount that merging and doubling add to the square of the radius, pixels^2.
        coarse_values: Filled with the means of the merged blocks, else 0, (ceil H/2, ceil W/2, 4).
        coarse_defocus: Filled with their radii in pixels of the half, else 0.
    """
    height, width = defocus.shape
    for tile in prange((height + TILE - 1) // TILE):
        top = np.int64(tile) * TILE
        bottom = min(top + TILE, height)
        for left in range(0, width, TILE):
            right = min(left + TILE, width)
            mean = (0.0, 0.0, 0.0, 0.0)
            if _select_blocks(
                defocus, top, left, bottom, right, threshold, tolerance, excess, coarse_defocus
            ):
                mean = _mean_magnitude(values, top, left, bottom, right)
            for y in range(top, bottom, 2):
                for x in range(left, right, 2):
                    if coarse_defocus[y // 2, x // 2] == 0.0 or _outshines(values, y, x, mean, contrast):
                        coarse_defocus[y // 2, x // 2] = 0.0
                        for c in range(4):
                            coarse_values[y // 2, x // 2, c] = 0.0
                        continue
                    for c in range(4):
                        upper = values[y, x, c] + values[y, x + 1, c]
                        lower = values[y + 1, x, c] + values[y + 1, x + 1, c]
                        coarse_values[y // 2, x // 2, c] = 0.25 * (upper + lower)
                    for v in range(y, y + 2):
                        for u in range(x, x + 2):
                            defocus[v, u] = 0.0
                            for c in range(4):
                                values[v, u, c] = 0.0


@njit(cache=True, parallel=True)
def split_gradients(
    excess, coarse_defocus, coarse_grad_values, coarse_grad_defocus, grad_values, grad_defocus
):
    """Compute the adjoint of :func:`merge_blocks`: overwrite the gradients of merged pixels."""
    height, width = grad_defocus.shape
    for row in prange(height // 2):
        y = 2 * np.int64(row)
        for x in range(0, width - 1, 2):
            merged = np.float64(coarse_defocus[y // 2, x // 2])
            if merged == 0.0:
                continue
            # merged = sqrt(mean^2 - excess) / 2, hence d merged / d mean = mean / (4 merged).
            growth = math.sqrt(4.0 * merged * merged + excess) / (4.0 * abs(merged))
            for v in range(y, y + 2):
                for u in range(x, x + 2):
                    grad_defocus[v, u] = 0.25 * growth * coarse_grad_defocus[y // 2, x // 2]
                    for c in range(4):
                        grad_values[v, u, c] = 0.25 * coarse_grad_values[y // 2, x // 2, c]


@njit(cache=True)
def _second(i, size):
    """Return the coarse pixel second nearest to pixel i, of weight 1/4; the nearest has weight 3/4."""
    return min(max(i // 2 + 2 * (i % 2) - 1, 0), size - 1)


@njit(cache=True, parallel=True)
def add_doubled(coarse, sums):
    """Add ``coarse`` (ceil H/2, ceil W/2, 4), doubled by bilinear interpolation, to ``sums`` (H, W, 4)."""
    height, width, _ = sums.shape
    size = coarse.shape[1]
    for row in prange(height):
        y = np.int64(row)
        near, far = y // 2, _second(y, coarse.shape[0])
        line = np.empty((size + 2, 4), coarse.dtype)  # with the border pixels repeated
        for x in range(size):
            for c in range(4):
                line[x + 1, c] = 0.75 * coarse[near, x, c] + 0.25 * coarse[far, x, c]
        line[0], line[size + 1] = line[1], line[size]
        for x in range(width // 2):
            for c in range(4):
                middle = 0.75 * line[x + 1, c]
                sums[y, 2 * x, c] += middle + 0.25 * line[x, c]
                sums[y, 2 * x + 1, c] += middle + 0.25 * line[x + 2, c]
        if width % 2:
            for c in range(4):
                sums[y, width - 1, c] += 0.75 * line[size, c] + 0.25 * line[size - 1, c]


@njit(cache=True, parallel=True)
def halve_gradient(gradient, coarse):
    """Compute the adjoint of :func:`add_doubled`: ``coarse`` (ceil H/2, ceil W/2, 4) from ``gradient``."""
    height, width, _ = gradient.shape
    for coarse_row in prange(coarse.shape[0]):
        row = np.int64(coarse_row)
        line = np.zeros((width, 4), gradient.dtype)
        first = 2 * row - 1 if row > 0 else 0
        for y in range(first, min(2 * row + 3, height)):
            weight = 0.75 * (y // 2 == row) + 0.25 * (_second(y, coarse.shape[0]) == row)
            for x in range(width):
                for c in range(4):
                    line[x, c] += weight * gradient[y, x, c]
        coarse[row] = 0.0
        for x in range(width):
            second = _second(x, coarse.shape[1])
            for c in range(4):
                coarse[row, x // 2, c] += 0.75 * line[x, c]
                coarse[row, second, c] += 0.25 * line[x, c]
