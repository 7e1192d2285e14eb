"""Conversion of scene-linear light to bytes for a canvas."""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from bokehnet.io.color.color_space import COLOR_SPACES, SRGB, ColorSpace, convert
from bokehnet.io.color.srgb import linear_to_srgb

__all__ = ["SPACES", "to_rgba"]

SPACES = {"srgb": SRGB, "display-p3": COLOR_SPACES["display-p3"]}
"""Colour spaces of a canvas; both use the sRGB curve."""

# Dropped bits of a float32: sign, exponent and 11 fraction bits remain, finer than a byte needs.
_SHIFT = 12
_ONE = int(np.float32(1).view(np.uint32)) >> _SHIFT


@cache
def _bytes_of_light() -> NDArray[np.uint8]:
    """Return the look-up table from leading bits of numbers in 0 to 1 to bytes, for interval middles."""
    bits = (np.arange(_ONE + 1, dtype=np.uint32) << _SHIFT) + (1 << (_SHIFT - 1))
    light = np.minimum(bits.view(np.float32), 1)
    return np.rint(255 * linear_to_srgb(light)).astype(np.uint8)


def to_rgba(light: NDArray[np.float32], space: ColorSpace, shown: str = "srgb") -> NDArray[np.uint8]:
    """Return the pixels of a canvas for light: (H, W, 4), opaque, encoded by the sRGB curve.

    Args:
        light: Scene-linear light, (H, W, 3); clipped at 1.
        space: Colour space of the light.
        shown: Name of the canvas's colour space, one of :data:`SPACES`.

    Examples:
        >>> to_rgba(np.array([[[0, 0.2140411, 4]]], np.float32), SRGB).tolist()
        [[[0, 127, 255, 255]]]
    """
    light = np.clip(convert(light, space, SPACES[shown]), 0, 1)
    result = np.full((*light.shape[:2], 4), 255, np.uint8)
    result[..., :3] = _bytes_of_light()[light.view(np.uint32) >> _SHIFT]
    return result
