"""Pixel lookup of the gathers: nearest pixel, clamped to the border."""

import math

from bokehnet.kernels import njit

__all__ = ["nearest_pixel"]


@njit(cache=True)
def nearest_pixel(y, x, height, width):
    """Return row and column of the pixel whose centre is nearest to (y, x)."""
    row = min(max(int(math.floor(y + 0.5)), 0), height - 1)
    return row, min(max(int(math.floor(x + 0.5)), 0), width - 1)
