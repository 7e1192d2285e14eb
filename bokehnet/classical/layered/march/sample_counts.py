"""How many rays each pixel gets, tile by tile: few where few are enough.

All pixels send ``FIRST_RAYS`` rays. What these bring is handed to a function of the kind ``SampleCounts``,
which tells how many it should be in all. :func:`counts_by_variance` asks for the more the noisier the picture
would be, as the eye sees it, after blurred surfaces are averaged
(:mod:`bokehnet.classical.layered.march.ray_averages`). A given number of rays leaves the least noise in all
where each pixel's number grows with the root of its variance.

Source: Mitchell, "Generating antialiased images at low sampling densities", SIGGRAPH 1987, for more samples
where the first ones differ; Neyman, "On the two different aspects of the representative method", 1934, for
how many.
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

# Rays that every pixel sends: eight go side by side.
FIRST_RAYS = 8

# Root mean square of the noise, in units of the sRGB curve from 0 to 1, that the usual number of rays would
# leave where it is the right one.
_NOISE = 0.0055

# Variance of rays that are spread evenly, over that of random ones.
_EVENNESS = 0.25

# Surfaces less blurred than this are seen where they are, so that their coverage matters there, pixels.
_IN_PLACE = 4.0

# Least number of neighbouring pixels in threes by which the noise of a tile is told.
_LEAST = 8


class FirstPass(NamedTuple):
    """What is known when all pixels have sent their first rays.

    Attributes:
        sums: Means of the first rays, see :mod:`bokehnet.classical.layered.march.ray_accumulators`; whole
            tiles of
            rows, (rows, W, GROUPS, numbers).
        rays_mask: Pixels that send rays, (rows, W) bool.
        cells: Of the same rows, from :func:`bokehnet.classical.layered.march.intersection.layer_cells`.
        usual: Rays of a pixel of middling noise, and the least of one in which an edge in focus lies.
        most: Rays that a pixel can send; a power of two.
    """

    sums: np.ndarray
    rays_mask: np.ndarray
    cells: np.ndarray
    usual: int
    most: int


# Takes what is known, gives the rays that each pixel of a tile sends in all, (rows, columns) int64: powers of
# two from ``FIRST_RAYS`` to ``most``. It must not depend on what lies beyond the tile.
SampleCounts = Callable[[FirstPass], np.ndarray]


def counts_by_variance(known: FirstPass) -> np.ndarray:
    """Rays by the noise of the first ones; see ``SampleCounts``."""
    rows, width = known.rays_mask.shape
    counts = np.empty((-(-rows // TILE), -(-width // TILE)), np.int64)
    _count(known.sums, known.rays_mask, known.cells, known.usual, known.most, _NOISE, counts)
    return counts


@njit(cache=True, forceinline=True)
def _srgb_slope(light):  # type: ignore[no-untyped-def]
    """Derivative of the sRGB curve (IEC 61966-2-1)."""
    return 12.92 if light <= 0.0031308 else 1.055 / 2.4 * light ** (1 / 2.4 - 1.0)


@njit(cache=True)
def _tile_means(sums, rays_mask, top, left, means):  # type: ignore[no-untyped-def]
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
def _blurred_noise(sums, rays_mask, top, left, colors, slopes):  # type: ignore[no-untyped-def]
    """Variance that the first rays leave in the light of blurred surfaces; and from how many it is told.

    Blurred light runs in straight lines over three pixels, so what it does not is noise: of independent
    noise, x[-1] - 2 x[0] + x[1] has the variance 1 + 4 + 1 times.
    """
    own = 1 if sums.shape[3] == COLORED else 0
    total, found = 0.0, 0
    for y in range(top, min(sums.shape[0], top + TILE)):
        for c in range(3):
            i = 3 + own * c
            first, second, known = 0.0, 0.0, 0
            for x in range(left, min(sums.shape[1], left + TILE)):
                weight = 0.0
                for group in range(GROUPS):
                    weight += sums[y, x, group, i]
                if not rays_mask[y, x] or weight <= 0.0:
                    known = 0
                    continue
                value = 0.0
                for group in (FRONT_GROUP, BACK_GROUP):
                    value += sums[y, x, group, c] - colors[c] * sums[y, x, group, i]
                value /= weight
                if known >= 2:
                    bend = slopes[c] * (first - 2.0 * second + value)
                    total += bend * bend / 6.0
                    found += 1
                first, second, known = second, value, known + 1
    return total / max(found, 1), found


@njit(cache=True, forceinline=True)
def _brightness(sums, y, x, group):  # type: ignore[no-untyped-def]
    """Weight of a group at a pixel, mean over the colours, and its light, likewise."""
    last = sums.shape[3] - 2
    weight = 0.0
    for i in range(3, last):
        weight += sums[y, x, group, i]
    return weight / (last - 3), (sums[y, x, group, 0] + sums[y, x, group, 1] + sums[y, x, group, 2]) / 3.0


@njit(cache=True)
def _sharp_variance(sums, y, x, slope):  # type: ignore[no-untyped-def]
    """Variance of one ray, over that share of a pixel's light which no window averages.

    Either a ray brings what a sharp surface shows it, or the mean of the blurred surfaces behind focus.
    """
    sharp, light = _brightness(sums, y, x, SHARP_GROUP)
    if sharp <= 0.0:
        return 0.0
    front, _ = _brightness(sums, y, x, FRONT_GROUP)
    back, light_beyond = _brightness(sums, y, x, BACK_GROUP)
    mean, beyond = light / sharp, 0.0
    if back > 0.0:
        beyond = light_beyond / back
    share = sharp / (sharp + back)
    variance = share * max(sums[y, x, SHARP_GROUP, sums.shape[3] - 2] / sharp - mean * mean, 0.0)
    variance += share * (1.0 - share) * (mean - beyond) * (mean - beyond)
    return slope * slope * variance * (sharp + back) / (sharp + back + front)


@njit(cache=True, parallel=True)
def _count(sums, rays_mask, cells, usual, most, noise, counts):  # type: ignore[no-untyped-def]
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
            wanted = 0.0
            if blurred > 0.0:
                variance, found = _blurred_noise(sums, rays_mask, top, left, colors, slopes)
                side = 2.0 * window_reach(blurred, steepness) + 1.0
                wanted = math.sqrt(usual * FIRST_RAYS * variance) / (noise * side)
                if found < _LEAST:
                    wanted = max(wanted, float(usual))
            slope, alone = _srgb_slope((colors[0] + colors[1] + colors[2]) / 3.0), 0.0
            for y in range(top, min(sums.shape[0], top + TILE)):
                for x in range(left, min(sums.shape[1], left + TILE)):
                    if rays_mask[y, x]:
                        alone = max(alone, _sharp_variance(sums, y, x, slope))
                        if cells[y, x, 0, 1] < 1.0 and abs(cells[y, x, 0, 0]) < _IN_PLACE:
                            wanted = max(wanted, float(usual))
            wanted = max(wanted, math.sqrt(usual * _EVENNESS * alone) / noise)
            while counts[row, column] < wanted and counts[row, column] < most:
                counts[row, column] *= 2
