"""Scene-linear light as the bytes that a canvas shows."""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from bokehnet.io.color.color_space import COLOR_SPACES, SRGB, ColorSpace, convert
from bokehnet.io.color.srgb import linear_to_srgb

__all__ = ["SPACES", "to_rgba"]

SPACES = {"srgb": SRGB, "display-p3": COLOR_SPACES["display-p3"]}
"""Colour spaces of a canvas; both have the curve of sRGB."""

# Bits of a float32 that pick the byte: sign, exponent and 11 of the fraction, finer than any byte asks for.
_SHIFT = 12
_ONE = int(np.float32(1).view(np.uint32)) >> _SHIFT


@cache
def _bytes_of_light() -> NDArray[np.uint8]:
    """The byte of the numbers from 0 to 1 that share their leading bits: that of the middle one."""
    bits = (np.arange(_ONE + 1, dtype=np.uint32) << _SHIFT) + (1 << (_SHIFT - 1))
    light = np.minimum(bits.view(np.float32), 1)
    return np.rint(255 * linear_to_srgb(light)).astype(np.uint8)


def to_rgba(light: NDArray[np.float32], space: ColorSpace, shown: str = "srgb") -> NDArray[np.uint8]:
    """Return what a canvas shows of light: (H, W, 4), opaque, encoded by the curve of sRGB.

    Args:
        light: Scene-linear, (H, W, 3); above 1 is white.
        space: Whose primaries it has.
        shown: Name of the canvas's space, of :data:`SPACES`.

    Examples:
        >>> to_rgba(np.array([[[0, 0.2140411, 4]]], np.float32), SRGB).tolist()
        [[[0, 127, 255, 255]]]
    """
    light = np.clip(convert(light, space, SPACES[shown]), 0, 1)
    result = np.full((*light.shape[:2], 4), 255, np.uint8)
    result[..., :3] = _bytes_of_light()[light.view(np.uint32) >> _SHIFT]
    return result
