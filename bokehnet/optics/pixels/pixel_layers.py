"""Surfaces of a pixel's samples, merged to few layers with coverage.

A renderer finds surfaces along rays through a pixel, several on each, or deep samples tell them. Sorted by
disparity they fall into groups, one for each layer, at the widest gaps. A layer covers as much of its pixel
as lets the layers over one another show what the rays saw: its light over what those before it let through.
So surfaces that meet inside a pixel, each on its own part of it, do not shine through each other.
"""

import numpy as np
from numba import prange

from bokehnet.checks import check_whole
from bokehnet.kernels import njit

__all__ = ["merge_surfaces"]

# Weight of a surface's colour where nearer ones hide it, beside where it is seen.
_HIDDEN = 1e-3

# Coverage left by nearer layers, below which nothing tells that of a layer behind but its own outline.
_CLEAR = 1e-3


@njit(cache=True)
def _cut(values, order, count, layers, least, begins):  # type: ignore[no-untyped-def]
    """Mark in ``begins`` where sorted values start a new layer: at their widest gaps."""
    gaps = np.zeros(count)
    begins[:count] = False
    for i in range(1, count):
        gaps[i] = values[order[i - 1]] - values[order[i]]
    for _ in range(layers - 1):
        widest = np.argmax(gaps)
        if gaps[widest] <= least:
            break
        begins[widest], gaps[widest] = True, 0.0


@njit(cache=True, parallel=True)
def _merge(colors, disparity, coverage, least, merged, depths, covers):  # type: ignore[no-untyped-def]
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
        _cut(value, order, count, layers, least, begins)
        clear, through = np.ones(samples), np.ones(samples)
        left, layer, weight, own, seen = 1.0, -1, 0.0, 0.0, 0.0
        for i in range(count + 1):
            if i == count or begins[i] or i == 0:
                if i > 0:
                    for c in range(3):
                        merged[p, layer, c] /= weight
                    depths[p, layer] /= weight
                    alone = own / samples
                    shown = seen / samples / left if left > _CLEAR else alone
                    covers[p, layer] = min(max(shown, alone if left <= _CLEAR else 0.0), 1.0)
                    left = max(left - seen / samples, 0.0)
                    for s in range(samples):
                        clear[s] *= through[s]
                if i == count:
                    break
                layer += 1
                through[:] = 1.0
                weight = own = seen = 0.0
            s, k = place[order[i]] // surfaces, place[order[i]] % surfaces
            alpha = through[s] * coverage[p, s, k]
            through[s] -= alpha
            own += alpha
            seen += clear[s] * alpha
            alpha *= clear[s] + _HIDDEN
            weight += alpha
            for c in range(3):
                merged[p, layer, c] += alpha * colors[p, s, k, c]
            depths[p, layer] += alpha * value[order[i]]
        for k in range(layer + 1, layers):
            depths[p, k] = depths[p, layer]


def merge_surfaces(
    colors: np.ndarray, disparity: np.ndarray, coverage: np.ndarray, layers: int, min_gap: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Merge what samples of pixels see to layers.

    Args:
        colors: Of each surface by itself, (P, S, K, 3): pixels, samples of each, surfaces on each.
        disparity: Or anything that grows with it, (P, S, K).
        coverage: Alpha of each surface, (P, S, K); 0 where there is none.
        layers: At most so many of each pixel, from 1 up.
        min_gap: Surfaces no farther apart in disparity are one layer.

    Returns:
        Colours (P, layers, 3), disparity (P, layers), front to back, and coverage (P, layers), float32; those
        that are left over have coverage 0. Laid over one another by "over" they show the mean of the
        samples.

    Raises:
        ParameterError: No layers.

    Examples:
        >>> colors = np.array([[[[1, 0, 0], [0, 0, 1]], [[0, 0, 1], [0, 0, 0]]]], np.float32)
        >>> disparity = np.array([[[0.9, 0.1], [0.1, 0]]], np.float32)
        >>> coverage = np.array([[[1, 1], [1, 0]]], np.float32)
        >>> found, depths, covers = merge_surfaces(colors, disparity, coverage, 3)
        >>> covers.tolist(), depths.round(2).tolist()
        ([[0.5, 1.0, 0.0]], [[0.8999999761581421, 0.10000000149011612, 0.10000000149011612]])
    """
    check_whole("layers", layers, 1)
    pixels = len(disparity)
    merged = np.zeros((pixels, layers, 3), np.float64)
    depths, covers = np.zeros((pixels, layers)), np.zeros((pixels, layers))
    given = (np.ascontiguousarray(x, np.float32) for x in (colors, disparity, coverage))
    _merge(*given, float(min_gap), merged, depths, covers)
    return merged.astype(np.float32), depths.astype(np.float32), covers.astype(np.float32)
