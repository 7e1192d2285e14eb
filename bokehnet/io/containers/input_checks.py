"""Checks before decoding: existence, encodable name, truncation, pixel limit."""

import os
import re
import struct
import zlib
from pathlib import Path

from bokehnet.errors import ImageFileError, ParameterError
from bokehnet.io.containers.tiff_extent import tiff_end

__all__ = ["PIXEL_LIMIT_VARIABLE", "check_intact", "check_name", "check_pixel_count", "check_value_count"]

# A file of a few kilobytes can announce gigabytes of pixels: larger pictures need an explicit limit.
PIXEL_LIMIT_VARIABLE = "BOKEHNET_MAX_PIXELS"
_DEFAULT_MAX_PIXELS = 200_000_000

# Without it, small files are bounded further: pixels, and pixels for each byte of the file. Photographs and
# maps have over 0.05 bytes per pixel; an empty mask of 60 million pixels still passes.
_SMALL_FILE_PIXELS, _PIXELS_PER_BYTE = 64_000_000, 20

# Numbers of all channels and parts of a file, at least, and for each of its bytes.
_SMALL_FILE_VALUES, _VALUES_PER_BYTE = 400_000_000, 80

_JPEG_START, _JPEG_END = b"\xff\xd8", 0xD9
_NO_LENGTH = (0x01, 0xD8)  # markers without a length; restart markers within a scan are not searched
_MARKER = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]", re.DOTALL)

# Chunks that may be packed, and the upper bound of all of them together once unpacked.
_PACKED_CHUNKS, _MAX_UNPACKED_BYTES = (b"zTXt", b"iCCP", b"iTXt"), 2**24

_PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"


def check_name(path: Path) -> None:
    """Raise unless the name of this file can be passed to the decoders."""
    try:
        str(path).encode()
    except UnicodeEncodeError as problem:
        raise ImageFileError(f"{os.fsencode(path)!r}: the name is not UTF-8; rename it") from problem


def check_intact(path: Path) -> None:
    """Raise ``ImageFileError`` unless ``path`` is readable and, as PNG, JPEG or TIFF, complete."""
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
    # The decoder silently completes a truncated palette.
    size = path.stat().st_size
    if tiff_end(path) > size:
        raise ImageFileError(f"{path}: the TIFF file is truncated at byte {size}")


def _check_png(path: Path) -> None:
    """Check lengths, checksums and packed texts of a PNG file.

    libpng itself reports damage on stderr, and unpacks every text.
    """
    size, unpacked = path.stat().st_size, 0
    with path.open("rb") as file:
        if file.read(8) != _PNG_SIGNATURE:
            return
        kind = b""
        while kind != b"IEND":
            head = file.read(8)
            length, kind = struct.unpack(">I4s", head) if len(head) == 8 else (size, b"")
            if file.tell() + length + 4 > size:
                raise ImageFileError(f"{path}: the PNG file is truncated at byte {size}")
            content = file.read(length)
            if zlib.crc32(content, zlib.crc32(kind)) != int.from_bytes(file.read(4), "big"):
                raise ImageFileError(f"{path}: the PNG file is damaged before byte {file.tell()}")
            if kind in _PACKED_CHUNKS:
                unpacked += _unpacked_size(kind, content, _MAX_UNPACKED_BYTES - unpacked)
            if unpacked > _MAX_UNPACKED_BYTES:
                raise ImageFileError(
                    f"{path}: expected at most {_MAX_UNPACKED_BYTES} bytes of texts and profile once "
                    "unpacked, found more; remove the metadata"
                )


def _unpacked_size(kind: bytes, content: bytes, max_size: int) -> int:
    """Return the unpacked size of a text or profile chunk of PNG, at most ``max_size`` and one."""
    rest = content.partition(b"\0")[2]  # after the keyword
    if kind == b"iTXt":  # flag, method, language, translated keyword
        packed = rest[2:].split(b"\0", 2)[-1] if rest.startswith(b"\1") else b""
    else:
        packed = rest[1:]  # after the method
    try:
        return len(zlib.decompressobj().decompress(packed, max_size + 1))
    except zlib.error:
        return 0


def _check_jpeg(path: Path) -> None:
    """Check that a JPEG file is complete, because the decoder completes a truncated progressive one.

    Source: ITU-T T.81, annex B: segments contain their lengths, and scans end with the next marker.
    """
    with path.open("rb") as file:
        if file.read(2) != _JPEG_START:
            return
        file.seek(0)
        data = file.read()
    position = 2
    while match := _MARKER.search(data, position):
        position, kind = match.end(), match[0][-1]
        if kind == _JPEG_END:
            return
        if kind not in _NO_LENGTH:
            position += int.from_bytes(data[position : position + 2])
    raise ImageFileError(f"{path}: the JPEG file is truncated at byte {len(data)}")


def check_pixel_count(path: Path | str, width: int, height: int, unit: str = "") -> None:
    """Raise ``ImageFileError`` if a header announces more pixels than are allowed.

    Raises:
        ImageFileError: More than ``BOKEHNET_MAX_PIXELS`` in the environment, by default 200 million, or 64
            million and 20 for each byte of the file.
        ParameterError: That variable is not a number.
    """
    max_pixels = _max_pixels()
    if max_pixels is None:
        max_pixels = _DEFAULT_MAX_PIXELS
        if width * height <= max_pixels:
            max_pixels = min(max_pixels, _SMALL_FILE_PIXELS + _PIXELS_PER_BYTE * _size(path))
    if width * height > max_pixels:
        size = f"{width} {unit}" if unit else f"{width}x{height} pixels"
        raise ImageFileError(
            f"{path}: {size} are more than the limit of {max_pixels}; "
            f"if that is right, raise {PIXEL_LIMIT_VARIABLE} in the environment"
        )


def check_value_count(path: Path | str, count: int) -> None:
    """Raise ``ImageFileError`` if all channels and parts of a small file announce too many numbers.

    ``BOKEHNET_MAX_PIXELS`` in the environment lifts the bound if it is above 200 million.
    """
    max_count = _SMALL_FILE_VALUES + _VALUES_PER_BYTE * _size(path)
    if count > max_count and (_max_pixels() or 0) <= _DEFAULT_MAX_PIXELS:
        raise ImageFileError(
            f"{path}: {count} numbers in all channels are more than the limit of {max_count} for a file of "
            f"this size; if that is right, raise {PIXEL_LIMIT_VARIABLE} in the environment"
        )


def _size(path: Path | str) -> int:
    """Return the size of a file, bytes; 0 if it does not exist."""
    try:
        return os.stat(path).st_size
    except OSError:
        return 0


def _max_pixels() -> int | None:
    """Return the limit of the environment; None if it is not set."""
    text = os.environ.get(PIXEL_LIMIT_VARIABLE, "")
    try:
        return int(float(text)) if text else None
    except (ValueError, OverflowError) as problem:
        raise ParameterError(PIXEL_LIMIT_VARIABLE, "a number of pixels", text) from problem
