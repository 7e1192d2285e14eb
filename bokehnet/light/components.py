"""Connected components of a mask, from its runs along rows."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

__all__ = ["Components", "connected_components"]


@dataclass(frozen=True, slots=True, eq=False)
class Components:
    """Pixels of a mask, grouped by 4-connected component.

    Attributes:
        rows: Row of each pixel of the mask, (N,).
        columns: Column of each pixel, (N,).
        labels: Component of each pixel, 0 to ``count - 1``, (N,).
        count: Number of components.
    """

    rows: npt.NDArray[np.intp]
    columns: npt.NDArray[np.intp]
    labels: npt.NDArray[np.intp]
    count: int

    def sums(self, values: npt.NDArray[np.generic] | None = None) -> npt.NDArray[np.float64]:
        """Return the sum of ``values`` (N,) in each component; the number of pixels without values."""
        return np.bincount(self.labels, values, self.count).astype(np.float64)


def connected_components(mask: npt.NDArray[np.bool_]) -> Components:
    """Return the 4-connected components of a mask (H, W).

    Examples:
        >>> mask = np.array([[1, 1, 0, 1], [0, 1, 0, 1], [0, 0, 0, 1]], bool)
        >>> connected_components(mask).sums()
        array([3., 3.])
    """
    height, width = mask.shape
    padded = np.zeros((height, width + 2), np.int8)
    padded[:, 1:-1] = mask
    steps = np.diff(padded, axis=1)
    run_rows, starts = np.nonzero(steps == 1)
    ends = np.nonzero(steps == -1)[1]
    labels = _joined(run_rows, starts, ends, width + 1)
    lengths = ends - starts
    rows = np.repeat(run_rows, lengths)
    first = np.repeat(np.cumsum(lengths) - lengths, lengths)
    columns = np.arange(len(rows)) - first + np.repeat(starts, lengths)
    return Components(rows, columns, np.repeat(labels, lengths), int(labels.max()) + 1 if len(labels) else 0)


def _joined(
    rows: npt.NDArray[np.intp], starts: npt.NDArray[np.intp], ends: npt.NDArray[np.intp], stride: int
) -> npt.NDArray[np.intp]:
    """Return the component of each run [start, end) of a row, numbered from 0 in order of first runs."""
    count = len(rows)
    # Runs are sorted by row and column. Those of the previous row that overlap a run are consecutive.
    key_starts, key_ends = rows * stride + starts, rows * stride + ends
    low = np.searchsorted(key_ends, key_starts - stride, side="right")
    high = np.searchsorted(key_starts, key_ends - stride, side="left")
    pairs = np.maximum(high - low, 0)
    lower = np.repeat(np.arange(count), pairs)
    upper = np.arange(pairs.sum()) - np.repeat(np.cumsum(pairs) - pairs, pairs) + np.repeat(low, pairs)
    parent = np.arange(count)
    while True:  # every round halves the depth of the trees of runs
        a, b = parent[lower], parent[upper]
        different = a != b
        if not different.any():
            break
        lower, upper, a, b = lower[different], upper[different], a[different], b[different]
        np.minimum.at(parent, np.maximum(a, b), np.minimum(a, b))
        while True:
            shorter = parent[parent]
            if np.array_equal(shorter, parent):
                break
            parent = shorter
    return np.asarray(np.unique(parent, return_inverse=True)[1], np.intp)
