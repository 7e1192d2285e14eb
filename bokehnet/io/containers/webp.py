"""The chunks of a WebP file: profile and metadata are read and put in beside the pixels.

Source: RFC 9649, "WebP Image Format", 2024, 2.7: extended file format.
"""

import struct
from pathlib import Path

__all__ = ["webp_chunks", "webp_with"]

_ICC, _ALPHA, _EXIF, _XMP = 0x20, 0x10, 0x08, 0x04
_LONGEST = 2**27  # bytes of metadata that are read


def webp_chunks(path: Path) -> dict[bytes, bytes]:
    """Return the chunks of metadata by their names: ``EXIF``, ``XMP``; what is damaged ends the search."""
    found = {}
    with path.open("rb") as file:
        file.seek(12)
        while len(head := file.read(8)) == 8:
            name, length = struct.unpack("<4sI", head)
            if name in (b"EXIF", b"XMP ") and length < _LONGEST:
                found[name] = file.read(length)
                file.seek(length % 2, 1)
            else:
                file.seek(length + length % 2, 1)
    return found


def webp_with(
    data: bytes, width: int, height: int, *, icc: bytes | None, exif: bytes | None, xmp: bytes | None
) -> bytes:
    """Return a WebP file with profile and metadata in the place of those that it has.

    Args:
        data: The file.
        width: Of the picture.
        height: Of the picture.
        icc: Colour profile.
        exif: Beginning with its TIFF header.
        xmp: A packet.
    """
    pixels: list[tuple[bytes, bytes]] = []
    flags, position = 0, 12
    while position + 8 <= len(data):
        name, length = struct.unpack_from("<4sI", data, position)
        content = data[position + 8 : position + 8 + length]
        if name == b"VP8X":
            flags |= content[0] & _ALPHA
        elif name not in (b"ICCP", b"EXIF", b"XMP "):
            pixels.append((name, content))
            # The alpha of a lossless stream is told by bit 28 behind its signature.
            lossless_alpha = name == b"VP8L" and content[4] & 0x10
            flags |= _ALPHA if name == b"ALPH" or lossless_alpha else 0
        position += 8 + length + length % 2
    given = [(b"ICCP", icc, _ICC), (b"EXIF", exif, _EXIF), (b"XMP ", xmp, _XMP)]
    for _, held, flag in given:
        flags |= flag if held else 0
    size = (width - 1).to_bytes(3, "little") + (height - 1).to_bytes(3, "little")
    chunks = [(b"VP8X", struct.pack("<I", flags) + size)]
    chunks += [(name, held) for name, held, _ in given[:1] if held]
    chunks += pixels
    chunks += [(name, held) for name, held, _ in given[1:] if held]
    body = b"".join(
        struct.pack("<4sI", name, len(content)) + content + bytes(len(content) % 2)
        for name, content in chunks
    )
    return struct.pack("<4sI4s", b"RIFF", 4 + len(body), b"WEBP") + body
