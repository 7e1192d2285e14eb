"""The boxes of a JPEG XL file: metadata are read and put in before the pixels.

Source: ISO/IEC 18181-2, "JPEG XL image coding system, file format", 2024, clause 9: boxes.
"""

import struct
from pathlib import Path

__all__ = ["jxl_boxes", "jxl_with"]

_SIGNATURE = b"\0\0\0\x0cJXL \r\n\x87\n"
_TYPE = b"\0\0\0\x14ftypjxl \0\0\0\0jxl "
_BARE = b"\xff\x0a"  # pixels without any box around them
_FIRST = (b"JXL ", b"ftyp", b"jxll")
_EXIF, _XMP = b"Exif", b"xml "
_LONGEST = 2**27  # bytes of metadata that are read


def jxl_boxes(path: Path) -> dict[bytes, bytes]:
    """Return the metadata by the names of their boxes, ``Exif`` and ``xml ``, beginning with their content.

    What is damaged or compressed once more is left out.
    """
    found: dict[bytes, bytes] = {}
    with path.open("rb") as file:
        if file.read(len(_SIGNATURE)) != _SIGNATURE:
            return found
        while len(head := file.read(8)) == 8:
            length, name = struct.unpack(">I4s", head)
            taken = 8
            if length == 1:
                length, taken = int.from_bytes(file.read(8), "big"), 16
            if length < taken or length > 2**62:  # 0: the last box, which holds pixels
                break
            if name in (_EXIF, _XMP) and length < _LONGEST:
                content = file.read(length - taken)
                if len(content) == length - taken:
                    found.setdefault(name, content)
            else:
                file.seek(length - taken, 1)
    if _EXIF in found:
        start = 4 + int.from_bytes(found[_EXIF][:4], "big")
        found[_EXIF] = found[_EXIF][start:]
    return found


def jxl_with(data: bytes, *, exif: bytes | None, xmp: bytes | None) -> bytes:
    """Return a JPEG XL file that has none with these metadata.

    Args:
        data: The file.
        exif: Beginning with its TIFF header.
        xmp: A packet.
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
