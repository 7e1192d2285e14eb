"""Whether a file is there, can be named to the decoders, is not cut off, and is no bomb."""

import os
import re
import struct
import zlib
from pathlib import Path

from bokehnet.errors import ImageFileError, ParameterError
from bokehnet.io.containers.tiff_extent import tiff_end

__all__ = ["PIXEL_LIMIT_VARIABLE", "check_intact", "check_name", "check_pixel_count"]

# A few kilobytes can tell of gigabytes of pixels: larger pictures are read only when they are expected.
PIXEL_LIMIT_VARIABLE = "BOKEHNET_MAX_PIXELS"
_MOST_PIXELS = 200_000_000

_JPEG_START, _JPEG_END = b"\xff\xd8", 0xD9
_ALONE = (0x01, 0xD8)  # markers without a length; those within a scan are not looked for
_MARKER = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]", re.DOTALL)

_PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"


def check_name(path: Path) -> None:
    """Raise unless the decoders can be given the name of this file."""
    try:
        str(path).encode()
    except UnicodeEncodeError as problem:
        raise ImageFileError(f"{os.fsencode(path)!r}: the name is not UTF-8; rename it") from problem


def check_intact(path: Path) -> None:
    """Raise ``ImageFileError`` unless ``path`` can be read and, as PNG, JPEG or TIFF, is whole."""
    check_name(path)
    if path.is_dir():
        raise ImageFileError(f"{path}: expected an image file, found a folder")
    if not path.exists():
        raise ImageFileError(f"{path}: no such file")
    if not path.is_file():
        raise ImageFileError(f"{path}: expected an image file, found something that is not a regular file")
    if not os.access(path, os.R_OK):
        raise ImageFileError(f"{path}: no permission to read this file")
    if path.stat().st_size == 0:
        raise ImageFileError(f"{path}: the file is empty (0 bytes)")
    _check_png(path)
    _check_jpeg(path)
    # Of a palette that is cut off the decoder makes up the rest.
    size = path.stat().st_size
    if tiff_end(path) > size:
        raise ImageFileError(f"{path}: the TIFF file is truncated at byte {size}")


def _check_png(path: Path) -> None:
    """Check lengths and checksums of a PNG file, because libpng tells of damage on stderr by itself."""
    size = path.stat().st_size
    with path.open("rb") as file:
        if file.read(8) != _PNG_SIGNATURE:
            return
        kind = b""
        while kind != b"IEND":
            head = file.read(8)
            length, kind = struct.unpack(">I4s", head) if len(head) == 8 else (size, b"")
            if file.tell() + length + 4 > size:
                raise ImageFileError(f"{path}: the PNG file is truncated at byte {size}")
            if zlib.crc32(file.read(length), zlib.crc32(kind)) != int.from_bytes(file.read(4), "big"):
                raise ImageFileError(f"{path}: the PNG file is damaged before byte {file.tell()}")


def _check_jpeg(path: Path) -> None:
    """Check that a JPEG file ends, because of a cut progressive one the decoder makes up the rest.

    Source: ITU-T T.81, annex B: segments tell their lengths, and scans end with the next marker.
    """
    with path.open("rb") as file:
        if file.read(2) != _JPEG_START:
            return
        file.seek(0)
        data = file.read()
    at = 2
    while found := _MARKER.search(data, at):
        at, kind = found.end(), found[0][-1]
        if kind == _JPEG_END:
            return
        if kind not in _ALONE:
            at += int.from_bytes(data[at : at + 2])
    raise ImageFileError(f"{path}: the JPEG file is truncated at byte {len(data)}")


def check_pixel_count(path: Path | str, width: int, height: int, what: str = "") -> None:
    """Raise ``ImageFileError`` if a header tells of more pixels than are allowed.

    Raises:
        ImageFileError: more than ``BOKEHNET_MAX_PIXELS`` in the environment, by default 200 million.
        ParameterError: that variable is no number.
    """
    text = os.environ.get(PIXEL_LIMIT_VARIABLE, "")
    try:
        most = int(float(text)) if text else _MOST_PIXELS
    except (ValueError, OverflowError) as problem:
        raise ParameterError(PIXEL_LIMIT_VARIABLE, "a number of pixels", text) from problem
    if width * height > most:
        found = f"{width} {what}" if what else f"{width}x{height} pixels"
        raise ImageFileError(
            f"{path}: {found} are more than the limit of {most}; "
            f"if that is right, raise {PIXEL_LIMIT_VARIABLE} in the environment"
        )
