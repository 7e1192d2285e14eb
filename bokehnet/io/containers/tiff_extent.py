"""End of the pixel data of a TIFF file according to its pages."""

import os
import struct
from pathlib import Path
from typing import BinaryIO

__all__ = ["tiff_end"]

# First bytes, with byte order and whether it is BigTIFF.
_STARTS = {b"II*\0": ("<", False), b"MM\0*": (">", False), b"II+\0": ("<", True), b"MM\0+": (">", True)}

# Tags of the offsets and byte counts of strips and of tiles.
_DATA_TAGS = ((273, 279), (324, 325))

_READ_TAGS = tuple(tag for pair in _DATA_TAGS for tag in pair)

# Tags of the palette and of the tables shared by all JPEG strips.
_SHARED_TAGS = (320, 347)

# Integer types and plain bytes, as struct formats.
_NUMBERS = {3: "H", 4: "I", 7: "B", 16: "Q"}

# Files beyond these limits are left to the decoder.
_MAX_PAGES, _MAX_FIELDS, _MAX_VALUES = 1000, 4096, 10**7

# Fields of all pages, and values that are read of all of them: pages may overlap each other.
_MAX_ALL_FIELDS, _MAX_ALL_VALUES = 50_000, 2 * 10**7


def tiff_end(path: Path) -> int:
    """Return the end of all strips, tiles and palettes of a TIFF file; 0 for others, or if unknown.

    Source: Adobe, "TIFF, revision 6.0", 1992, section 2; BigTIFF as libtiff writes it.
    """
    with path.open("rb") as file:
        start = _STARTS.get(file.read(4))
        if start is None:
            return 0
        order, big = start
        try:
            pages = _pages(file, order, big)
            if (
                sum(fields[tag].count for fields in pages for tag in _READ_TAGS if tag in fields)
                > _MAX_ALL_VALUES
            ):
                return 0
            return max((end for fields in pages for end in _ends(file, fields)), default=0)
        except struct.error:  # a truncated page: decoders report that
            return 0


def _seek(file: BinaryIO, offset: int) -> None:
    """Seek to an offset from the file; an offset beyond its end raises like truncated data."""
    if offset > os.fstat(file.fileno()).st_size:
        raise struct.error("beyond the end of the file")
    file.seek(offset)


def _unpack(file: BinaryIO, form: str) -> tuple[int, ...]:
    values: tuple[int, ...] = struct.unpack(form, file.read(struct.calcsize(form)))
    return values


class _Field:
    """Integers of a page at an offset in the file."""

    def __init__(self, order: str, kind: int, count: int, offset: int) -> None:
        self.form, self.offset, self.count = f"{order}{count}{_NUMBERS[kind]}", offset, count

    @property
    def end(self) -> int:
        """Offset of the first byte after the field."""
        return self.offset + struct.calcsize(self.form)

    def read(self, file: BinaryIO) -> tuple[int, ...]:
        _seek(file, self.offset)
        return _unpack(file, self.form)


def _pages(file: BinaryIO, order: str, big: bool) -> list[dict[int, _Field]]:
    """Return the integer fields of each page, by tag."""
    word, count_form, entry = ("Q", "Q", 20) if big else ("I", "H", 12)
    if big:
        file.seek(8)
    (start,) = _unpack(file, order + word)
    pages: list[dict[int, _Field]] = []
    seen: set[int] = set()
    while start and start not in seen and len(pages) < _MAX_PAGES and sum(map(len, pages)) < _MAX_ALL_FIELDS:
        seen.add(start)
        _seek(file, start)
        (number,) = _unpack(file, order + count_form)
        if number > _MAX_FIELDS:
            break
        first, fields = file.tell(), {}
        for offset in range(first, first + number * entry, entry):
            file.seek(offset)
            tag, kind, count = _unpack(file, f"{order}HH{word}")
            if kind in _NUMBERS and count <= _MAX_VALUES:
                inline = count * struct.calcsize(order + _NUMBERS[kind]) <= struct.calcsize(order + word)
                value_offset = file.tell() if inline else _unpack(file, order + word)[0]
                fields[tag] = _Field(order, kind, count, value_offset)
        pages.append(fields)
        file.seek(first + number * entry)
        (start,) = _unpack(file, order + word)
    return pages


def _ends(file: BinaryIO, fields: dict[int, _Field]) -> list[int]:
    """Return the ends of the strips, tiles and palette of a page."""
    ends = [fields[tag].end for tag in _SHARED_TAGS if tag in fields]
    for starts, lengths in _DATA_TAGS:
        if starts in fields and lengths in fields:
            extents = zip(fields[starts].read(file), fields[lengths].read(file), strict=False)
            ends += [start + length for start, length in extents]
    return ends
