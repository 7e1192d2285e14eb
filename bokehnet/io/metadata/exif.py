"""EXIF and TIFF directories: read, patched where they stand, and written anew.

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

# What a directory of a TIFF file tells of the photograph, not of how its pixels lie: ImageDescription, Make,
# Model, resolution, Software, DateTime, Artist, Rating, IPTC, Copyright, and those below.
_DESCRIBING = (
    *(0x010E, 0x010F, 0x0110, 0x011A, 0x011B, 0x0128, 0x0131, 0x0132, 0x013B, 0x4746, 0x4749),
    *(0x83BB, 0x8298, _EXIF, _GPS),
)

# Bytes of a value of each type, and its letter for struct.
_TYPES = {1: "B", 2: "s", 3: "H", 4: "I", 5: "II", 6: "b", 7: "s", 8: "h", 9: "i", 10: "ii", 11: "f", 12: "d"}
_TYPES |= {13: "I"}

_OFFSETS = (3, 4, 13)

_MOST_ENTRIES = 2000
_IS_SRGB, _UNCALIBRATED = 1, 0xFFFF


@dataclass(frozen=True, slots=True)
class Entry:
    """A tag of a directory.

    Attributes:
        kind: Type of its values, 1 to 13.
        values: Numbers, in pairs for fractions; bytes where they are text or of no known type.
        place: Where the values lie in the file.
        sub: The directory that it points to, if it does.
    """

    kind: int
    values: tuple[float, ...] | bytes
    place: int = 0
    sub: Directory | None = None

    @property
    def text(self) -> str:
        """The value as text; empty if it is none."""
        return self.values.rstrip(b"\0 ").decode("latin-1") if isinstance(self.values, bytes) else ""

    @property
    def number(self) -> float:
        """The first number; NaN if there is none."""
        return self.values[0] if self.values and not isinstance(self.values, bytes) else float("nan")


def tiff_order(data: bytes | mmap) -> str:
    """Return the order of bytes, ``"<"`` or ``">"``, of a TIFF structure.

    Raises:
        ValueError: No such structure begins there.
    """
    orders = {b"II*\0": "<", b"MM\0*": ">"}
    if bytes(data[:4]) not in orders:
        raise ValueError("no TIFF structure begins there")
    return orders[bytes(data[:4])]


def read_directory(data: bytes | mmap, start: int | None = None, deep: int = 2) -> tuple[Directory, int]:
    """Read a directory and those below it: EXIF, GPS and interoperability.

    Args:
        data: A TIFF structure, as EXIF is one, or anything that can be cut like bytes.
        start: Where the directory lies; by default it is the first one.
        deep: How far below.

    Returns:
        Tags and what they hold; where the next directory lies, 0 for none.

    Raises:
        ValueError: It is damaged.
    """
    order = tiff_order(data)
    try:
        if start is None:
            (start,) = struct.unpack(f"{order}I", data[4:8])
        (count,) = struct.unpack(f"{order}H", data[start : start + 2])
        if count > _MOST_ENTRIES:
            raise ValueError(f"a directory of {count} tags")
        found: Directory = {}
        for index in range(count):
            place = start + 2 + 12 * index
            tag, kind, number = struct.unpack(f"{order}HHI", data[place : place + 8])
            letters = _TYPES.get(kind, "s")
            size = struct.calcsize(f"={letters}") * number
            place += 8
            if size > 4:
                (place,) = struct.unpack(f"{order}I", data[place : place + 4])
            content = bytes(data[place : place + size])
            if len(content) < size:
                continue  # one damaged tag does not spoil the others
            values: tuple[float, ...] | bytes = content
            if letters != "s":
                values = struct.unpack(f"{order}{letters * number}", content)
            sub = None
            if tag in _SUB and deep and values and kind in _OFFSETS and not isinstance(values, bytes):
                sub = read_directory(data, int(values[0]), deep - 1)[0]
            found[tag] = Entry(kind, values, place, sub)
        end = start + 2 + 12 * count
        after = data[end : end + 4]
        return found, struct.unpack(f"{order}I", after)[0] if len(after) == 4 else 0
    except struct.error as problem:
        raise ValueError("a directory is cut short") from problem


def is_adobe_rgb(exif: bytes) -> bool:
    """Whether a camera says that its picture is Adobe RGB, as it does without a profile.

    Source: JEITA CP-3461, "Design rule for camera file system (DCF)", 2003: an optional file, index R03.
    """
    try:
        below = read_directory(exif)[0].get(_EXIF)
    except ValueError:
        return False
    fields = (below.sub if below else None) or {}
    space, interoperability = fields.get(_COLOR_SPACE), fields.get(_INTEROPERABILITY)
    index = ((interoperability.sub if interoperability else None) or {}).get(_INTEROPERABILITY_INDEX)
    return space is not None and space.number != _IS_SRGB and index is not None and index.text == "R03"


def refreshed_exif(exif: bytes, width: int, height: int, *, is_srgb: bool | None) -> bytes:
    """Return EXIF of a photograph for its upright, blurred twin: patched in place, so that all else holds.

    The orientation becomes 1, the size that of the picture, the colour space what is told; the thumbnail,
    which shows the picture as it was, goes.

    Args:
        exif: Beginning with its TIFF header.
        width: Of the picture.
        height: Of the picture.
        is_srgb: Whether its colours are sRGB; None where they are what they were.

    Raises:
        ValueError: It is damaged.
    """
    order = tiff_order(exif)
    main, after = read_directory(exif)
    data = bytearray(exif)

    def put(entry: Entry | None, value: int) -> None:
        if entry is not None and entry.kind in (3, 4):
            struct.pack_into(f"{order}{_TYPES[entry.kind]}", data, entry.place, value)

    put(main.get(_ORIENTATION), 1)
    below = main.get(_EXIF)
    fields = (below.sub if below else None) or {}
    put(fields.get(_WIDTH), width)
    put(fields.get(_HEIGHT), height)
    if is_srgb is not None:
        put(fields.get(_COLOR_SPACE), _IS_SRGB if is_srgb else _UNCALIBRATED)
    if after:
        thumbnail = read_directory(exif, after)[0]
        count = struct.unpack_from(f"{order}H", data, start := struct.unpack_from(f"{order}I", data, 4)[0])[0]
        struct.pack_into(f"{order}I", data, start + 2 + 12 * count, 0)
        first = thumbnail.get(_THUMBNAIL, Entry(4, ())).number
        length = thumbnail.get(_THUMBNAIL_LENGTH, Entry(4, ())).number
        if first > 0 and length > 0 and first + length <= len(data):
            data[int(first) : int(first + length)] = bytes(int(length))
            if first + length >= len(data) - 1:  # most stand at the end
                del data[int(first) :]
    return bytes(data)


def describing_tags(directory: Directory) -> Directory:
    """Return the tags that tell of the photograph, with those below them.

    Notes of the maker are left out: they point to places in the file that they stood in.
    """

    def without_notes(tags: Directory) -> Directory:
        return {
            tag: Entry(entry.kind, entry.values, 0, without_notes(entry.sub) if entry.sub else None)
            for tag, entry in tags.items()
            if tag != _MAKER_NOTE and (entry.sub is not None or tag not in _SUB)
        }

    return without_notes({tag: entry for tag, entry in directory.items() if tag in _DESCRIBING})


def exif_of_tiff(directory: Directory) -> bytes | None:
    """Return EXIF that says what the directory of a TIFF file says; None if it says nothing."""
    tags = describing_tags(directory)
    if not tags:
        return None
    return b"II*\0" + struct.pack("<I", 8) + _packed(tags, 8)


def append_tags(data: bytes | mmap, length: int, tags: Mapping[int, Entry]) -> tuple[bytes, int]:
    """Return what to append to a TIFF file so that its first directory has further tags.

    Args:
        data: The file, or anything that can be cut like its bytes; least significant byte first.
        length: Of the file, even.
        tags: What is added; they prevail over those that are there, of which an empty date goes.

    Returns:
        The bytes, and where the new directory lies, which the header has to tell.

    Raises:
        ValueError: It is no plain TIFF file of that order.
    """
    if tiff_order(data) != "<":
        raise ValueError("the most significant byte comes first")
    here, after = read_directory(data, deep=0)
    if _DATE in here and not here[_DATE].text:
        del here[_DATE]
    return _packed({**here, **tags}, length, after), length


def _packed(tags: Mapping[int, Entry], start: int, after: int = 0) -> bytes:
    """Write a directory and what belongs to it as bytes that will lie at ``start``."""
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
            size = struct.calcsize(f"={_TYPES.get(kind, 's')}")
            count, content = len(values) // size, values
        else:
            letters = _TYPES[kind]
            count = len(values) // len(letters)
            content = struct.pack(f"<{letters * count}", *values)
        if len(content) <= 4:
            place = content.ljust(4, b"\0")
        else:
            place = struct.pack("<I", end + len(body))
            body += content + bytes(len(content) % 2)
        table += struct.pack("<HHI", tag, kind, count) + place
    return struct.pack("<H", len(tags)) + table + struct.pack("<I", after) + body
