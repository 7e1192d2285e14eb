"""Resampling of pictures and maps to another size."""

import math
from typing import Literal

import numpy as np
import OpenImageIO as oiio  # noqa: N813
from numpy.typing import NDArray

from bokehnet.errors import ImageFileError

__all__ = ["Kernel", "resample", "same_aspect"]

Kernel = Literal["cubic", "linear", "area"]

# Maximum difference of the logarithms of two aspect ratios that count as equal.
_ASPECT_TOLERANCE = 0.05

_FILTERS = {"cubic": "catmull-rom", "linear": "triangle", "area": "box"}


def same_aspect(size: tuple[int, ...], other: tuple[int, ...]) -> bool:
    """Return whether two sizes (height, width) have the same aspect ratio, within 5 %."""
    return abs(math.log(size[0] / size[1] * other[1] / other[0])) <= _ASPECT_TOLERANCE


def resample(
    values: NDArray[np.float32], height: int, width: int, kernel: Kernel = "cubic"
) -> NDArray[np.float32]:
    """Resample to another size; the kernel is as wide as a pixel of the smaller size, which avoids aliasing.

    Pixel centres are aligned. The result is clipped to the range of ``values``, which the cubic kernel
    exceeds.

    Args:
        values: (H, W) or (H, W, C), finite.
        height: Height of the result, pixels.
        width: Width of the result, pixels.
        kernel: Catmull-Rom cubic, linear or area.

    Returns:
        Array of the new size, with the same channels.
    """
    source = oiio.ImageBuf(np.ascontiguousarray(values.reshape(*values.shape[:2], -1)))
    result = oiio.ImageBufAlgo.resize(source, filtername=_FILTERS[kernel], roi=oiio.ROI(0, width, 0, height))
    if result.has_error:
        raise ImageFileError(f"resizing to {width}x{height} pixels failed: {result.geterror()}")
    pixels = np.asarray(result.get_pixels(oiio.FLOAT), np.float32)
    return np.clip(pixels.reshape(height, width, *values.shape[2:]), values.min(), values.max())
