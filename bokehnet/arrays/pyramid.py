"""Halving and doubling of pictures by exact factors of two. Operators only: NumPy arrays and torch tensors.

All arrays are (..., H, W). Pixel centres follow the half-pixel convention: a pixel of the smaller picture
covers two by two pixels of the larger one.
"""

import math

from bokehnet.checks import Array, array_namespace

__all__ = ["count_halvings", "crop_to", "downsample2", "pad_to_multiple", "upsample2"]


def count_halvings(max_radius: float, network_max_radius: float) -> int:
    """Return the number of halvings until the largest blur is at most ``network_max_radius`` pixels.

    Args:
        max_radius: Largest |defocus|, pixels.
        network_max_radius: Largest radius in the training of a network, pixels.
    """
    return max(0, math.ceil(math.log2(max(max_radius, 1e-9) / network_max_radius)))


def downsample2(x: Array) -> Array:
    """Return the mean of every 2x2 block, (..., H, W) to (..., H/2, W/2); both sides must be even."""
    return 0.25 * (x[..., 0::2, 0::2] + x[..., 0::2, 1::2] + x[..., 1::2, 0::2] + x[..., 1::2, 1::2])


def _double_columns(x: Array) -> Array:
    """Interpolate linearly along the last axis at a quarter before and after each pixel."""
    xp = array_namespace(x)
    before = xp.concatenate([x[..., :1], x[..., :-1]], -1)
    after = xp.concatenate([x[..., 1:], x[..., -1:]], -1)
    pairs = xp.stack([0.75 * x + 0.25 * before, 0.75 * x + 0.25 * after], -1)
    return pairs.reshape(*x.shape[:-1], 2 * x.shape[-1])


def upsample2(x: Array) -> Array:
    """Double by bilinear interpolation, (..., H, W) to (..., 2H, 2W); the border is repeated."""
    xp = array_namespace(x)
    tall = xp.swapaxes(_double_columns(xp.swapaxes(x, -1, -2)), -1, -2)
    return _double_columns(tall)


def pad_to_multiple(x: Array, multiple: int) -> Array:
    """Repeat the last row and column until both sides are multiples of ``multiple``."""
    xp = array_namespace(x)
    rows, columns = -x.shape[-2] % multiple, -x.shape[-1] % multiple
    if rows:
        x = xp.concatenate([x] + [x[..., -1:, :]] * rows, -2)
    if columns:
        x = xp.concatenate([x] + [x[..., :, -1:]] * columns, -1)
    return x


def crop_to(x: Array, height: int, width: int) -> Array:
    """Undo :func:`pad_to_multiple`."""
    return x[..., :height, :width]
