"""Adaptive number of rays per tile.

All pixels send ``FIRST_RAYS`` rays. A function of type ``SampleCounts`` reads their light and returns the
total number of rays. :func:`counts_by_variance` returns the more, the higher the visible noise of the picture
is after blurred surfaces are averaged (:mod:`bokehnet.classical.layered.march.ray_averages`). For a given
total, the noise is smallest if each pixel's number of rays is proportional to its standard deviation.

Source: Mitchell, "Generating antialiased images at low sampling densities", SIGGRAPH 1987, for more samples
where the first ones differ; Neyman, "On the two different aspects of the representative method", 1934, for
the optimal allocation.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numba import prange

from bokehnet.classical.layered.march.defocus_bins import TILE
from bokehnet.classical.layered.march.ray_accumulators import (
    BACK_GROUP,
    COLORED,
    FRONT_GROUP,
    GROUPS,
    SHARP_GROUP,
)
from bokehnet.classical.layered.march.ray_averages import window_reach
from bokehnet.kernels import njit

__all__ = ["FIRST_RAYS", "FirstPass", "SampleCounts", "counts_by_variance"]

# First rays of every pixel: one vector of eight.
FIRST_RAYS = 8

# Root mean square noise, in units of the sRGB curve from 0 to 1, of the nominal number of rays where it
# is optimal.
_NOISE = 0.0055

# Variance of evenly distributed rays over that of independent ones.
_EVENNESS = 0.25

# Blur radius, pixels, below which surfaces appear at their position, so that their coverage matters there.
_MAX_IN_PLACE_RADIUS_PX = 4.0

# Minimum number of triples of adjacent pixels for an estimate of the noise of a tile.
_MIN_TRIPLES = 8


class FirstPass(NamedTuple):
    """Result of the first rays of all pixels.

    Attributes:
        sums: Means of the first rays, see :mod:`bokehnet.classical.layered.march.ray_accumulators`; whole
            tiles of rows, (rows, W, GROUPS, numbers).
        rays_mask: Pixels that send rays, (rows, W) bool.
        cells: Cells of the same rows, from :func:`bokehnet.classical.layered.march.intersection.layer_cells`.
        nominal_rays: Rays of a pixel of average noise, and the minimum for one with an edge in focus.
        max_rays: Maximum number of rays of a pixel; a power of two.
    """

    sums: np.ndarray
    rays_mask: np.ndarray
    cells: np.ndarray
    nominal_rays: int
    max_rays: int


# Returns the total number of rays of each pixel of a tile, (rows, columns) int64: powers of two from
# ``FIRST_RAYS`` to ``max_rays``. It must not depend on anything beyond the tile.
SampleCounts = Callable[[FirstPass], np.ndarray]


def counts_by_variance(first_pass: FirstPass) -> np.ndarray:
    """Return the number of rays from the noise of the first ones; see ``SampleCounts``."""
    rows, width = first_pass.rays_mask.shape
    counts = np.empty((-(-rows // TILE), -(-width // TILE)), np.int64)
    _count(
        first_pass.sums,
        first_pass.rays_mask,
        first_pass.cells,
        first_pass.nominal_rays,
        first_pass.max_rays,
        _NOISE,
        counts,
    )
    return counts


@njit(cache=True, forceinline=True)
def _srgb_slope(light):
    """Return the derivative of the sRGB curve (IEC 61966-2-1)."""
    return 12.92 if light <= 0.0031308 else 1.055 / 2.4 * light ** (1 / 2.4 - 1.0)


@njit(cache=True)
def _tile_means(sums, rays_mask, top, left, means):
    """Fill ``means`` (GROUPS, numbers) with the sums over a tile; return the number of pixels."""
    pixels = 0
    means[:] = 0.0
    for y in range(top, min(sums.shape[0], top + TILE)):
        for x in range(left, min(sums.shape[1], left + TILE)):
            if rays_mask[y, x]:
                pixels += 1
                for group in range(GROUPS):
                    for c in range(means.shape[1]):
                        means[group, c] += sums[y, x, group, c]
    return pixels


@njit(cache=True)
def _blurred_noise(sums, rays_mask, top, left, colors, slopes):
    """Return the noise variance of the light of blurred surfaces after the first rays, and the sample count.

    Blurred light is linear over three pixels, so the deviation is noise: for independent noise,
    x[-1] - 2 x[0] + x[1] has 1 + 4 + 1 times its variance.
    """
    own = 1 if sums.shape[3] == COLORED else 0
    total, triples = 0.0, 0
    for y in range(top, min(sums.shape[0], top + TILE)):
        for c in range(3):
            i = 3 + own * c
            first, second, run_length = 0.0, 0.0, 0
            for x in range(left, min(sums.shape[1], left + TILE)):
                weight = 0.0
                for group in range(GROUPS):
                    weight += sums[y, x, group, i]
                if not rays_mask[y, x] or weight <= 0.0:
                    run_length = 0
                    continue
                value = 0.0
                for group in (FRONT_GROUP, BACK_GROUP):
                    value += sums[y, x, group, c] - colors[c] * sums[y, x, group, i]
                value /= weight
                if run_length >= 2:
                    bend = slopes[c] * (first - 2.0 * second + value)
                    total += bend * bend / 6.0
                    triples += 1
                first, second, run_length = second, value, run_length + 1
    return total / max(triples, 1), triples


@njit(cache=True, forceinline=True)
def _brightness(sums, y, x, group):
    """Return weight and light of a group at a pixel, mean over the colors."""
    last = sums.shape[3] - 2
    weight = 0.0
    for i in range(3, last):
        weight += sums[y, x, group, i]
    return weight / (last - 3), (sums[y, x, group, 0] + sums[y, x, group, 1] + sums[y, x, group, 2]) / 3.0


@njit(cache=True)
def _sharp_variance(sums, y, x, slope):
    """Return the variance of one ray, of the part of a pixel's light that no window averages.

    A ray returns the color of either a sharp surface or the mean of the blurred surfaces behind focus.
    """
    sharp, light = _brightness(sums, y, x, SHARP_GROUP)
    if sharp <= 0.0:
        return 0.0
    front, _ = _brightness(sums, y, x, FRONT_GROUP)
    back, light_beyond = _brightness(sums, y, x, BACK_GROUP)
    mean, beyond = light / sharp, 0.0
    if back > 0.0:
        beyond = light_beyond / back
    sharp_fraction = sharp / (sharp + back)
    variance = sharp_fraction * max(sums[y, x, SHARP_GROUP, sums.shape[3] - 2] / sharp - mean * mean, 0.0)
    variance += sharp_fraction * (1.0 - sharp_fraction) * (mean - beyond) * (mean - beyond)
    return slope * slope * variance * (sharp + back) / (sharp + back + front)


@njit(cache=True, parallel=True)
def _count(sums, rays_mask, cells, nominal_rays, max_rays, noise, counts):
    numbers = sums.shape[3]
    own = 1 if numbers == COLORED else 0
    for row in prange(counts.shape[0]):
        means, colors, slopes = np.empty((GROUPS, numbers)), np.zeros(3), np.zeros(3)
        for column in range(counts.shape[1]):
            top, left = row * TILE, column * TILE
            counts[row, column] = FIRST_RAYS
            if _tile_means(sums, rays_mask, top, left, means) == 0:
                continue
            for c in range(3):
                light, weight = 0.0, 0.0
                for group in range(GROUPS):
                    light += means[group, c]
                    weight += means[group, 3 + own * c]
                colors[c] = max(light, 0.0) / max(weight, 1e-12)
                slopes[c] = _srgb_slope(colors[c])
            blurred, steepness = 0.0, 0.0
            for group in (FRONT_GROUP, BACK_GROUP):
                steepness += means[group, numbers - 2]
                for i in range(3, numbers - 2):
                    blurred += means[group, i] / (numbers - 5)
            rays = 0.0
            if blurred > 0.0:
                variance, triples = _blurred_noise(sums, rays_mask, top, left, colors, slopes)
                side = 2.0 * window_reach(blurred, steepness) + 1.0
                rays = math.sqrt(nominal_rays * FIRST_RAYS * variance) / (noise * side)
                if triples < _MIN_TRIPLES:
                    rays = max(rays, float(nominal_rays))
            slope, sharp_variance = _srgb_slope((colors[0] + colors[1] + colors[2]) / 3.0), 0.0
            for y in range(top, min(sums.shape[0], top + TILE)):
                for x in range(left, min(sums.shape[1], left + TILE)):
                    if rays_mask[y, x]:
                        sharp_variance = max(sharp_variance, _sharp_variance(sums, y, x, slope))
                        if cells[y, x, 0, 1] < 1.0 and abs(cells[y, x, 0, 0]) < _MAX_IN_PLACE_RADIUS_PX:
                            rays = max(rays, float(nominal_rays))
            rays = max(rays, math.sqrt(nominal_rays * _EVENNESS * sharp_variance) / noise)
            while counts[row, column] < rays and counts[row, column] < max_rays:
                counts[row, column] *= 2
