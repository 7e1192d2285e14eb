"""Boxes of a JPEG XL file: read metadata and insert them before the pixels.

Source: ISO/IEC 18181-2, "JPEG XL image coding system, file format", 2024, clause 9: boxes.
"""

import struct
from pathlib import Path

__all__ = ["jxl_boxes", "jxl_with"]

_SIGNATURE = b"\0\0\0\x0cJXL \r\n\x87\n"
_TYPE = b"\0\0\0\x14ftypjxl \0\0\0\0jxl "
_BARE = b"\xff\x0a"  # codestream without a container
_FIRST = (b"JXL ", b"ftyp", b"jxll")
_EXIF, _XMP = b"Exif", b"xml "
_MAX_METADATA_BYTES = 2**27


def jxl_boxes(path: Path) -> dict[bytes, bytes]:
    """Return the metadata by box name, ``Exif`` and ``xml ``, without the offset field of ``Exif``.

    Damaged and additionally compressed boxes are omitted.
    """
    boxes: dict[bytes, bytes] = {}
    with path.open("rb") as file:
        if file.read(len(_SIGNATURE)) != _SIGNATURE:
            return boxes
        while len(head := file.read(8)) == 8:
            length, name = struct.unpack(">I4s", head)
            head_bytes = 8
            if length == 1:
                length, head_bytes = int.from_bytes(file.read(8), "big"), 16
            if length < head_bytes or length > 2**62:  # 0: the last box, which holds pixels
                break
            if name in (_EXIF, _XMP) and length < _MAX_METADATA_BYTES:
                content = file.read(length - head_bytes)
                if len(content) == length - head_bytes:
                    boxes.setdefault(name, content)
            else:
                file.seek(length - head_bytes, 1)
    if _EXIF in boxes:
        start = 4 + int.from_bytes(boxes[_EXIF][:4], "big")
        boxes[_EXIF] = boxes[_EXIF][start:]
    return boxes


def jxl_with(data: bytes, *, exif: bytes | None, xmp: bytes | None) -> bytes:
    """Return a JPEG XL file without metadata with these metadata inserted.

    Args:
        data: Content of the file.
        exif: EXIF that begins with its TIFF header.
        xmp: XMP packet.
    """
    if data.startswith(_BARE):
        data = _SIGNATURE + _TYPE + _box(b"jxlc", data)
    position = 0
    while data[position + 4 : position + 8] in _FIRST:
        position += int.from_bytes(data[position : position + 4], "big")
    added = _box(_EXIF, bytes(4) + exif) if exif else b""
    added += _box(_XMP, xmp) if xmp else b""
    return data[:position] + added + data[position:]


def _box(name: bytes, content: bytes) -> bytes:
    return struct.pack(">I4s", 8 + len(content), name) + content
