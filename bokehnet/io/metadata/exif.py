"""EXIF and TIFF directories: read, patch in place, and write.

Source: CIPA DC-008, "Exchangeable image file format (Exif)", 2019; Aldus, "TIFF revision 6.0", 1992.
"""

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from mmap import mmap

__all__ = [
    "COLOR_PROFILE",
    "XMP_PACKET",
    "Entry",
    "append_tags",
    "describing_tags",
    "exif_of_tiff",
    "is_adobe_rgb",
    "maker_note",
    "read_directory",
    "refreshed_exif",
    "tiff_order",
]

Directory = dict[int, "Entry"]

XMP_PACKET, COLOR_PROFILE = 0x02BC, 0x8773

_ORIENTATION, _DATE = 0x0112, 0x0132
_EXIF, _GPS, _INTEROPERABILITY = 0x8769, 0x8825, 0xA005
_SUB = (_EXIF, _GPS, _INTEROPERABILITY)
_COLOR_SPACE, _WIDTH, _HEIGHT, _MAKER_NOTE = 0xA001, 0xA002, 0xA003, 0x927C
_INTEROPERABILITY_INDEX = 0x0001
_THUMBNAIL, _THUMBNAIL_LENGTH = 0x0201, 0x0202

# Tags of a TIFF directory that describe the photograph, not its pixel layout: ImageDescription, Make,
# Model, resolution, Software, DateTime, Artist, Rating, IPTC, Copyright, and the sub-directories.
_DESCRIPTIVE = (
    *(0x010E, 0x010F, 0x0110, 0x011A, 0x011B, 0x0128, 0x0131, 0x0132, 0x013B, 0x4746, 0x4749),
    *(0x83BB, 0x8298, _EXIF, _GPS),
)

# Struct format of a value of each type; its size is the size of the value.
_TYPE_FORMATS = {
    1: "B",
    2: "s",
    3: "H",
    4: "I",
    5: "II",
    6: "b",
    7: "s",
    8: "h",
    9: "i",
    10: "ii",
    11: "f",
    12: "d",
}
_TYPE_FORMATS |= {13: "I"}

_OFFSETS = (3, 4, 13)

# Upper bounds of a directory: tags, and bytes of all their values.
_MAX_ENTRIES, _MAX_VALUE_BYTES = 2000, 2**26
_IS_SRGB, _UNCALIBRATED = 1, 0xFFFF


@dataclass(frozen=True, slots=True)
class Entry:
    """A tag of a directory.

    Attributes:
        kind: Type of its values, 1 to 13.
        values: Numbers, in pairs for fractions; bytes for text and unknown types.
        offset: Position of the values in the file.
        sub: Sub-directory that the tag points to, or None.
    """

    kind: int
    values: tuple[float, ...] | bytes
    offset: int = 0
    sub: Directory | None = None

    @property
    def text(self) -> str:
        """The value as text; empty for numbers."""
        return self.values.rstrip(b"\0 ").decode("latin-1") if isinstance(self.values, bytes) else ""

    @property
    def number(self) -> float:
        """The first number; NaN for text and empty values."""
        return self.values[0] if self.values and not isinstance(self.values, bytes) else float("nan")


def tiff_order(data: bytes | mmap) -> str:
    """Return the byte order, ``"<"`` or ``">"``, of a TIFF structure.

    Raises:
        ValueError: The data do not begin with a TIFF structure.
    """
    orders = {b"II*\0": "<", b"MM\0*": ">"}
    if bytes(data[:4]) not in orders:
        raise ValueError("no TIFF structure begins there")
    return orders[bytes(data[:4])]


def read_directory(data: bytes | mmap, start: int | None = None, depth: int = 2) -> tuple[Directory, int]:
    """Read a directory and its sub-directories: EXIF, GPS and interoperability.

    Args:
        data: TIFF structure, such as EXIF, as bytes or a sliceable buffer.
        start: Offset of the directory; default: the first one.
        depth: Levels of sub-directories to read.

    Returns:
        Tags and their values; offset of the next directory, 0 for none.

    Raises:
        ValueError: The directory is damaged.
    """
    order = tiff_order(data)
    try:
        if start is None:
            (start,) = struct.unpack(f"{order}I", data[4:8])
        (count,) = struct.unpack(f"{order}H", data[start : start + 2])
        if count > _MAX_ENTRIES:
            raise ValueError(f"a directory of {count} tags")
        directory: Directory = {}
        total = 0
        for index in range(count):
            offset = start + 2 + 12 * index
            tag, kind, number = struct.unpack(f"{order}HHI", data[offset : offset + 8])
            letters = _TYPE_FORMATS.get(kind, "s")
            size = struct.calcsize(f"={letters}") * number
            offset += 8
            if size > 4:
                (offset,) = struct.unpack(f"{order}I", data[offset : offset + 4])
            if offset + size > len(data):
                continue  # one damaged tag does not invalidate the others
            total += size
            if total > _MAX_VALUE_BYTES:
                raise ValueError(f"a directory of over {_MAX_VALUE_BYTES} bytes")
            content = bytes(data[offset : offset + size])
            values: tuple[float, ...] | bytes = content
            if letters != "s":
                values = struct.unpack(f"{order}{letters * number}", content)
            sub = None
            if (
                tag in _SUB
                and tag not in directory
                and depth
                and values
                and kind in _OFFSETS
                and not isinstance(values, bytes)
            ):
                sub = read_directory(data, int(values[0]), depth - 1)[0]
            directory[tag] = Entry(kind, values, offset, sub)
        end = start + 2 + 12 * count
        following = data[end : end + 4]
        return directory, struct.unpack(f"{order}I", following)[0] if len(following) == 4 else 0
    except struct.error as problem:
        raise ValueError("a directory is cut short") from problem


def is_adobe_rgb(exif: bytes) -> bool:
    """Return whether EXIF marks a picture without profile as Adobe RGB.

    Source: JEITA CP-3461, "Design rule for camera file system (DCF)", 2003: an optional file, index R03.
    """
    try:
        exif_entry = read_directory(exif)[0].get(_EXIF)
    except ValueError:
        return False
    fields = (exif_entry.sub if exif_entry else None) or {}
    space, interoperability = fields.get(_COLOR_SPACE), fields.get(_INTEROPERABILITY)
    index = ((interoperability.sub if interoperability else None) or {}).get(_INTEROPERABILITY_INDEX)
    return space is not None and space.number != _IS_SRGB and index is not None and index.text == "R03"


def maker_note(exif: bytes) -> bytes:
    """Return the maker note of a photograph; empty if there is none or its directory is damaged."""
    try:
        exif_entry = read_directory(exif)[0].get(_EXIF)
    except ValueError:
        return b""
    note = ((exif_entry.sub if exif_entry else None) or {}).get(_MAKER_NOTE)
    return note.values if note is not None and isinstance(note.values, bytes) else b""


def refreshed_exif(exif: bytes, width: int, height: int, *, is_srgb: bool | None) -> bytes:
    """Return the EXIF of a photograph adapted to its upright, blurred version; all other bytes are kept.

    The orientation becomes 1, the size that of the picture, the colour space as in ``is_srgb``; the
    thumbnail, which shows the original picture, is removed.

    Args:
        exif: EXIF that begins with its TIFF header.
        width: Width of the picture, pixels.
        height: Height of the picture, pixels.
        is_srgb: True for sRGB, False for another colour space, None for the original one.

    Raises:
        ValueError: The EXIF is damaged.
    """
    order = tiff_order(exif)
    main, next_start = read_directory(exif)
    data = bytearray(exif)

    def put(entry: Entry | None, value: int) -> None:
        if entry is not None and entry.kind in (3, 4):
            struct.pack_into(f"{order}{_TYPE_FORMATS[entry.kind]}", data, entry.offset, value)

    put(main.get(_ORIENTATION), 1)
    exif_entry = main.get(_EXIF)
    fields = (exif_entry.sub if exif_entry else None) or {}
    put(fields.get(_WIDTH), width)
    put(fields.get(_HEIGHT), height)
    if is_srgb is not None:
        put(fields.get(_COLOR_SPACE), _IS_SRGB if is_srgb else _UNCALIBRATED)
    if next_start:
        thumbnail = read_directory(exif, next_start)[0]
        count = struct.unpack_from(f"{order}H", data, start := struct.unpack_from(f"{order}I", data, 4)[0])[0]
        struct.pack_into(f"{order}I", data, start + 2 + 12 * count, 0)
        first = thumbnail.get(_THUMBNAIL, Entry(4, ())).number
        length = thumbnail.get(_THUMBNAIL_LENGTH, Entry(4, ())).number
        if first > 0 and length > 0 and first + length <= len(data):
            data[int(first) : int(first + length)] = bytes(int(length))
            if first + length >= len(data) - 1:  # most thumbnails are at the end
                del data[int(first) :]
    return bytes(data)


def describing_tags(directory: Directory) -> Directory:
    """Return the tags that describe the photograph, with their sub-directories.

    Maker notes are omitted: they contain offsets into their original file.
    """

    def without_maker_notes(tags: Directory) -> Directory:
        return {
            tag: Entry(entry.kind, entry.values, 0, without_maker_notes(entry.sub) if entry.sub else None)
            for tag, entry in tags.items()
            if tag != _MAKER_NOTE and (entry.sub is not None or tag not in _SUB)
        }

    return without_maker_notes({tag: entry for tag, entry in directory.items() if tag in _DESCRIPTIVE})


def exif_of_tiff(directory: Directory) -> bytes | None:
    """Return EXIF with the descriptive tags of a TIFF directory; None if there are none."""
    tags = describing_tags(directory)
    if not tags:
        return None
    return b"II*\0" + struct.pack("<I", 8) + _packed(tags, 8)


def append_tags(data: bytes | mmap, length: int, tags: Mapping[int, Entry]) -> tuple[bytes, int]:
    """Return the bytes to append to a TIFF file so that its first directory has additional tags.

    Args:
        data: Content of the file, least significant byte first, as bytes or a sliceable buffer.
        length: Length of the file, even.
        tags: Additional tags; they replace existing ones. An existing empty date is dropped.

    Returns:
        Bytes to append, and the offset of the new directory for the header.

    Raises:
        ValueError: The file is not a plain little-endian TIFF file.
    """
    if tiff_order(data) != "<":
        raise ValueError("the most significant byte comes first")
    existing, next_start = read_directory(data, depth=0)
    if _DATE in existing and not existing[_DATE].text:
        del existing[_DATE]
    return _packed({**existing, **tags}, length, next_start), length


def _packed(tags: Mapping[int, Entry], start: int, next_start: int = 0) -> bytes:
    """Return a directory and its values as bytes for the offset ``start``."""
    table = b""
    end = start + 2 + 12 * len(tags) + 4
    body = b""
    for tag in sorted(tags):
        entry = tags[tag]
        values, kind = entry.values, entry.kind
        if entry.sub is not None:
            values, kind = (end + len(body),), 4
            body += _packed(entry.sub, end + len(body))
        if isinstance(values, bytes):
            size = struct.calcsize(f"={_TYPE_FORMATS.get(kind, 's')}")
            count, content = len(values) // size, values
        else:
            letters = _TYPE_FORMATS[kind]
            count = len(values) // len(letters)
            content = struct.pack(f"<{letters * count}", *values)
        if len(content) <= 4:
            field = content.ljust(4, b"\0")
        else:
            field = struct.pack("<I", end + len(body))
            body += content + bytes(len(content) % 2)
        table += struct.pack("<HHI", tag, kind, count) + field
    return struct.pack("<H", len(tags)) + table + struct.pack("<I", next_start) + body
