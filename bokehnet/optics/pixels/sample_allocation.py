"""How many samples each pixel gets by how much its samples differ: one interface for tracer and hybrid.

:mod:`bokehnet.classical.layered.march.sample_counts` follows the same law, tile by tile, inside compiled
code.
"""

from collections.abc import Callable

import numpy as np

__all__ = ["Allocation", "neyman"]

# Variance of one sample of each pixel, (N,); samples of each so far, (N,); and how many may be added in all.
# Gives how many each adds, (N,) int64, which sum to no more than that.
Allocation = Callable[[np.ndarray, np.ndarray, int], np.ndarray]


def neyman(variance: np.ndarray, sent: np.ndarray, budget: int) -> np.ndarray:
    """Add samples so that the mean variance of all pixels' means becomes least; see ``Allocation``.

    The sum of ``v / n`` is least where n grows with the root of v; pixels that have more than that already
    get none. Parts of samples are carried over from pixel to pixel.

    Args:
        variance: From 0 up, (N,).
        sent: From 0 up, (N,).
        budget: From 0 up.

    Source:
        Neyman, "On the two different aspects of the representative method", 1934; water-filling as in Boyd
        and Vandenberghe, "Convex optimization", 2004, 5.5.3.

    Examples:
        >>> import numpy as np
        >>> neyman(np.array([1.0, 9.0, 0.0]), np.zeros(3), 8).tolist()
        [2, 6, 0]
    """
    root = np.sqrt(np.asarray(variance, np.float64))
    sent = np.asarray(sent, np.float64)
    if not root.any() or budget < 1:
        return np.zeros(len(root), np.int64)
    # n = level * root where that is above what was sent: pixels enter in the order of sent / root.
    noisy = np.flatnonzero(root > 0)
    order = noisy[np.argsort(sent[noisy] / root[noisy], kind="stable")]
    level = (budget + np.cumsum(sent[order])) / np.cumsum(root[order])
    inside = np.flatnonzero(level > sent[order] / root[order])[-1]
    more = np.maximum(level[inside] * root - sent, 0)
    whole = np.floor(np.cumsum(more) + 1e-6).astype(np.int64)
    return np.diff(whole, prepend=0)
