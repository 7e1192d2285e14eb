"""Hidden pixels in the order in which they are filled: from the edge of what hides them inwards."""

from typing import NamedTuple

import numpy as np

__all__ = ["HiddenRings", "hidden_rings"]


class HiddenRings(NamedTuple):
    """Hidden pixels by whole pixels of distance from the edge.

    Attributes:
        ys: Rows, the nearest first, (N,).
        xs: Columns, (N,).
        ends: Numbers of the first pixels of rings 1, 2, ..., and N, (rings + 1,).
        rings: The ring of each pixel, 0 where nothing is hidden, (H, W) uint16.
    """

    ys: np.ndarray
    xs: np.ndarray
    ends: np.ndarray
    rings: np.ndarray


def hidden_rings(distances: np.ndarray) -> HiddenRings:
    """Sort hidden pixels by distance; ``distances`` is (H, W), pixels, 0 where nothing is hidden."""
    ys, xs = np.nonzero(distances)
    rings, hidden = np.zeros(distances.shape, np.uint16), np.ceil(distances[ys, xs])
    hidden = np.minimum(hidden, np.iinfo(rings.dtype).max).astype(rings.dtype)  # sorted by their digits
    rings[ys, xs] = hidden
    order = np.argsort(hidden, kind="stable")
    ys, xs, hidden = ys[order], xs[order], hidden[order]
    ends = np.searchsorted(hidden, np.arange(1, int(hidden.max(initial=0)) + 2))
    return HiddenRings(ys, xs, ends, rings)
