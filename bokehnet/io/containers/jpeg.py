"""Segments of a JPEG stream, located without decoding pixels."""

import re
import struct
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

__all__ = [
    "APP1",
    "APP2",
    "ICC_SEGMENT",
    "JPEG_START",
    "JpegLayout",
    "icc_segments",
    "insert_segments",
    "jpeg_layout",
    "jpeg_segments",
    "segments_of",
]

JPEG_START = b"\xff\xd8\xff"

APP1, APP2 = 0xE1, 0xE2
ICC_SEGMENT = b"ICC_PROFILE\0"

_APP0 = 0xE0
_START, _END, _SCAN = 0xD8, 0xD9, 0xDA
_MAX_PAYLOAD_BYTES = 65533
_MAX_SEGMENTS = 10_000  # before the pixels; 255 carry a large colour profile

# A marker is 0xFF and a byte that is not stuffing (00), fill (FF), TEM (01) or a restart (D0 to D7).
_MARKER = re.compile(rb"\xff([^\x00\x01\xd0-\xd7\xff])", re.DOTALL)


# Any number of fill bytes may precede a marker.
_FILL = re.compile(rb"\xff+")


@dataclass(frozen=True, kw_only=True, slots=True)
class JpegLayout:
    """Metadata segments and end of a JPEG picture.

    Attributes:
        app1: Payloads of the APP1 segments (EXIF, XMP), in order.
        end: Offset of the first byte after the picture; the length of the data if its end is missing.
    """

    app1: tuple[bytes, ...]
    end: int


def jpeg_layout(data: bytes, start: int = 0) -> JpegLayout:
    """Return the layout of the picture that begins at ``start``.

    A segment length beyond the end of the data truncates the payload; its reader detects that.

    Args:
        data: Content of the file.
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
        if marker == APP1:
            app1.append(data[position + 2 : position + length])
        position += length
    return JpegLayout(app1=tuple(app1), end=len(data))


def jpeg_segments(path: Path) -> list[tuple[int, bytes]]:
    """Return markers and payloads of a file up to its pixels; damage ends the list."""
    return segments_of(path.read_bytes())


def segments_of(data: bytes, start: int = 0) -> list[tuple[int, bytes]]:
    """Return markers and payloads of the picture at ``start`` up to its pixels; damage ends the list."""
    segments: list[tuple[int, bytes]] = []
    position = start + 2
    while len(segments) < _MAX_SEGMENTS and (fill := _FILL.match(data, position)):
        at = fill.end()
        if len(data) < at + 3 or data[at] in (_SCAN, _END):
            break
        length = max(2, int.from_bytes(data[at + 1 : at + 3], "big"))
        position = at + 1 + length
        segments.append((data[at], data[at + 3 : position]))
    return segments


def icc_segments(profile: bytes) -> list[tuple[int, bytes]]:
    """Split a colour profile into segments.

    Source: ICC.1:2022, annex B.4, "Embedding ICC profiles in JPEG files".
    """
    room = _MAX_PAYLOAD_BYTES - len(ICC_SEGMENT) - 2
    pieces = [profile[start : start + room] for start in range(0, len(profile), room)]
    return [
        (APP2, ICC_SEGMENT + bytes([number, len(pieces)]) + piece)
        for number, piece in enumerate(pieces, start=1)
    ]


def insert_segments(data: bytes, segments: Iterable[tuple[int, bytes]]) -> bytes:
    """Return a JPEG file with these segments in place of its own EXIF and XMP segments.

    Segments that are too long are omitted.
    """
    start = 2
    kept = b""
    while data[start] == 0xFF and data[start + 1] in (_APP0, APP1):
        end = start + 2 + int.from_bytes(data[start + 2 : start + 4], "big")
        kept += data[start:end] if data[start + 1] == _APP0 else b""
        start = end
    added = b"".join(
        struct.pack(">BBH", 0xFF, marker, len(payload) + 2) + payload
        for marker, payload in segments
        if len(payload) <= _MAX_PAYLOAD_BYTES
    )
    return data[:2] + kept + added + data[start:]
