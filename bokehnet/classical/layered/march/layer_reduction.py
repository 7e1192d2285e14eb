"""Layers at half their size, for rays at the scale of the blur.

A block of 2x2 pixels becomes one pixel. Its first layer is the nearest surface of the block, with the
fraction of the block that it covers; its second layer is what the rest of the block shows, and what the
nearest surface occludes. Where a layer joins surfaces on both sides of focus, it has the defocus of those
with the larger weight. One pixel on each side continues the border of the picture, as rays that leave the
picture do: otherwise they would read the mean of a block at the border instead of the border itself.
"""

import numpy as np
from numba import prange

from bokehnet.classical.known_layers import Layers
from bokehnet.classical.layered.depth_discontinuities import DISCONTINUITY_THRESHOLD
from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit

__all__ = ["half_layers", "half_shape"]

# Weight of an occluded surface in the second layer, relative to one that is seen over the whole pixel.
_OCCLUDED_WEIGHT = 0.1

# Defocus span of the pixels of a block that count as one surface, pixels. Slopes of up to a discontinuity per
# pixel must remain whole along the diagonal of a block, and along its continuation in the next one.
_SURFACE_SPAN_PX = 3.0 * DISCONTINUITY_THRESHOLD


def half_shape(height: int, width: int) -> tuple[int, int]:
    """Return the height and width of the layers at half their size, pixels."""
    return -(-height // 2) + 2, -(-width // 2) + 2


def half_layers(layers: Layers) -> Layers:
    """Return layers at half their size, with half their defocus.

    Args:
        layers: Layers of a picture, (H, W, L, ...). Only the first layer may be translucent.

    Returns:
        Layers of the same number, of the size :func:`half_shape`. The pixel (y, x) covers the rows from
        2 y - 2 and the columns from 2 x - 2 on; beyond the border the last pixel is repeated.
    """
    height, width, count = layers.defocus.shape
    shape = (*half_shape(height, width), count)
    colors, depths = np.empty((*shape, 3), np.float32), np.empty(shape, np.float32)
    coverage = np.ones(shape, np.float32)
    with parallel_region:
        _reduce(
            *(layers.colors, layers.defocus, layers.coverage),
            *(_SURFACE_SPAN_PX, _OCCLUDED_WEIGHT, colors, depths, coverage),
        )
    return Layers(colors=colors, defocus=depths, coverage=coverage)


@njit(cache=True, forceinline=True)
def _add(sums, layer, weight, color, depth):
    """Add a surface to the sums (L, 7) of a layer.

    These are weight and weighted defocus of surfaces behind focus, the same in front of it, and weighted
    color.
    """
    side = 2 if depth > 0.0 else 0
    sums[layer, side] += weight
    sums[layer, side + 1] += weight * depth
    for c in range(3):
        sums[layer, 4 + c] += weight * color[c]


@njit(cache=True, parallel=True)
def _reduce(colors, depths, coverage, threshold, occluded_weight, half_colors, half_depths, half_coverage):
    """Write the layers of the blocks of 2x2 pixels of (H, W, L, ...), see :func:`half_layers`."""
    height, width, layers = depths.shape
    for row in prange(half_depths.shape[0]):
        sums, rows, columns = np.empty((layers, 7)), np.empty(4, np.int64), np.empty(4, np.int64)
        for column in range(half_depths.shape[1]):
            sums[:] = 0.0
            nearest, second = -np.inf, -np.inf
            for i in range(4):
                y = min(max(2 * row - 2 + i // 2, 0), height - 1)
                x = min(max(2 * column - 2 + i % 2, 0), width - 1)
                rows[i], columns[i] = y, x
                if coverage[y, x, 0] > 0.0:
                    nearest = max(nearest, depths[y, x, 0])
            for i in range(4):
                y, x = rows[i], columns[i]
                if depths[y, x, 0] < nearest - threshold:
                    second = max(second, depths[y, x, 0])
                elif layers > 1:
                    second = max(second, depths[y, x, 1])
            for i in range(4):
                y, x = rows[i], columns[i]
                covered, layer = coverage[y, x, 0], 0
                if depths[y, x, 0] < nearest - threshold:
                    layer = min(1 if depths[y, x, 0] >= second - threshold else 2, layers - 1)
                _add(sums, layer, covered, colors[y, x, 0], depths[y, x, 0])
                seen = 1.0 - covered + occluded_weight * covered
                for behind in range(1, layers):
                    layer = behind
                    if behind == 1 and depths[y, x, 1] < second - threshold:
                        layer = min(2, layers - 1)
                    _add(sums, layer, seen, colors[y, x, behind], depths[y, x, behind])
                    seen *= occluded_weight
            y, x = rows[0], columns[0]
            for layer in range(layers):
                weight = sums[layer, 0] + sums[layer, 2]
                if weight > 0.0:
                    # The mean of surfaces on both sides of focus would be a sharp one.
                    side = 2 if sums[layer, 2] > sums[layer, 0] else 0
                    half_depths[row, column, layer] = 0.5 * sums[layer, side + 1] / sums[layer, side]
                    for c in range(3):
                        half_colors[row, column, layer, c] = sums[layer, 4 + c] / weight
                elif layer > 0:
                    half_depths[row, column, layer] = half_depths[row, column, layer - 1]
                    half_colors[row, column, layer] = half_colors[row, column, layer - 1]
                else:
                    half_depths[row, column, 0] = 0.5 * depths[y, x, 0]
                    half_colors[row, column, 0] = colors[y, x, 0]
                if layer > 0:
                    front = half_depths[row, column, layer - 1]
                    half_depths[row, column, layer] = min(half_depths[row, column, layer], front)
            half_coverage[row, column, 0] = min(0.25 * (sums[0, 0] + sums[0, 2]), 1.0)
