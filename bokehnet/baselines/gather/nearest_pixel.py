"""What samples of the gathers look up: the pixel that a place falls in, the border's beyond the border."""

import math

from bokehnet.kernels import njit

__all__ = ["nearest_pixel"]


@njit(cache=True)
def nearest_pixel(y, x, height, width):  # type: ignore[no-untyped-def]
    """Row and column of the pixel whose middle is nearest to the place (y, x)."""
    row = min(max(int(math.floor(y + 0.5)), 0), height - 1)
    return row, min(max(int(math.floor(x + 0.5)), 0), width - 1)
