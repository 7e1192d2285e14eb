"""Merging of the surfaces seen by the samples of a pixel into a few layers with coverage.

A renderer records several surfaces along each ray through a pixel, or deep samples contain them. Sorted by
disparity, they are split into groups, one per layer, at the widest gaps. The coverage of a layer is its
visible light divided by the transmittance of the layers in front of it, so that compositing the layers
reproduces the samples. Surfaces that meet inside a pixel, each on its own part of it, therefore do not show
through each other.
"""

import numpy as np
from numba import prange

from bokehnet.checks import check_whole
from bokehnet.kernels import njit

__all__ = ["merge_surfaces"]

# Weight of the colour of a surface where nearer surfaces occlude it; the weight is 1 where it is visible.
_OCCLUDED_WEIGHT = 1e-3

# Transmittance of nearer layers below which the coverage of a layer is its own alpha alone.
_MIN_TRANSMITTANCE = 1e-3


@njit(cache=True)
def _cut(
    values: np.ndarray, order: np.ndarray, count: int, layers: int, min_gap: float, begins: np.ndarray
) -> None:
    """Mark in ``begins`` the sorted values that start a new layer: those after the widest gaps."""
    gaps = np.zeros(count)
    begins[:count] = False
    for i in range(1, count):
        gaps[i] = values[order[i - 1]] - values[order[i]]
    for _ in range(layers - 1):
        widest = np.argmax(gaps)
        if gaps[widest] <= min_gap:
            break
        begins[widest], gaps[widest] = True, 0.0


@njit(cache=True, parallel=True)
def _merge(
    colors: np.ndarray,
    disparity: np.ndarray,
    coverage: np.ndarray,
    min_gap: float,
    merged: np.ndarray,
    depths: np.ndarray,
    covers: np.ndarray,
) -> None:
    """Merge the surfaces of every pixel into the output arrays; shapes as for :func:`merge_surfaces`."""
    pixels, samples, surfaces = disparity.shape
    layers = depths.shape[1]
    for p in prange(pixels):
        value, place = np.empty(samples * surfaces), np.empty(samples * surfaces, np.int64)
        begins = np.empty(samples * surfaces, np.bool_)
        count = 0
        for i in range(samples * surfaces):
            if coverage[p, i // surfaces, i % surfaces] > 0:
                value[count], place[count] = disparity[p, i // surfaces, i % surfaces], i
                count += 1
        if count == 0:
            continue
        order = np.argsort(-value[:count], kind="mergesort")
        _cut(value, order, count, layers, min_gap, begins)
        clear, through = np.ones(samples), np.ones(samples)
        remaining, layer, weight, own, visible = 1.0, -1, 0.0, 0.0, 0.0
        for i in range(count + 1):
            if i == count or begins[i] or i == 0:
                if i > 0:
                    for c in range(3):
                        merged[p, layer, c] /= weight
                    depths[p, layer] /= weight
                    alone = own / samples
                    shown = visible / samples / remaining if remaining > _MIN_TRANSMITTANCE else alone
                    covers[p, layer] = min(max(shown, alone if remaining <= _MIN_TRANSMITTANCE else 0.0), 1.0)
                    remaining = max(remaining - visible / samples, 0.0)
                    for s in range(samples):
                        clear[s] *= through[s]
                if i == count:
                    break
                layer += 1
                through[:] = 1.0
                weight = own = visible = 0.0
            s, k = place[order[i]] // surfaces, place[order[i]] % surfaces
            alpha = through[s] * coverage[p, s, k]
            through[s] -= alpha
            own += alpha
            visible += clear[s] * alpha
            alpha *= clear[s] + _OCCLUDED_WEIGHT
            weight += alpha
            for c in range(3):
                merged[p, layer, c] += alpha * colors[p, s, k, c]
            depths[p, layer] += alpha * value[order[i]]
        for k in range(layer + 1, layers):
            depths[p, k] = depths[p, layer]


def merge_surfaces(
    colors: np.ndarray, disparity: np.ndarray, coverage: np.ndarray, layers: int, min_gap: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Merge the surfaces seen by the samples of pixels into layers.

    Args:
        colors: Unpremultiplied colour of each surface, (P, S, K, 3): pixels, samples, surfaces per sample.
        disparity: Disparity or any quantity that increases with it, (P, S, K).
        coverage: Alpha of each surface, (P, S, K); 0 for unused entries.
        layers: Maximum number of layers per pixel, at least 1.
        min_gap: Surfaces at most this far apart in disparity share a layer.

    Returns:
        Colours (P, layers, 3), disparity (P, layers), front to back, and coverage (P, layers), float32;
        unused layers have coverage 0. Composited with "over" the layers show the mean of the samples.

    Raises:
        ParameterError: ``layers`` is below 1.

    Examples:
        >>> colors = np.array([[[[1, 0, 0], [0, 0, 1]], [[0, 0, 1], [0, 0, 0]]]], np.float32)
        >>> disparity = np.array([[[0.9, 0.1], [0.1, 0]]], np.float32)
        >>> coverage = np.array([[[1, 1], [1, 0]]], np.float32)
        >>> colors, depths, covers = merge_surfaces(colors, disparity, coverage, 3)
        >>> covers.tolist(), depths.round(2).tolist()
        ([[0.5, 1.0, 0.0]], [[0.8999999761581421, 0.10000000149011612, 0.10000000149011612]])
    """
    check_whole("layers", layers, 1)
    pixels = len(disparity)
    merged = np.zeros((pixels, layers, 3), np.float64)
    depths, covers = np.zeros((pixels, layers)), np.zeros((pixels, layers))
    inputs = (np.ascontiguousarray(x, np.float32) for x in (colors, disparity, coverage))
    _merge(*inputs, float(min_gap), merged, depths, covers)
    return merged.astype(np.float32), depths.astype(np.float32), covers.astype(np.float32)
