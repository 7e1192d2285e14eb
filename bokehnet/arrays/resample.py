"""Pictures and maps at another size."""

from typing import Literal

import numpy as np
import OpenImageIO as oiio  # noqa: N813
from numpy.typing import NDArray

from bokehnet.errors import ImageFileError

__all__ = ["Kernel", "resample"]

Kernel = Literal["cubic", "linear", "area"]

_FILTERS = {"cubic": "catmull-rom", "linear": "triangle", "area": "box"}


def resample(
    values: NDArray[np.float32], height: int, width: int, kernel: Kernel = "cubic"
) -> NDArray[np.float32]:
    """Resample to another size; the kernel is as wide as a pixel of the smaller size, so nothing aliases.

    Pixel centres are aligned. The result stays within the range of ``values``, where cubic would overshoot.

    Args:
        values: (H, W) or (H, W, C), finite.
        height: Of the result, pixels.
        width: Of the result, pixels.
        kernel: Catmull-Rom cubic, linear or area.

    Returns:
        Array of the new size, as many channels.
    """
    source = oiio.ImageBuf(np.ascontiguousarray(values.reshape(*values.shape[:2], -1)))
    result = oiio.ImageBufAlgo.resize(source, filtername=_FILTERS[kernel], roi=oiio.ROI(0, width, 0, height))
    if result.has_error:
        raise ImageFileError(f"resizing to {width}x{height} pixels failed: {result.geterror()}")
    pixels = np.asarray(result.get_pixels(oiio.FLOAT), np.float32)
    return np.clip(pixels.reshape(height, width, *values.shape[2:]), values.min(), values.max())
