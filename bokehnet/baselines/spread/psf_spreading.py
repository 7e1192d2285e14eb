"""Spreading with point spread function tables at each pixel's blur: slow; serves as an oracle."""

from collections.abc import Sequence

import numpy as np

from bokehnet.kernels import njit

__all__ = ["normalised", "packed", "spread_tables"]


def packed(tables: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return square tables as one array, their starts, and half their sides, for kernels."""
    starts = np.cumsum([0, *(table.size for table in tables)])[:-1]
    halves = np.array([len(table) // 2 for table in tables])
    return np.concatenate([table.ravel() for table in tables]), starts, halves


@njit(cache=True)
def spread_tables(image, low, upper, tables, starts, halves, sums, weights):
    """Add each pixel times the mix of its two tables to ``sums``, and the mix to ``weights``, in place.

    Args:
        image: Picture, (H, W, C).
        low: Index of the table of each pixel, (H, W); negative pixels spread nothing.
        upper: Weight of the following table, (H, W).
        tables: Tables from :func:`packed`.
        starts: Starts from :func:`packed`.
        halves: Half sides from :func:`packed`.
        sums: Sums of light, (H, W, C).
        weights: Sums of weights, (H, W).
    """
    height, width, channels = image.shape
    for y in range(height):
        for x in range(width):
            if low[y, x] < 0:
                continue
            for step in range(2):
                mix = upper[y, x] if step == 1 else 1.0 - upper[y, x]
                if mix <= 0.0:
                    continue
                half, start = halves[low[y, x] + step], starts[low[y, x] + step]
                side = 2 * half + 1
                for v in range(max(0, y - half), min(height, y + half + 1)):
                    line = start + (v - y + half) * side + half - x
                    for u in range(max(0, x - half), min(width, x + half + 1)):
                        weight = mix * tables[line + u]
                        weights[v, u] += weight
                        for c in range(channels):
                            sums[v, u, c] += weight * image[y, x, c]


def normalised(sums: np.ndarray, weights: np.ndarray, image: np.ndarray) -> np.ndarray:
    """Return light divided by weight, (H, W, C) float32; the picture where no light arrives."""
    weights = weights[..., None] if weights.ndim == 2 else weights
    return np.where(weights > 1e-9, sums / np.maximum(weights, 1e-9), image).astype(np.float32)
