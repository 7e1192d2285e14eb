"""March at the scale of the blur: where everything is blurred, rays march through smaller layers.

A surface that is blurred by r pixels shows no detail much finer than r. Each halving of the size divides the
number of pixels by four and the length of their rays by two. A pixel uses the level at which the smallest
blur radius of all surfaces that can send light to it is at least ``MIN_RADIUS_PX`` pixels of that level; the
full size remains near what is in focus. A surface sends light no farther than its own blur radius, so a level
is used everywhere except within its limit of a surface that is blurred less. Behind an aberrated lens, whose
discs differ from those of a perfect one, the limits are those of the pixel's own field position.

Near the border between two levels both are marched, and blended linearly over a block of pixels. The choice
depends on the surroundings of a pixel alone: strips of rows are rendered as in the whole picture.

Source: Burt and Adelson, "The Laplacian pyramid as a compact image code", 1983, for the pyramid; the choice
of the level is ours.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numba import prange

from bokehnet.arrays.square_windows import dilated
from bokehnet.arrays.viewport import Viewport
from bokehnet.classical.known_layers import Layers
from bokehnet.classical.layered.march.aberrated_rays import LensTable
from bokehnet.classical.layered.march.bundle_extents import SharpLimits
from bokehnet.classical.layered.march.defocus_bins import occupied_bins
from bokehnet.classical.layered.march.intersection import layer_cells
from bokehnet.classical.layered.march.layer_reduction import half_layers, half_shape
from bokehnet.classical.layered.march.ray_averages import window_halo
from bokehnet.classical.layered.march.ray_marching import RaysJob, march
from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit

__all__ = [
    "BLOCK_PX",
    "MAX_LEVELS",
    "MIN_RADIUS_PX",
    "LayerLevels",
    "LensAt",
    "SharpLimitsAt",
    "layers_halo",
    "levels_halo",
    "make_levels",
    "march_levels",
]

# Smallest blur radius of any surface in reach, in pixels of a level, for which the level is used. A disc of
# radius r passes at most 2 J1(pi r) / (pi r) <= 1.6 / (pi r)^1.5 of the detail at the pixel frequency of the
# level: 0.0195 at 6 pixels, so that detail of an amplitude of 0.2, which the level lacks, changes 1/255.
MIN_RADIUS_PX = 6.0

# Maximum number of halvings. A third one would merge surfaces whose defocus differs by up to 12 pixels.
MAX_LEVELS = 2

# Side of the square blocks of pixels that share a level, pixels of the full size.
BLOCK_PX = 16

# Rays per pixel of a smaller size over those of the next larger one, through an aberrated lens. It has fewer
# rays than a perfect one, and their noise would exceed 1/255 (47.6 dB with a factor of 1, 49.1 with 2).
_LENS_RAYS_FACTOR = 2

# Function of the number of blocks, (rows, columns), and of a limit of the blur radius, pixels: returns which
# surfaces the blocks may see blurred by less, and how far away.
SharpLimitsAt = Callable[[tuple[int, int], float], SharpLimits]

# Function of the position of a smaller picture, its rows above the arrays, and their height and width:
# returns the lens of that size, and its extents as arguments of ``occupied_bins``.
LensAt = Callable[[Viewport, int, tuple[int, int]], tuple[LensTable, tuple[Any, ...]]]


def levels_halo(radius: float) -> int:
    """Return the rows of rays around others that their pixels depend on, for discs of at most ``radius``."""
    halo = window_halo(radius)
    for level in range(1, _levels(radius) + 1):  # a window, and the neighbours for doubling
        halo = max(halo, 2**level * (window_halo(radius / 2**level) + 4))
    return halo


def layers_halo(radius: float) -> int:
    """Return the pixels of layers around others, beyond the reach of rays, that they depend on.

    Behind an aberrated lens the choice of a level looks as far as rays and two blocks: of pixels around the
    others, over which these are averaged, it may be another one, with results that differ by less than 1/255.
    """
    levels = _levels(radius)
    if not levels:
        return levels_halo(radius)
    choice = _reach_blocks(MIN_RADIUS_PX * 2**levels) * BLOCK_PX
    return max(levels_halo(radius) + max(0, math.ceil(choice - radius)), 2 * BLOCK_PX)


def _levels(radius: float) -> int:
    """Return the number of levels that discs of at most this radius can use."""
    levels = 0
    while levels < MAX_LEVELS and radius >= MIN_RADIUS_PX * 2 ** (levels + 1):
        levels += 1
    return levels


def _reach_blocks(reach: float) -> int:
    """Return the blocks within reach, pixels, of a block, and one more for interpolation."""
    return math.ceil(reach / BLOCK_PX) + 1


@njit(cache=True, parallel=True)
def _smallest_radii(cells, block, smallest):
    """Write the smallest blur radius of any layer in each block to ``smallest``, (rows, columns)."""
    height, width, layers = cells.shape[:3]
    for row in prange(smallest.shape[0]):
        for column in range(smallest.shape[1]):
            radius = np.float32(np.inf)
            for y in range(row * block, min(height, (row + 1) * block)):
                for x in range(column * block, min(width, (column + 1) * block)):
                    for layer in range(layers):
                        radius = min(radius, abs(cells[y, x, layer, 0]))
            smallest[row, column] = radius


def _sharp_limits(shape: tuple[int, int], limit: float) -> SharpLimits:
    """Return :data:`SharpLimitsAt` of a perfect lens."""
    return SharpLimits(rings=np.zeros(shape, np.intp), radii=np.array([limit]), reaches=np.array([limit]))


def _sees_sharp(smallest: np.ndarray, limits: SharpLimits) -> np.ndarray:
    """Return the blocks that a surface blurred by less than the limits may send light to, (rows, columns)."""
    mask = np.zeros(smallest.shape, np.bool_)
    for ring in np.unique(limits.rings):
        within = dilated(smallest < limits.radii[ring], _reach_blocks(limits.reaches[ring]))
        mask |= within & (limits.rings == ring)
    return mask


def _level_blocks(cells: np.ndarray, limits_at: SharpLimitsAt) -> list[np.ndarray]:
    """Return the weight of each level over the previous one in each block, (rows, columns) float32."""
    height, width = cells.shape[:2]
    smallest = np.empty((-(-height // BLOCK_PX), -(-width // BLOCK_PX)), np.float32)
    with parallel_region:
        _smallest_radii(cells, BLOCK_PX, smallest)
    weights: list[np.ndarray] = []
    for level in range(1, MAX_LEVELS + 1):
        sees_sharp = _sees_sharp(smallest, limits_at(smallest.shape, MIN_RADIUS_PX * 2**level))
        if sees_sharp.all():
            break
        weights.append((~sees_sharp).astype(np.float32))
    return weights


@njit(cache=True, forceinline=True)
def _neighbors(position, size):
    """Return lower and upper index and the weight of the upper one, for linear interpolation."""
    low = int(np.floor(position))
    return min(max(low, 0), size - 1), min(max(low + 1, 0), size - 1), np.float32(position - low)


@njit(cache=True, forceinline=True)
def _weight_at(blocks, y, x, grid):
    """Return the weight of the next level at a pixel, interpolated between the blocks.

    ``grid``: blocks per pixel, and position of the pixel 0, in blocks from the centre of the first block.
    """
    top, bottom, down = _neighbors(y * grid[0] + grid[1], blocks.shape[0])
    left, right, across = _neighbors(x * grid[0] + grid[1], blocks.shape[1])
    upper = blocks[top, left] + across * (blocks[top, right] - blocks[top, left])
    lower = blocks[bottom, left] + across * (blocks[bottom, right] - blocks[bottom, left])
    return upper + down * (lower - upper)


@njit(cache=True, parallel=True)
def _divide(mask, blocks, grid, own, other):
    """Divide the pixels of a mask: ``own`` need this level, ``other`` the next one; both in a transition."""
    for y in prange(mask.shape[0]):
        for x in range(mask.shape[1]):
            own[y, x], other[y, x] = False, False
            if mask[y, x]:
                weight = _weight_at(blocks, y, x, grid)
                own[y, x], other[y, x] = weight < 1.0, weight > 0.0


@njit(cache=True, parallel=True)
def _halve(mask, colors, half_mask, half_colors):
    """Mark the pixels of half the size that doubling reads for a mask; write the mean colors of blocks."""
    height, width = mask.shape
    for row in prange(half_mask.shape[0]):
        for column in range(half_mask.shape[1]):
            half_mask[row, column] = False
            for v in range(max(2 * row - 4, 0), min(2 * row + 2, height)):
                for u in range(max(2 * column - 4, 0), min(2 * column + 2, width)):
                    half_mask[row, column] = half_mask[row, column] or mask[v, u]
            if not half_mask[row, column]:
                continue
            half_colors[row, column] = 0.0
            for i in range(4):
                y = min(max(2 * row - 2 + i // 2, 0), height - 1)
                x = min(max(2 * column - 2 + i % 2, 0), width - 1)
                for c in range(3):
                    half_colors[row, column, c] += np.float32(0.25) * colors[y, x, c]


@njit(cache=True, parallel=True)
def _join(blocks, grid, mask, half, half_weight, result, disocclusion_weight):
    """Blend the next level, doubled, into ``result`` and ``disocclusion_weight`` within a mask.

    Doubling has the weights 1/8, 1, -1/8 along both axes: the mean of the halves of a pixel is the pixel, and
    parabolas are exact.
    """
    for y in prange(mask.shape[0]):
        top, down = y // 2, np.float32(0.125 if y % 2 == 0 else -0.125)
        for x in range(mask.shape[1]):
            if not mask[y, x]:
                continue
            weight = np.float32(_weight_at(blocks, y, x, grid))
            left, across = x // 2, np.float32(0.125 if x % 2 == 0 else -0.125)
            for c in range(3):
                above = half[top, left + 1, c] + across * (half[top, left, c] - half[top, left + 2, c])
                below = half[top + 2, left + 1, c] + across * (
                    half[top + 2, left, c] - half[top + 2, left + 2, c]
                )
                light = half[top + 1, left + 1, c] + across * (
                    half[top + 1, left, c] - half[top + 1, left + 2, c]
                )
                light = max(light + down * (above - below), np.float32(0))
                result[y, x, c] += weight * (light - result[y, x, c])
            disocclusion_weight[y, x] += weight * (half_weight[top + 1, left + 1] - disocclusion_weight[y, x])


@dataclass(frozen=True, slots=True, kw_only=True)
class LayerLevels:
    """Layers of half the size, a quarter and so on, as many as a picture can use.

    Attributes:
        weights: Weight of each level over the previous one in each block, (rows, columns) float32.
        layers: Layers of each level.
    """

    weights: list[np.ndarray]
    layers: list[Layers]


def make_levels(layers: Layers, cells: np.ndarray, limits_at: SharpLimitsAt | None = None) -> LayerLevels:
    """Return the smaller layers in which rays march where everything is blurred.

    Args:
        layers: Layers of the full size. Only the first may be translucent.
        cells: Their cells, see :func:`bokehnet.classical.layered.march.intersection.layer_cells`.
        limits_at: See :data:`SharpLimitsAt`; default: that of a perfect lens.
    """
    weights, smaller = _level_blocks(cells, limits_at or _sharp_limits), []
    for _ in weights:
        layers = half_layers(layers)
        smaller.append(layers)
    return LayerLevels(weights=weights, layers=smaller)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Level:
    """Rays at one size of the picture.

    Attributes:
        job: Rays of this size.
        smaller: Smaller layers, and their weights.
        grid: See :func:`_weight_at`.
        lens_at: See :data:`LensAt`; None for a perfect lens.
    """

    job: RaysJob
    smaller: LayerLevels
    grid: tuple[float, float]
    lens_at: LensAt | None

    def next(self, mask: np.ndarray) -> "_Level":
        """Return the level of half the size, with ``mask`` (h, w) as the pixels to render."""
        layers = self.smaller.layers.pop(0)  # freed after its march
        cells = layer_cells(layers)
        viewport = self.job.viewport or Viewport.whole(*self.job.rays_mask.shape)
        viewport = Viewport(
            left=viewport.left // 2 - 1,
            top=viewport.top // 2 - 1,
            width=-(-viewport.width // 2),
            height=-(-viewport.height // 2),
        )
        above = self.job.above // 2
        lens, within, rays = None, (), self.job.nominal_rays
        if self.lens_at is not None:
            lens, within = self.lens_at(viewport, above, mask.shape)
            rays = min(_LENS_RAYS_FACTOR * rays, self.job.points.shape[2])
        job = replace(
            self.job,
            colors=layers.colors,
            cells=cells,
            rays_mask=mask,
            bins=occupied_bins(cells, *within),
            radius=0.5 * self.job.radius,
            nominal_rays=rays,
            lens=lens,
            above=above,
            viewport=viewport,
        )
        per_pixel, first = self.grid
        grid = (2 * per_pixel, first - 1.5 * per_pixel)  # the centre of (y, x) is at 2 y - 1.5
        smaller = LayerLevels(weights=self.smaller.weights[1:], layers=self.smaller.layers)
        return _Level(job=job, smaller=smaller, grid=grid, lens_at=self.lens_at)


def march_levels(
    job: RaysJob,
    smaller: LayerLevels,
    result: np.ndarray,
    disocclusion_weight: np.ndarray,
    progress: Callable[[float], None] | None = None,
    lens_at: LensAt | None = None,
) -> None:
    """March rays at the size that the blur needs; results as of ``march``.

    Args:
        job: Layers, rays and lens.
        smaller: From :func:`make_levels`, of the same layers; its own are removed as soon as they were used.
        result: See :func:`bokehnet.classical.layered.march.ray_marching.march`.
        disocclusion_weight: See there.
        progress: See there.
        lens_at: See :data:`LensAt`; needed for an aberrated lens.
    """
    grid = (1 / BLOCK_PX, 0.5 / BLOCK_PX - 0.5)
    level = _Level(job=job, smaller=smaller, grid=grid, lens_at=lens_at)
    _march_level(level, result, disocclusion_weight, progress)


def _march_level(
    level: _Level,
    result: np.ndarray,
    disocclusion_weight: np.ndarray,
    progress: Callable[[float], None] | None = None,
) -> None:
    """March the rays of a level, and of the smaller ones where those suffice."""
    mask = level.job.rays_mask
    if not level.smaller.weights:
        march(level.job, result, disocclusion_weight, progress=progress)
        return
    own, other = np.empty_like(mask), np.empty_like(mask)
    half_mask = np.empty(half_shape(*mask.shape), np.bool_)
    half_colors = np.zeros((*half_mask.shape, 3), np.float32)
    half_weight = np.zeros(half_mask.shape, np.float32)
    with parallel_region:
        _divide(mask, level.smaller.weights[0], level.grid, own, other)
        _halve(other, result, half_mask, half_colors)
    has_other = bool(half_mask.any())
    if has_other:
        _march_level(level.next(half_mask), half_colors, half_weight)
    march(replace(level.job, rays_mask=own), result, disocclusion_weight, progress=progress)
    if has_other:
        with parallel_region:
            _join(
                level.smaller.weights[0],
                level.grid,
                other,
                half_colors,
                half_weight,
                result,
                disocclusion_weight,
            )
