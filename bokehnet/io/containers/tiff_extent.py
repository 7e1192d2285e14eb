"""Where what the pixels of a TIFF file are made of ends, by what its pages say."""

import os
import struct
from pathlib import Path
from typing import BinaryIO

__all__ = ["tiff_end"]

# First bytes and how numbers are written: classic TIFF and BigTIFF, in both orders of bytes.
_STARTS = {b"II*\0": ("<", False), b"MM\0*": (">", False), b"II+\0": ("<", True), b"MM\0+": (">", True)}

# Tags of where strips and tiles begin, and of how long they are.
_PARTS = ((273, 279), (324, 325))

# Tags of the palette and of what all JPEG strips share.
_SHARED = (320, 347)

# Types of whole numbers, and of plain bytes, as struct has them.
_NUMBERS = {3: "H", 4: "I", 7: "B", 16: "Q"}

# More pages, fields of a page or parts of a picture are left to the decoder.
_MOST_PAGES, _MOST_FIELDS, _MOST_PARTS = 1000, 4096, 10**7


def tiff_end(path: Path) -> int:
    """First byte behind all strips, tiles and palettes of a TIFF file; 0 for others, or where it is not told.

    Source: Adobe, "TIFF, revision 6.0", 1992, section 2; BigTIFF as libtiff writes it.
    """
    with path.open("rb") as file:
        start = _STARTS.get(file.read(4))
        if start is None:
            return 0
        order, big = start
        try:
            return max((end for fields in _pages(file, order, big) for end in _ends(file, fields)), default=0)
        except struct.error:  # a page that is cut off: decoders tell of that
            return 0


def _seek(file: BinaryIO, place: int) -> None:
    """Go to a place that the file names; beyond its end is as if cut off: not every number is a position."""
    if place > os.fstat(file.fileno()).st_size:
        raise struct.error("beyond the end of the file")
    file.seek(place)


def _unpack(file: BinaryIO, form: str) -> tuple[int, ...]:
    found: tuple[int, ...] = struct.unpack(form, file.read(struct.calcsize(form)))
    return found


class _Field:
    """Whole numbers of a page, at some place of the file."""

    def __init__(self, order: str, kind: int, count: int, at: int) -> None:
        self.form, self.at = f"{order}{count}{_NUMBERS[kind]}", at

    @property
    def end(self) -> int:
        """First byte behind it."""
        return self.at + struct.calcsize(self.form)

    def read(self, file: BinaryIO) -> tuple[int, ...]:
        _seek(file, self.at)
        return _unpack(file, self.form)


def _pages(file: BinaryIO, order: str, big: bool) -> list[dict[int, _Field]]:
    """The fields of each page that hold whole numbers, by tag."""
    word, count_form, entry = ("Q", "Q", 20) if big else ("I", "H", 12)
    if big:
        file.seek(8)
    (at,) = _unpack(file, order + word)
    pages: list[dict[int, _Field]] = []
    seen: set[int] = set()
    while at and at not in seen and len(pages) < _MOST_PAGES:
        seen.add(at)
        _seek(file, at)
        (number,) = _unpack(file, order + count_form)
        if number > _MOST_FIELDS:
            break
        first, fields = file.tell(), {}
        for place in range(first, first + number * entry, entry):
            file.seek(place)
            tag, kind, count = _unpack(file, f"{order}HH{word}")
            if kind in _NUMBERS and count <= _MOST_PARTS:
                inside = count * struct.calcsize(order + _NUMBERS[kind]) <= struct.calcsize(order + word)
                where = file.tell() if inside else _unpack(file, order + word)[0]
                fields[tag] = _Field(order, kind, count, where)
        pages.append(fields)
        file.seek(first + number * entry)
        (at,) = _unpack(file, order + word)
    return pages


def _ends(file: BinaryIO, fields: dict[int, _Field]) -> list[int]:
    """Where the strips, tiles and palette of a page end."""
    ends = [fields[tag].end for tag in _SHARED if tag in fields]
    for starts, lengths in _PARTS:
        if starts in fields and lengths in fields:
            places = zip(fields[starts].read(file), fields[lengths].read(file), strict=False)
            ends += [start + length for start, length in places]
    return ends
