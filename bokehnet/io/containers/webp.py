"""Chunks of a WebP file: read metadata, and insert profile and metadata.

Source: RFC 9649, "WebP Image Format", 2024, 2.7: extended file format.
"""

import struct
from pathlib import Path

__all__ = ["webp_chunks", "webp_with"]

_ICC, _ALPHA, _EXIF, _XMP = 0x20, 0x10, 0x08, 0x04
_MAX_METADATA_BYTES = 2**27


def webp_chunks(path: Path) -> dict[bytes, bytes]:
    """Return the metadata chunks by name: ``EXIF``, ``XMP ``; damage ends the search."""
    chunks = {}
    with path.open("rb") as file:
        file.seek(12)
        while len(head := file.read(8)) == 8:
            name, length = struct.unpack("<4sI", head)
            if name in (b"EXIF", b"XMP ") and length < _MAX_METADATA_BYTES:
                chunks[name] = file.read(length)
                file.seek(length % 2, 1)
            else:
                file.seek(length + length % 2, 1)
    return chunks


def webp_with(
    data: bytes, width: int, height: int, *, icc: bytes | None, exif: bytes | None, xmp: bytes | None
) -> bytes:
    """Return a WebP file with profile and metadata in place of its own.

    Args:
        data: Content of the file.
        width: Width of the picture, pixels.
        height: Height of the picture, pixels.
        icc: Colour profile.
        exif: EXIF that begins with its TIFF header.
        xmp: XMP packet.
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
            # Bit 28 after the signature of a lossless stream marks alpha.
            lossless_alpha = name == b"VP8L" and content[4] & 0x10
            flags |= _ALPHA if name == b"ALPH" or lossless_alpha else 0
        position += 8 + length + length % 2
    metadata = [(b"ICCP", icc, _ICC), (b"EXIF", exif, _EXIF), (b"XMP ", xmp, _XMP)]
    for _, packet, flag in metadata:
        flags |= flag if packet else 0
    size = (width - 1).to_bytes(3, "little") + (height - 1).to_bytes(3, "little")
    chunks = [(b"VP8X", struct.pack("<I", flags) + size)]
    chunks += [(name, packet) for name, packet, _ in metadata[:1] if packet]
    chunks += pixels
    chunks += [(name, packet) for name, packet, _ in metadata[1:] if packet]
    body = b"".join(
        struct.pack("<4sI", name, len(content)) + content + bytes(len(content) % 2)
        for name, content in chunks
    )
    return struct.pack("<4sI4s", b"RIFF", 4 + len(body), b"WEBP") + body
