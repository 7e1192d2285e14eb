"""Depth maps in iPhone photos: their XMP, and their position in a JPEG file.

Source:
    Apple, "AVDepthData" and "Creating auxiliary depth data manually", developer.apple.com: disparity
    in 1/m, depth in m, their range as FloatMinValue and FloatMaxValue, Accuracy ``absolute`` or ``relative``.
"""

import math
from collections.abc import Iterator
from pathlib import Path
from xml.etree.ElementTree import Element

from bokehnet.errors import ImageFileError
from bokehnet.io.containers.jpeg import JPEG_START, jpeg_layout
from bokehnet.io.depth.depth_coding import DepthCoding, StoredDepth
from bokehnet.io.metadata.xmp import jpeg_xmp, xmp_properties

__all__ = ["apple_coding", "apple_depth"]

PIXEL_DATA = "http://ns.apple.com/pixeldatainfo/1.0/"
_DEPTH_DATA = "http://ns.apple.com/depthData/1.0/"
_MM_PER_M = 1000.0
_MAX_PICTURES = 16  # per file


def apple_depth(path: Path | str, data: bytes, end: int) -> StoredDepth | None:
    """Return the depth map of an iPhone photo in JPEG, a picture after the first one; None if absent.

    Args:
        path: File, for messages.
        data: Content of the file.
        end: End of its first picture.

    Raises:
        ImageFileError: The metadata of the map are damaged.
    """
    for start in _following_pictures(data, end):
        layout = jpeg_layout(data, start)
        if not any(PIXEL_DATA.encode() in payload for payload in layout.app1):
            continue
        coding = apple_coding(path, jpeg_xmp(path, layout.app1))
        if coding is not None:
            return StoredDepth(picture=data[start : layout.end], coding=coding)
    return None


def apple_coding(path: Path | str, roots: list[Element]) -> DepthCoding | None:
    """Return the coding of an auxiliary picture according to its XMP; None if it is no depth map.

    Args:
        path: File, for messages.
        roots: XMP of that picture.

    Raises:
        ImageFileError: The range of the values is missing or wrong.
    """
    fields = xmp_properties(roots, PIXEL_DATA)
    kind = fields.get("AuxiliaryImageType")
    if kind not in ("disparity", "depth"):
        return None
    try:
        low, high = float(fields["FloatMinValue"]), float(fields["FloatMaxValue"])
    except (KeyError, ValueError):
        low = high = math.nan
    if not (-math.inf < low < high < math.inf and (kind == "disparity" or low > 0)):
        raise ImageFileError(
            f"{path}: expected a range of {kind} from FloatMinValue to FloatMaxValue, "
            f"found {fields.get('FloatMinValue')} to {fields.get('FloatMaxValue')}"
        )
    absolute = xmp_properties(roots, _DEPTH_DATA).get("Accuracy") == "absolute"
    ends = (low, high) if kind == "disparity" else (1 / low, 1 / high)
    return DepthCoding(ends=ends, linear_in=kind, unit=_MM_PER_M if absolute else None)


def _following_pictures(data: bytes, position: int) -> Iterator[int]:
    """Yield the start offsets of JPEG pictures after ``position``, at most ``_MAX_PICTURES``."""
    for _ in range(_MAX_PICTURES):
        position = data.find(JPEG_START, position)
        if position < 0:
            return
        yield position
        position = jpeg_layout(data, position).end
