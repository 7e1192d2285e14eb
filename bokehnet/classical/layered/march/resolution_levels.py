"""March at the scale of the blur: where everything is blurred, rays march through smaller layers.

A surface that is blurred by r pixels shows no detail much finer than r. Each halving of the size divides the
number of pixels by four and the length of their rays by two. A pixel uses the level at which the smallest
blur radius of all surfaces that can send light to it is at least ``MIN_RADIUS_PX`` pixels of that level; the
full size remains near what is in focus.

A surface sends light no farther than its own blur radius. Pixels within the radius of a surface with a
defocus below the limit of a level therefore use a larger size.

Source: Burt and Adelson, "The Laplacian pyramid as a compact image code", 1983, for the pyramid; the choice
of the level is ours.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from numba import prange
from scipy import ndimage

from bokehnet.arrays.halving import half_mask
from bokehnet.arrays.pyramid import crop_to, upsample2
from bokehnet.arrays.viewport import Viewport
from bokehnet.classical.known_layers import Layers
from bokehnet.classical.layered.march.defocus_bins import occupied_bins
from bokehnet.classical.layered.march.intersection import layer_cells
from bokehnet.classical.layered.march.layer_reduction import half_layers
from bokehnet.classical.layered.march.ray_marching import RaysJob, march
from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit

__all__ = ["MAX_LEVELS", "MIN_RADIUS_PX", "march_levels"]

# Smallest blur radius of any surface in reach, in pixels of a level, for which the level is used.
MIN_RADIUS_PX = 8.0

# Maximum number of halvings.
MAX_LEVELS = 3

# Side of the square blocks of pixels that share a level, pixels of the full size.
_BLOCK_PX = 16


@njit(cache=True, parallel=True)
def _smallest_radii(cells, block, smallest):  # type: ignore[no-untyped-def]
    """Write the smallest blur radius of any layer in each block of pixels to ``smallest``, (rows, columns)."""
    height, width, layers = cells.shape[:3]
    for row in prange(smallest.shape[0]):
        for column in range(smallest.shape[1]):
            radius = np.float32(np.inf)
            for y in range(row * block, min(height, (row + 1) * block)):
                for x in range(column * block, min(width, (column + 1) * block)):
                    for layer in range(layers):
                        radius = min(radius, abs(cells[y, x, layer, 0]))
            smallest[row, column] = radius


def _coarse_blocks(smallest: np.ndarray, level: int) -> np.ndarray:
    """Return the blocks that no surface reaches whose blur is too small for a level, (rows, columns) bool."""
    limit = MIN_RADIUS_PX * 2**level
    reach = int(np.ceil(limit / _BLOCK_PX)) + 1
    sharp = smallest < limit
    return ~ndimage.maximum_filter(sharp, 2 * reach + 1, mode="constant")


@njit(cache=True, forceinline=True)
def _interpolation(position, size):  # type: ignore[no-untyped-def]
    """Return lower and upper index and the weight of the upper one, for linear interpolation at a position."""
    low = int(np.floor(position))
    return min(max(low, 0), size - 1), min(max(low + 1, 0), size - 1), np.float32(position - low)


@njit(cache=True, forceinline=True)
def _weight_at(blocks, y, x, block):  # type: ignore[no-untyped-def]
    """Return the weight at a pixel, interpolated between blocks of ``block`` pixels a side."""
    top, bottom, down = _interpolation((y + 0.5) / block - 0.5, blocks.shape[0])
    left, right, across = _interpolation((x + 0.5) / block - 0.5, blocks.shape[1])
    upper = blocks[top, left] + across * (blocks[top, right] - blocks[top, left])
    lower = blocks[bottom, left] + across * (blocks[bottom, right] - blocks[bottom, left])
    return upper + down * (lower - upper)


@njit(cache=True, parallel=True)
def _divide(mask, blocks, block, own, other):  # type: ignore[no-untyped-def]
    """Divide the pixels of a mask: ``own`` need this level, ``other`` the next one; both in a transition."""
    for y in prange(mask.shape[0]):
        for x in range(mask.shape[1]):
            weight = _weight_at(blocks, y, x, block)
            own[y, x] = mask[y, x] and weight < 1.0
            other[y, x] = mask[y, x] and weight > 0.0


@njit(cache=True, parallel=True)
def _join(blocks, block, mask, coarse, coarse_weight, result, disocclusion_weight):  # type: ignore[no-untyped-def]
    """Blend the next level, enlarged linearly, into ``result`` and ``disocclusion_weight`` within a mask."""
    height, width = coarse.shape[:2]
    for y in prange(mask.shape[0]):
        top, bottom, down = _interpolation(0.5 * y - 0.25, height)
        for x in range(mask.shape[1]):
            if not mask[y, x]:
                continue
            weight = _weight_at(blocks, y, x, block)
            left, right, across = _interpolation(0.5 * x - 0.25, width)
            for c in range(4):
                if c < 3:
                    upper = coarse[top, left, c] + across * (coarse[top, right, c] - coarse[top, left, c])
                    lower = coarse[bottom, left, c] + across * (
                        coarse[bottom, right, c] - coarse[bottom, left, c]
                    )
                    result[y, x, c] += weight * (upper + down * (lower - upper) - result[y, x, c])
                else:
                    upper = coarse_weight[top, left] + across * (
                        coarse_weight[top, right] - coarse_weight[top, left]
                    )
                    lower = coarse_weight[bottom, left] + across * (
                        coarse_weight[bottom, right] - coarse_weight[bottom, left]
                    )
                    disocclusion_weight[y, x] += weight * (
                        upper + down * (lower - upper) - disocclusion_weight[y, x]
                    )


def _half_viewport(viewport: Viewport | None) -> Viewport | None:
    """Return the position of an array at half its size in the displayed picture at half its size."""
    if viewport is None:
        return None
    return Viewport(
        left=viewport.left // 2,
        top=viewport.top // 2,
        width=-(-viewport.width // 2),
        height=-(-viewport.height // 2),
    )


def march_levels(
    job: RaysJob,
    layers: Layers,
    result: np.ndarray,
    disocclusion_weight: np.ndarray,
    *,
    progress: Callable[[float], None] | None = None,
    send: Callable[..., None] | None = None,
) -> None:
    """March rays at the size that the blur needs; arguments and results as for ``march``.

    Args:
        job: Layers, rays and a perfect lens.
        layers: Layers of ``job.cells``.
        result: See :func:`bokehnet.classical.layered.march.ray_marching.march`.
        disocclusion_weight: See there.
        progress: See there.
        send: See there.
    """
    blocks = []
    smallest = np.empty(tuple(-(-side // _BLOCK_PX) for side in job.rays_mask.shape), np.float32)
    with parallel_region:
        _smallest_radii(job.cells, _BLOCK_PX, smallest)
    for level in range(1, MAX_LEVELS + 1):
        coarse = _coarse_blocks(smallest, level)
        if not coarse.any():
            break
        blocks.append(ndimage.minimum_filter(coarse, 3, mode="nearest").astype(np.float32))
    _march_level(job, layers, blocks, 0, result, disocclusion_weight, progress, send)


def _march_level(job, layers, blocks, level, result, disocclusion_weight, progress, send):
    if level == len(blocks):
        march(job, result, disocclusion_weight, progress=progress, send=send)
        return
    block = _BLOCK_PX >> level
    own, other = np.empty_like(job.rays_mask), np.empty_like(job.rays_mask)
    with parallel_region:
        _divide(job.rays_mask, blocks[level], block, own, other)
    if other.any():
        half = half_layers(layers)
        cells = layer_cells(half)
        small_mask = ndimage.binary_dilation(half_mask(other), np.ones((3, 3), np.bool_))
        small = replace(job if job.levels is None else replace(job, levels=None),

            colors=half.colors,
            cells=cells,
            rays_mask=small_mask,
            bins=occupied_bins(cells),
            radius=job.radius / 2,
            above=job.above // 2,
            viewport=_half_viewport(job.viewport),
        )
        small_result = np.ascontiguousarray(_half_picture(result))
        small_weight = np.zeros(small_mask.shape, np.float32)
        _march_level(small, half, blocks, level + 1, small_result, small_weight, None, send)
    if own.any():
        march(replace(job, rays_mask=own), result, disocclusion_weight, progress=progress, send=send)
    if other.any():
        with parallel_region:
            _join(blocks[level], block, other, small_result, small_weight, result, disocclusion_weight)


def _half_picture(picture):
    from bokehnet.arrays.halving import half_image
    return half_image(picture.transpose(2, 0, 1)).transpose(1, 2, 0)
