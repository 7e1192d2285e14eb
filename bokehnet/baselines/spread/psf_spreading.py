"""Every pixel spreads a table of the point spread function at its own blur: slow, and an oracle."""

from collections.abc import Sequence

import numpy as np

from bokehnet.kernels import njit

__all__ = ["normalised", "packed", "spread_tables"]


def packed(tables: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Square tables as one array, where each begins in it, and half their sides, for kernels."""
    starts = np.cumsum([0, *(table.size for table in tables)])[:-1]
    halves = np.array([len(table) // 2 for table in tables])
    return np.concatenate([table.ravel() for table in tables]), starts, halves


@njit(cache=True)
def spread_tables(image, low, upper, tables, starts, halves, sums, weights):  # type: ignore[no-untyped-def]
    """Add each pixel times the mix of its two tables to ``sums``, and the mix alone to ``weights``, in place.

    Args:
        image: (H, W, C).
        low: Table of each pixel, (H, W); those below 0 spread nothing.
        upper: Share of the table after it, (H, W).
        tables: As :func:`packed` gives them, with the next two.
        starts: See there.
        halves: See there.
        sums: (H, W, C).
        weights: (H, W).
    """
    height, width, channels = image.shape
    for y in range(height):
        for x in range(width):
            if low[y, x] < 0:
                continue
            for step in range(2):
                share = upper[y, x] if step == 1 else 1.0 - upper[y, x]
                if share <= 0.0:
                    continue
                half, start = halves[low[y, x] + step], starts[low[y, x] + step]
                side = 2 * half + 1
                for v in range(max(0, y - half), min(height, y + half + 1)):
                    line = start + (v - y + half) * side + half - x
                    for u in range(max(0, x - half), min(width, x + half + 1)):
                        weight = share * tables[line + u]
                        weights[v, u] += weight
                        for c in range(channels):
                            sums[v, u, c] += weight * image[y, x, c]


def normalised(sums: np.ndarray, weights: np.ndarray, image: np.ndarray) -> np.ndarray:
    """Light over weight, (H, W, C) float32; the picture where none arrives."""
    weights = weights[..., None] if weights.ndim == 2 else weights
    return np.where(weights > 1e-9, sums / np.maximum(weights, 1e-9), image).astype(np.float32)
