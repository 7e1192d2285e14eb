"""Lattices of every second row and column: numba kernels from a picture to its four lattices and back.

The pixel (i, j) of the lattice that starts at (y, x), each 0 or 1, is at (y + 2 i - 2, x + 2 j - 2) of the
picture: a lattice has one more row and column on every side than it has sources, so that linear interpolation
between its pixels covers the whole picture.
"""

import numpy as np
from numba import prange

from bokehnet.kernels import njit

__all__ = ["add_lattice", "gather_lattice", "lattice_shape"]


def lattice_shape(height: int, width: int, y: int, x: int) -> tuple[int, int]:
    """Return the height and width of the lattice that starts at (y, x) of a picture."""
    return (height - y + 1) // 2 + 2, (width - x + 1) // 2 + 2


@njit(cache=True, parallel=True)
def add_lattice(coarse, y, x, sums):
    """Add the interpolated lattice ``coarse`` (h, w, C) that starts at (y, x) to ``sums`` (H, W, C)."""
    height, width, channels = sums.shape
    for row in prange(height):
        position = np.int64(row) + 2 - y
        upper, lower = position // 2, (position + 1) // 2  # equal in every second row
        line = np.empty(coarse.shape[1:], coarse.dtype)
        for j in range(coarse.shape[1]):
            for c in range(channels):
                line[j, c] = 0.5 * (coarse[upper, j, c] + coarse[lower, j, c])
        for column in range(width):
            left, right = (column + 2 - x) // 2, (column + 3 - x) // 2
            for c in range(channels):
                sums[row, column, c] += 0.5 * (line[left, c] + line[right, c])


@njit(cache=True, parallel=True)
def gather_lattice(gradient, y, x, coarse):
    """Compute the adjoint of :func:`add_lattice`: fill ``coarse`` (h, w, C) from ``gradient`` (H, W, C)."""
    height, width, channels = gradient.shape
    for i in prange(coarse.shape[0]):
        middle = 2 * np.int64(i) - 2 + y
        line = np.zeros((width, channels), gradient.dtype)
        for row in range(max(middle - 1, 0), min(middle + 2, height)):
            weight = 1.0 if row == middle else 0.5
            for column in range(width):
                for c in range(channels):
                    line[column, c] += weight * gradient[row, column, c]
        coarse[i] = 0.0
        for column in range(width):
            left, right = (column + 2 - x) // 2, (column + 3 - x) // 2
            for c in range(channels):
                coarse[i, left, c] += 0.5 * line[column, c]
                coarse[i, right, c] += 0.5 * line[column, c]
