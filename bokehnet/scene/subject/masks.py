"""Median of small maps, and connected components of masks."""

import numpy as np
import numpy.typing as npt

__all__ = ["label", "median3"]

Array = npt.NDArray[np.float32]
Mask = npt.NDArray[np.bool_]


def median3(values: Array) -> Array:
    """Return the median of 3x3 pixels, borders repeated, (H, W)."""
    padded = np.pad(values, 1, mode="edge")
    height, width = values.shape
    shifted = [padded[y : y + height, x : x + width] for y in range(3) for x in range(3)]
    return np.asarray(np.median(shifted, axis=0), np.float32)


def label(mask: Mask) -> npt.NDArray[np.intp]:
    """Return the number of the 4-connected component of each pixel, from 1; 0 outside the mask."""
    height, width = mask.shape
    edges = np.diff(np.pad(mask, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    rows, starts = np.nonzero(edges == 1)
    ends = np.nonzero(edges == -1)[1]
    parents = list(range(rows.size))

    def root(run: int) -> int:
        while parents[run] != run:
            parents[run] = parents[parents[run]]
            run = parents[run]
        return run

    first = np.searchsorted(rows, np.arange(height + 1)).tolist()
    begin, end = starts.tolist(), ends.tolist()
    for row in range(1, height):
        above, below = first[row - 1], first[row]
        while above < first[row] and below < first[row + 1]:
            if begin[above] < end[below] and begin[below] < end[above]:
                parents[root(below)] = root(above)
            if end[above] < end[below]:
                above += 1
            else:
                below += 1
    roots = np.array([root(run) for run in range(rows.size)], np.intp)
    numbers = np.unique(roots, return_inverse=True)[1] + 1
    labels = np.zeros(height * width + 1, np.intp)
    np.add.at(labels, rows * width + starts, numbers)
    np.add.at(labels, rows * width + ends, -numbers)
    return np.cumsum(labels[:-1]).reshape(height, width)
