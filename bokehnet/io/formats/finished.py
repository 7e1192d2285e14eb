"""Check of existing outputs: whole, readable, and of the expected size, without decoding all pixels."""

import struct
from pathlib import Path

import OpenImageIO as oiio  # noqa: N813

from bokehnet.errors import BokehnetError
from bokehnet.io.formats.whole_picture import WHOLE_EXTENSIONS
from bokehnet.io.pixels import ImageFile

__all__ = ["is_finished"]

# Zero bytes at the end of a compressed picture that were never written: WebP decodes them without an error.
_MAX_ZERO_BYTES = 32


def is_finished(path: Path, source: Path | None = None, reduction: int = 1) -> bool:
    """Return whether a picture file is whole and readable, so that it need not be rendered again.

    Checks the lengths and checksums of PNG, the markers of JPEG, the extent of TIFF and the boxes of AVIF and
    HEIC; of other formats, the header and the last rows.

    Args:
        path: File to check.
        source: Picture of the same size, upright or rotated. Default: any size is right.
        reduction: Pixels of the source per pixel of the file along each axis.
    """
    if not path.is_file() or path.stat().st_size == 0:
        return False
    if path.suffix.lower() in WHOLE_EXTENSIONS:
        return _has_whole_boxes(path)
    if path.suffix.lower() == ".webp" and _ends_in_zeros(path):
        return False
    size = _size(path)
    if size is None or not _has_last_rows(path):
        return False
    expected = None if source is None else _size(source)
    if expected is None:
        return True
    same = (expected, expected[::-1])
    return any(abs(size[0] * reduction - w) < reduction > abs(size[1] * reduction - h) for w, h in same)


def _ends_in_zeros(path: Path) -> bool:
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - _MAX_ZERO_BYTES))
        return not any(file.read())


def _size(path: Path) -> tuple[int, int] | None:
    """Return width and height of the first part as stored; None if the file is damaged or unknown."""
    try:
        with ImageFile(path) as file:
            return file.parts[0].width, file.parts[0].height
    except BokehnetError:
        return None


def _has_last_rows(path: Path) -> bool:
    """Return whether the last rows of a file can be decoded."""
    picture = oiio.ImageInput.open(str(path))
    if picture is None:
        return path.suffix.lower() == ".pfm"  # whose length is checked with its header
    try:
        spec = picture.spec()
        end, kept = spec.y + spec.height, spec.tile_height or 1
        first = spec.y + (spec.height - 1) // kept * kept
        if spec.tile_width:
            across = spec.x + -(-spec.width // spec.tile_width) * spec.tile_width
            rows = picture.read_tiles(
                0, 0, spec.x, min(across, spec.x + spec.width), first, end, 0, 1, 0, 1, oiio.UNKNOWN
            )
        else:
            rows = picture.read_scanlines(0, 0, first, end, 0, 0, 1, oiio.UNKNOWN)
        return rows is not None and not picture.has_error
    finally:
        picture.close()
        oiio.geterror()


def _has_whole_boxes(path: Path) -> bool:
    """Return whether the boxes of a file in ISO base media format end with it.

    Source: ISO/IEC 14496-12, "ISO base media file format", 2022, 4.2.
    """
    position, size, kinds = 0, path.stat().st_size, set()
    with path.open("rb") as file:
        while position < size:
            file.seek(position)
            head = file.read(16)
            if len(head) < 8:
                return False
            length, kind = struct.unpack(">I4s", head[:8])
            if length == 1 and len(head) == 16:
                length = struct.unpack(">Q", head[8:])[0]
            length = length or size - position
            if length < 8:
                return False
            kinds.add(kind)
            position += length
    return position == size and {b"ftyp", b"meta", b"mdat"} <= kinds
