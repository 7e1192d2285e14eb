"""Where the pieces of a JPEG stream lie, without decoding a pixel."""

import re
from dataclasses import dataclass

__all__ = ["JPEG_START", "JpegLayout", "jpeg_layout"]

JPEG_START = b"\xff\xd8\xff"

_APP1 = 0xE1
_START, _END = 0xD8, 0xD9

# A marker is 0xFF and a byte that is not stuffing (00), fill (FF), TEM (01) or a restart (D0 to D7).
_MARKER = re.compile(rb"\xff([^\x00\x01\xd0-\xd7\xff])", re.DOTALL)


@dataclass(frozen=True, kw_only=True, slots=True)
class JpegLayout:
    """What :func:`jpeg_layout` found.

    Attributes:
        app1: Payloads of the APP1 segments (EXIF, XMP), in order.
        end: Offset of the first byte behind the picture; the length of the data when its end is missing.
    """

    app1: tuple[bytes, ...]
    end: int


def jpeg_layout(data: bytes, start: int = 0) -> JpegLayout:
    """Walk over the markers of the picture that begins at ``start``.

    Lengths beyond the end cut a payload short; whoever reads it finds out.

    Args:
        data: The file.
        start: Offset of ``JPEG_START``.

    Source: ITU-T T.81, "Digital compression and coding of continuous-tone still images", 1992, annex B.
    """
    app1: list[bytes] = []
    position = start + 2
    while match := _MARKER.search(data, position):
        marker, position = match[1][0], match.end()
        if marker == _END:
            return JpegLayout(app1=tuple(app1), end=position)
        if marker == _START:
            continue
        length = max(2, int.from_bytes(data[position : position + 2], "big"))
        if marker == _APP1:
            app1.append(data[position + 2 : position + length])
        position += length
    return JpegLayout(app1=tuple(app1), end=len(data))
