"""Very large discs at half the size: what they add up to has no detail that full size would show.

A surface is seen within its radius alone. So where all surfaces within ``LEAST`` pixels of a pixel are
blurred by at least that much, its light varies over many pixels, and a picture of half the size tells it.
That one may be halved again.

Source: Burt and Adelson, "The Laplacian pyramid as a compact image code", 1983, for coarse sampling of what
is smooth; the rule where is ours.
"""

import numpy as np
from numba import prange

from bokehnet.classical.layered.depth_discontinuities import DISCONTINUITY_THRESHOLD
from bokehnet.classical.layered.layers import Layers
from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit

__all__ = ["LARGE", "LEAST", "all_blurred", "halved", "lay_over"]

# Largest radius of a picture, pixels, from which on it is worth while; radius from which on a surface counts
# as blurred.
LARGE, LEAST = 64, 24


@njit(cache=True, parallel=True)
def _halve(image, defocus, colors, depths, coverage, small, values, s_colors, s_depths, s_coverage):  # type: ignore[no-untyped-def]
    """Fill the smaller arrays: the depths of one pixel of four, the light of all of its surface."""
    height, width, layers = depths.shape
    for y in prange(small.shape[0]):
        for x in range(small.shape[1]):
            top, left = 2 * y, 2 * x
            values[y, x] = 0.5 * defocus[top, left]
            for layer in range(layers):
                s_depths[y, x, layer] = 0.5 * depths[top, left, layer]
            for c in range(3):
                light, count = 0.0, 0
                for v in range(top, min(top + 2, height)):
                    for u in range(left, min(left + 2, width)):
                        light += image[v, u, c]
                        count += 1
                small[y, x, c] = light / count
            for layer in range(layers):
                first = depths[top, left, layer]
                count, covered = 0, 0.0
                for c in range(3):
                    s_colors[y, x, layer, c] = 0.0
                for v in range(top, min(top + 2, height)):
                    for u in range(left, min(left + 2, width)):
                        if abs(depths[v, u, layer] - first) <= DISCONTINUITY_THRESHOLD:
                            count += 1
                            covered += coverage[v, u, layer]
                            for c in range(3):
                                s_colors[y, x, layer, c] += colors[v, u, layer, c]
                s_coverage[y, x, layer] = covered / count
                for c in range(3):
                    s_colors[y, x, layer, c] /= count


def halved(image: np.ndarray, defocus: np.ndarray, layers: Layers) -> tuple[np.ndarray, np.ndarray, Layers]:
    """A picture, its defocus and its layers at half the size, blur radii in pixels of that.

    Args:
        image: Scene-linear, (H, W, 3), float32.
        defocus: Pixels, (H, W), float32.
        layers: Of the same pixels.

    Returns:
        The same of (H + 1) // 2 by (W + 1) // 2 pixels.
    """
    height, width, count = layers.defocus.shape
    size = ((height + 1) // 2, (width + 1) // 2)
    shapes = ((*size, 3), size, (*size, count, 3), (*size, count), (*size, count))
    made = [np.empty(shape, np.float32) for shape in shapes]
    with parallel_region:
        _halve(image, defocus, layers.colors, layers.defocus, layers.coverage, *made)
    small, values, colors, depths, coverage = made
    return small, values, Layers(colors=colors, defocus=depths, coverage=coverage)


@njit(cache=True, parallel=True)
def _find_sharp(defocus, least, sharp):  # type: ignore[no-untyped-def]
    """Whether any layer (H, W, L) of a pixel is blurred by less than ``least``, and then along its row."""
    height, width, layers = defocus.shape
    for y in prange(height):
        last = -least - 1
        for x in range(width):
            for layer in range(layers):
                if abs(defocus[y, x, layer]) < least:
                    last = x
            sharp[y, x] = x - last <= least
        last = width + least + 1
        for i in range(width):
            x = width - 1 - i
            for layer in range(layers):
                if abs(defocus[y, x, layer]) < least:
                    last = x
            sharp[y, x] |= last - x <= least


@njit(cache=True, parallel=True)
def _far_from_sharp(sharp, least, blurred):  # type: ignore[no-untyped-def]
    """Whether no pixel up to ``least`` above or below is sharp."""
    height, width = sharp.shape
    for x in prange(width):
        last = -least - 1
        for y in range(height):
            if sharp[y, x]:
                last = y
            blurred[y, x] = y - last > least
        last = height + least + 1
        for i in range(height):
            y = height - 1 - i
            if sharp[y, x]:
                last = y
            blurred[y, x] &= last - y > least


def all_blurred(defocus: np.ndarray) -> np.ndarray:
    """Where all surfaces within ``LEAST`` pixels, to either side, are blurred by that much, (H, W) bool.

    Args:
        defocus: Of all layers, pixels, (H, W, L), float32.
    """
    sharp, blurred = (np.empty(defocus.shape[:2], np.bool_) for _ in range(2))
    with parallel_region:
        _find_sharp(defocus, LEAST, sharp)
        _far_from_sharp(sharp, LEAST, blurred)
    return blurred


@njit(cache=True, parallel=True)
def _lay_over(coarse, wanted, result):  # type: ignore[no-untyped-def]
    height, width = wanted.shape
    for y in prange(height):
        v = min(max(0.5 * y - 0.25, 0.0), coarse.shape[0] - 1.0)
        top = min(int(v), max(coarse.shape[0] - 2, 0))
        bottom, down = min(top + 1, coarse.shape[0] - 1), np.float32(v - top)
        for x in range(width):
            if not wanted[y, x]:
                continue
            u = min(max(0.5 * x - 0.25, 0.0), coarse.shape[1] - 1.0)
            left = min(int(u), max(coarse.shape[1] - 2, 0))
            right, along = min(left + 1, coarse.shape[1] - 1), np.float32(u - left)
            for c in range(result.shape[2]):
                above = coarse[top, left, c] + along * (coarse[top, right, c] - coarse[top, left, c])
                below = coarse[bottom, left, c] + along * (coarse[bottom, right, c] - coarse[bottom, left, c])
                result[y, x, c] = above + down * (below - above)


def lay_over(coarse: np.ndarray, wanted: np.ndarray, result: np.ndarray) -> None:
    """Write a picture of half the size, in straight lines between its pixels, over the pixels ``wanted``.

    Args:
        coarse: ((H + 1) // 2, (W + 1) // 2, C), float32.
        wanted: (H, W) bool.
        result: (H, W, C), float32.
    """
    with parallel_region:
        _lay_over(coarse, wanted, result)
