"""Small copy of a picture and its maps, halved until networks can see all of it, filled row by row."""

from collections.abc import Mapping

import numpy as np
from numba import prange

from bokehnet.classical.parallel import parallel_region
from bokehnet.inference.coarse_to_fine import BLOCK
from bokehnet.kernels import njit

__all__ = ["SmallCopy"]


@njit(cache=True, parallel=True)
def _shrink(array, factor, top, bottom, result):
    """Fill means of blocks of (H, W, C); the last row and column repeat as necessary."""
    height, width, channels = array.shape
    for row in prange(top, bottom):
        total = np.zeros(channels)
        for column in range(result.shape[1]):
            total[:] = 0.0
            for v in range((row - top) * factor, (row - top + 1) * factor):
                for u in range(column * factor, (column + 1) * factor):
                    for c in range(channels):
                        total[c] += array[min(v, height - 1), min(u, width - 1), c]
            for c in range(channels):
                result[row, column, c] = total[c] / (factor * factor)


class SmallCopy:
    """Means over blocks of pixels of a picture and of its maps.

    Attributes:
        halvings: Number of halvings from the picture to the copy.

    Args:
        height: Height of the picture, pixels.
        width: Width of the picture, pixels.
        halvings: Minimum number of halvings.
        max_pixels: Maximum number of pixels of the copy; the picture is halved until it has no more.
    """

    def __init__(self, height: int, width: int, halvings: int, max_pixels: int) -> None:
        while height * width > max_pixels << 2 * halvings:
            halvings += 1
        self.halvings = halvings
        self._factor, self._height = 2**halvings, height
        self._size = tuple(BLOCK * -(-side // (BLOCK * self._factor)) for side in (height, width))
        self._copies: dict[str, np.ndarray] = {}

    def add(self, first: int, arrays: Mapping[str, np.ndarray]) -> None:
        """Add rows of the picture.

        Args:
            first: Row of the picture at which the arrays begin; a multiple of ``2**halvings``.
            arrays: Arrays (H, W, C) by name, the same names each time.
        """
        last = first + len(next(iter(arrays.values())))
        top = first // self._factor
        bottom = self._size[0] if last == self._height else last // self._factor
        for name, array in arrays.items():
            if name not in self._copies:
                self._copies[name] = np.empty((*self._size, array.shape[2]), np.float32)
            with parallel_region:
                _shrink(array, self._factor, top, bottom, self._copies[name])

    def batch(self) -> dict[str, np.ndarray]:
        """Return all copies by name, (1, C, h, w), sides multiples of ``BLOCK``, after all rows are added.

        The copy ``defocus`` is in pixels of the copy.
        """
        batch = {name: array.transpose(2, 0, 1)[None] for name, array in self._copies.items()}
        if "defocus" in batch:
            batch["defocus"] = batch["defocus"] / np.float32(self._factor)
        return batch
