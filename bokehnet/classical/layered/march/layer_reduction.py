"""Layers at half their size, for rays at the scale of the blur.

A block of 2x2 pixels becomes one pixel. Its first layer is the nearest surface of the block, with the
fraction of the block that it covers; its second layer is what the rest of the block shows, and what the
nearest surface occludes.
"""

import numpy as np
from numba import prange

from bokehnet.classical.known_layers import Layers
from bokehnet.classical.layered.depth_discontinuities import DISCONTINUITY_THRESHOLD
from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit

__all__ = ["half_layers"]

# Weight of an occluded surface in the second layer, relative to one that is seen over the whole pixel.
_OCCLUDED_WEIGHT = 0.25

# Difference of defocus below which two layers of a pixel are one surface, pixels.
_SAME_DEPTH_PX = np.float32(0.01)


def half_layers(layers: Layers) -> Layers:
    """Return layers at half their size, with half their defocus.

    Args:
        layers: Layers of a picture, (H, W, L, ...). Only the first layer may be translucent.

    Returns:
        Layers of the same number, (H / 2, W / 2, L, ...), rounded up; odd sides repeat their last pixel.
    """
    height, width, count = layers.defocus.shape
    shape = (-(-height // 2), -(-width // 2), count)
    colors, depths = np.empty((*shape, 3), np.float32), np.empty(shape, np.float32)
    coverage = np.empty(shape, np.float32)
    with parallel_region:
        _reduce(
            *(layers.colors, layers.defocus, layers.coverage),
            *(DISCONTINUITY_THRESHOLD, _OCCLUDED_WEIGHT, colors, depths, coverage),
        )
    return Layers(colors=colors, defocus=depths, coverage=coverage)


@njit(cache=True, forceinline=True)
def _add(means, layer, weight, colors, depth):  # type: ignore[no-untyped-def]
    """Add a surface to the sums (L, 5) of a layer: weight, weighted defocus and color."""
    means[layer, 0] += weight
    means[layer, 1] += weight * depth
    for c in range(3):
        means[layer, 2 + c] += weight * colors[c]


@njit(cache=True, parallel=True)
def _reduce(colors, depths, coverage, threshold, occluded_weight, out_colors, out_depths, out_coverage):  # type: ignore[no-untyped-def]
    """Write the layers (H / 2, W / 2, L, ...) of the blocks of 2x2 pixels of (H, W, L, ...)."""
    height, width, layers = depths.shape
    for row in prange(out_depths.shape[0]):
        means = np.empty((layers, 5))
        for column in range(out_depths.shape[1]):
            means[:] = 0.0
            nearest, second = -np.inf, -np.inf
            for i in range(4):
                y, x = min(2 * row + i // 2, height - 1), min(2 * column + i % 2, width - 1)
                if coverage[y, x, 0] > 0.0:
                    nearest = max(nearest, depths[y, x, 0])
            for i in range(4):
                y, x = min(2 * row + i // 2, height - 1), min(2 * column + i % 2, width - 1)
                if depths[y, x, 0] < nearest - threshold:
                    second = max(second, depths[y, x, 0])
                elif layers > 1:
                    second = max(second, depths[y, x, 1])
            for i in range(4):
                y, x = min(2 * row + i // 2, height - 1), min(2 * column + i % 2, width - 1)
                covered = coverage[y, x, 0]
                if depths[y, x, 0] >= nearest - threshold:
                    _add(means, 0, covered, colors[y, x, 0], depths[y, x, 0])
                    seen = 1.0 - covered + occluded_weight * covered
                    first = 1
                else:
                    layer = min(1 if depths[y, x, 0] >= second - threshold else 2, layers - 1)
                    _add(means, layer, covered, colors[y, x, 0], depths[y, x, 0])
                    seen = 1.0 - covered + occluded_weight * covered
                    first = 1
                for behind in range(first, layers):
                    layer = behind
                    if behind == 1 and depths[y, x, 1] < second - threshold:
                        layer = min(2, layers - 1)
                    _add(means, layer, seen, colors[y, x, behind], depths[y, x, behind])
                    seen *= occluded_weight
            for layer in range(layers):
                weight = means[layer, 0]
                if weight > 0.0:
                    out_depths[row, column, layer] = 0.5 * means[layer, 1] / weight
                    for c in range(3):
                        out_colors[row, column, layer, c] = means[layer, 2 + c] / weight
                else:
                    before = max(layer - 1, 0)
                    out_depths[row, column, layer] = out_depths[row, column, before] if layer else 0.5 * depths[2 * row, 2 * column, 0]
                    for c in range(3):
                        out_colors[row, column, layer, c] = out_colors[row, column, before, c] if layer else colors[2 * row, 2 * column, 0, c]
                out_coverage[row, column, layer] = 1.0
                if layer > 0:
                    front = out_depths[row, column, layer - 1]
                    if out_depths[row, column, layer] > front - _SAME_DEPTH_PX:
                        out_depths[row, column, layer] = front
            out_coverage[row, column, 0] = min(0.25 * means[0, 0], 1.0)
