"""Items of HEIF files that decoders do not return: gain maps of ISO 21496-1.

Sources:
    ISO/IEC 14496-12, "ISO base media file format", 2022, 8.11: boxes ``meta``, ``pitm``, ``iinf``, ``iloc``,
    ``iref``. ISO/IEC 23008-12, "Image file format", amendment 1, 2024: derived items ``tmap``, whose inputs
    are the picture and its gain map.
"""

import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass

__all__ = ["ToneMapItem", "has_tone_map", "tone_map_item"]

_MAX_BOXES = 4096  # boxes or items of a file that are read


@dataclass(frozen=True, kw_only=True, slots=True)
class ToneMapItem:
    """Tone map item of a HEIF file.

    Attributes:
        metadata: Payload of the item: a version, then the metadata of ISO 21496-1, annex C.2.
        picture: The file with the gain map as its primary picture.
    """

    metadata: bytes
    picture: bytes


def has_tone_map(data: bytes) -> bool:
    """Return whether a HEIF file names a tone map item; reads only names.

    Examples:
        >>> has_tone_map(bytes(100))
        False
    """
    return re.search(rb"infe(?:\x02.{7}|\x03.{9})tmap", data, re.DOTALL) is not None


def tone_map_item(data: bytes) -> ToneMapItem | None:
    """Return the tone map of the primary picture of a HEIF file; None if there is none.

    Args:
        data: The file.

    Raises:
        ValueError: Boxes are damaged or refer to missing data.
    """
    try:
        return _tone_map_item(data)
    except (struct.error, KeyError, IndexError) as error:
        raise ValueError(f"damaged boxes: {error}") from error


def _tone_map_item(data: bytes) -> ToneMapItem | None:
    start, end = next(((a, b) for kind, a, b in _boxes(data, 0, len(data)) if kind == b"meta"), (0, 0))
    if not end:
        return None
    meta = {kind: (a, b) for kind, a, b in _boxes(data, start + 4, end)}
    entries = _entries(data, *meta[b"iinf"])
    maps = [item for item, (kind, _) in entries.items() if kind == b"tmap"]
    if not maps:
        return None
    references, primary = _derived_from(data, *meta[b"iref"]), _primary(data, *meta[b"pitm"])
    # A file may hold further pictures, which have tone maps of their own.
    number = next((item for item in maps if references.get(item, [primary])[0] == primary), None)
    if number is None:
        return None
    inputs = references.get(number, [])
    if len(inputs) < 2 or inputs[1] not in entries:
        raise ValueError("the tone map names no gain map")
    gain = inputs[1]
    patched = bytearray(data)
    at = meta[b"pitm"][0]
    struct.pack_into(">H" if data[at] == 0 else ">I", patched, at + 4, gain)
    patched[entries[gain][1] + 3] &= 0xFE  # no longer hidden
    return ToneMapItem(metadata=_payload(data, number, meta), picture=bytes(patched))


def _boxes(data: bytes, start: int, end: int) -> Iterator[tuple[bytes, int, int]]:
    """Yield type, start and end of the content of the boxes between two offsets."""
    for _ in range(_MAX_BOXES):
        if start + 8 > end:
            return
        size, kind = struct.unpack_from(">I4s", data, start)
        head = 8
        if size == 1:
            (size,), head = struct.unpack_from(">Q", data, start + 8), 16
        size = size or end - start
        if size < head or start + size > end:
            raise ValueError(f"the box {kind!r} ends outside of its container")
        yield kind, start + head, start + size
        start += size


def _entries(data: bytes, start: int, end: int) -> dict[int, tuple[bytes, int]]:
    """Return type and offset of the information of each item, by number."""
    first = start + (6 if data[start] == 0 else 8)
    entries = {}
    for kind, at, _ in _boxes(data, first, end):
        if kind == b"infe" and data[at] >= 2:
            number, _, name = struct.unpack_from(">HH4s" if data[at] == 2 else ">IH4s", data, at + 4)
            entries[number] = (name, at)
    return entries


def _primary(data: bytes, start: int, end: int) -> int:
    (number,) = struct.unpack_from(">H" if data[start] == 0 else ">I", data[:end], start + 4)
    return int(number)


def _derived_from(data: bytes, start: int, end: int) -> dict[int, list[int]]:
    """Return the inputs of derived items."""
    letter = "H" if data[start] == 0 else "I"
    inputs = {}
    for kind, at, stop in _boxes(data, start + 4, end):
        if kind == b"dimg":
            number, count = struct.unpack_from(f">{letter}H", data[:stop], at)
            first = at + struct.calcsize(f">{letter}H")
            inputs[number] = list(struct.unpack_from(f">{count}{letter}", data[:stop], first))
    return inputs


def _payload(data: bytes, number: int, meta: dict[bytes, tuple[int, int]]) -> bytes:
    """Return the data of an item."""
    at, end = meta[b"iloc"]
    version = data[at]
    sizes = struct.unpack_from(">H", data, at + 4)[0]
    offset_size, length_size, base_size, index_size = (sizes >> shift & 15 for shift in (12, 8, 4, 0))
    position = at + 6

    def read(size: int) -> int:
        nonlocal position
        if position + size > end:
            raise ValueError("the box b'iloc' is truncated")
        position += size
        return int.from_bytes(data[position - size : position], "big")

    wide = 4 if version == 2 else 2
    for _ in range(min(read(wide), _MAX_BOXES)):
        item, method = read(wide), read(2) & 15 if version else 0
        read(2)  # data reference
        base, extents = read(base_size), []
        for _ in range(read(2)):
            read(index_size if version else 0)
            extents.append((read(offset_size), read(length_size)))
        if item == number:
            if method > 1:
                raise ValueError("the tone map is stored by an unknown method")
            low, high = meta[b"idat"] if method else (0, len(data))
            parts = [(low + base + offset, length) for offset, length in extents]
            if any(first + length > high for first, length in parts):
                raise ValueError("the tone map ends outside of the file")
            return b"".join(data[first : first + length] for first, length in parts)
    raise ValueError("the tone map has no data")
