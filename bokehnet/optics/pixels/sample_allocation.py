"""Allocation of samples to pixels by the variance of their samples, for the path tracer and the hybrid.

:mod:`bokehnet.classical.layered.march.sample_counts` applies the same rule per tile inside compiled code.
"""

from collections.abc import Callable

import numpy as np

__all__ = ["Allocation", "neyman"]

# Called with the variance of one sample of each pixel, (N,); the samples of each so far, (N,); and the total
# budget of new samples. Returns the new samples of each pixel, (N,) int64, whose sum is at most the budget.
Allocation = Callable[[np.ndarray, np.ndarray, int], np.ndarray]


def neyman(variance: np.ndarray, sent: np.ndarray, budget: int) -> np.ndarray:
    """Return the new samples per pixel that minimize the mean variance of pixel means; see ``Allocation``.

    The sum of ``v / n`` is minimal for n proportional to the root of v; pixels that already exceed this
    get no samples. Fractions of samples carry over from pixel to pixel.

    Args:
        variance: Variance of one sample, >= 0, (N,).
        sent: Samples so far, >= 0, (N,).
        budget: Maximum number of new samples, >= 0.

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
    # n = level * root if that exceeds the samples sent: pixels enter in the order of sent / root.
    noisy = np.flatnonzero(root > 0)
    order = noisy[np.argsort(sent[noisy] / root[noisy], kind="stable")]
    level = (budget + np.cumsum(sent[order])) / np.cumsum(root[order])
    inside = np.flatnonzero(level > sent[order] / root[order])[-1]
    more = np.maximum(level[inside] * root - sent, 0)
    whole = np.floor(np.cumsum(more) + 1e-6).astype(np.int64)
    return np.diff(whole, prepend=0)
