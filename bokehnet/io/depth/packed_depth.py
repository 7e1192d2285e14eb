"""Depth packed into the bytes of a colour picture."""

import numpy as np
from numpy.typing import NDArray

from bokehnet.errors import ImageFileError

__all__ = ["PACKED_CODINGS", "unpack_depth"]

# Channels of each coding.
PACKED_CODINGS = {"rgb24": 3, "bgr24": 3, "rgba-fixed": 4, "rgba-float": 4}

_LEVELS = 255


def unpack_depth(colors: NDArray[np.float32], coding: str, name: str) -> NDArray[np.float32]:
    """Return the values of a packed map, (H, W).

    ``rgb24``: (R + 256 G + 65536 B) / (2^24 - 1), as the simulator CARLA writes it, 0 to 1. ``bgr24``: the
    same with B as the lowest byte. ``rgba-fixed``: R/255 + G/255^2 + B/255^3 + A/255^4 in units of
    R = 1, the packing of shaders, 0 to 1. ``rgba-float``: the four bytes of a float32, lowest byte in R.

    Args:
        colors: Stored channels of 8 bits, scaled to [0, 1], (H, W, 3 or 4).
        coding: One of ``PACKED_CODINGS``.
        name: Name of the map in messages.

    Raises:
        ImageFileError: The map has too few channels.

    Sources:
        CARLA simulator, documentation of the depth camera. A. Pranckevičius, "Encoding floats to RGBA - the
        final?", 2009. IEEE 754.

    Examples:
        >>> colors = np.array([[[255, 255, 127]]], np.float32) / 255
        >>> unpack_depth(colors, "rgb24", "map").round(3).tolist()
        [[0.5]]
    """
    channels = PACKED_CODINGS[coding]
    if colors.shape[-1] < channels:
        raise ImageFileError(
            f"{name}: `depth.coding` {coding} needs {channels} channels of 8 bits, found {colors.shape[-1]}"
        )
    levels = np.rint(np.clip(colors[..., :channels], 0, 1) * _LEVELS)
    if coding == "rgba-float":
        values = np.ascontiguousarray(levels.astype(np.uint8)).view("<f4")[..., 0]
        return values.astype(np.float32)
    if coding == "rgba-fixed":
        weights = np.array([1 / 255.0**power for power in (1, 2, 3, 4)])
    else:
        weights = np.array([1.0, 256.0, 65536.0]) / (2**24 - 1)
        weights = weights if coding == "rgb24" else weights[::-1]
    return (levels.astype(np.float64) @ weights).astype(np.float32)
