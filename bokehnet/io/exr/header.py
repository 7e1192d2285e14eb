"""Stored headers of an OpenEXR file: attributes by name, with their types and bytes.

The decoder renames and drops some attributes; this module keeps all of them. It decodes no pixels.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from bokehnet.errors import ImageFileError

__all__ = [
    "Attribute",
    "ExrHeaders",
    "Value",
    "channel_list",
    "channel_sizes",
    "is_exr",
    "read_headers",
    "sub_sampled",
    "with_channels",
]

Value = float | str | tuple[float, ...]

_MAGIC = b"\x76\x2f\x31\x01"
_TILED, _LONG_NAMES, _DEEP, _MULTI_PART = 0x200, 0x400, 0x800, 0x1000
_MAX_NAME_BYTES = 255

# Upper bounds of a file: the time of the decoder grows with the square of each.
_MAX_PARTS, _MAX_ATTRIBUTES, _MAX_CHANNELS = 512, 8192, 4096
_NUMBERS = {
    "int": "<i",
    "float": "<f",
    "double": "<d",
    "v2i": "<2i",
    "v2f": "<2f",
    "v2d": "<2d",
    "box2i": "<4i",
    "rational": "<iI",
}


@dataclass(frozen=True)
class Attribute:
    """Attribute with the name of its type and its bytes."""

    kind: str
    data: bytes

    def value(self) -> Value | None:
        """Return the number, numbers or text; None for other types. A rational becomes a quotient."""
        if self.kind == "string":
            return self.data.decode("utf-8", "replace")
        layout = _NUMBERS.get(self.kind)
        if layout is None or struct.calcsize(layout) != len(self.data):
            return None
        numbers = struct.unpack(layout, self.data)
        if self.kind == "rational":
            return numbers[0] / numbers[1] if numbers[1] else None
        return numbers[0] if len(numbers) == 1 else numbers


@dataclass(frozen=True, kw_only=True)
class ExrHeaders:
    """Headers of a file, before its offset tables.

    ``parts`` holds the attributes of each part in file order, ``flags`` the version field with its flag
    bits, and ``end`` the offset of the first byte after the headers.
    """

    flags: int
    parts: tuple[dict[str, Attribute], ...]
    end: int

    @property
    def multi_part(self) -> bool:
        """True if chunks carry part numbers."""
        return bool(self.flags & _MULTI_PART)

    def pack(self) -> bytes:
        """Return the bytes of all headers, magic number and version included."""
        packed = [_MAGIC, struct.pack("<I", self.flags)]
        for attributes in self.parts:
            for name, attribute in attributes.items():
                packed += [name.encode("latin-1"), b"\0", attribute.kind.encode("latin-1"), b"\0"]
                packed += [struct.pack("<i", len(attribute.data)), attribute.data]
            packed.append(b"\0")
        return b"".join(packed) + (b"\0" if self.multi_part else b"")


def channel_list(channels: Attribute) -> dict[str, int]:
    """Return the type of each channel in file order: 0 for uint, 1 for half, 2 for float.

    Raises:
        ValueError: The list is damaged, or contains an unknown type.
    """
    kinds: dict[str, int] = {}
    for name, rest in _entries(channels):
        kind = int.from_bytes(rest[:4], "little")
        if len(rest) < 16 or kind > 2:
            raise ValueError(f"channel {name!r} is of type {kind}")
        kinds[name.decode("latin-1")] = kind
    return kinds


def _entries(channels: Attribute) -> Iterator[tuple[bytes, bytes]]:
    """Yield the name of each channel, and its type, linearity and two sampling rates, 16 bytes."""
    data, position = channels.data, 0
    while name := data[position : (end := data.index(b"\0", position))]:
        yield name, data[end + 1 : end + 17]
        position = end + 17


def with_channels(channels: Attribute, others: Attribute) -> Attribute:
    """Return a list extended by the channels that only ``others`` has, sorted by name."""
    merged = {**dict(_entries(others)), **dict(_entries(channels))}
    data = b"".join(name + b"\0" + merged[name] for name in sorted(merged))
    return Attribute(channels.kind, data + b"\0")


def sub_sampled(channels: Attribute) -> list[str]:
    """Return the channels that do not have a value for every pixel, such as chroma."""
    full_rate = struct.pack("<2i", 1, 1)
    return [name.decode("latin-1") for name, rest in _entries(channels) if rest[8:16] != full_rate]


def channel_sizes(channels: Attribute) -> dict[str, int]:
    """Return the bytes per value by channel, in file order: 2 for half, 4 for float and uint."""
    return {name: 2 if kind == 1 else 4 for name, kind in channel_list(channels).items()}


def is_exr(path: Path) -> bool:
    """Return whether a file begins like an OpenEXR file."""
    with path.open("rb") as file:
        return file.read(4) == _MAGIC


def read_headers(path: Path) -> ExrHeaders:
    """Read all headers of an OpenEXR file.

    Raises:
        ImageFileError: The headers are truncated or damaged.

    Source: "OpenEXR File Layout", openexr.com.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        try:
            magic, flags = struct.unpack("<4sI", file.read(8))
            if magic != _MAGIC or flags & 0xFF != 2 or flags & ~0x1EFF:
                raise ValueError("unknown version")
            parts: list[dict[str, Attribute]] = []
            while True:
                count = sum(map(len, parts))
                if attributes := _read_attributes(file, size, _MAX_ATTRIBUTES - count):
                    parts.append(attributes)
                    _check_count("parts", len(parts), _MAX_PARTS)
                if not (flags & _MULTI_PART and attributes):
                    break
            if not parts:
                raise ValueError("no part")
        except (ValueError, struct.error) as problem:
            raise ImageFileError(f"{path}: the EXR header is truncated or damaged ({problem})") from problem
        return ExrHeaders(flags=flags, parts=tuple(parts), end=file.tell())


def _read_attributes(file: BinaryIO, size: int, max_count: int) -> dict[str, Attribute]:
    """Read at most ``max_count`` attributes of one part, and the terminating byte."""
    attributes: dict[str, Attribute] = {}
    while name := _read_name(file):
        kind = _read_name(file)
        (length,) = struct.unpack("<i", file.read(4))
        if not 0 <= length <= size - file.tell():
            raise ValueError(f"attribute {name!r} has {length} bytes")
        if name in attributes:
            raise ValueError(f"attribute {name!r} occurs twice")
        attributes[name] = attribute = Attribute(kind, file.read(length))
        if len(attributes) > max_count:
            raise ValueError(f"expected at most {_MAX_ATTRIBUTES} attributes in a file, found more")
        if kind == "chlist":
            _check_count("channels", sum(1 for _ in _entries(attribute)), _MAX_CHANNELS)
    return attributes


def _check_count(what: str, count: int, max_count: int) -> None:
    if count > max_count:
        raise ValueError(f"expected at most {max_count} {what}, found {count}")


def _read_name(file: BinaryIO) -> str:
    """Read a null-terminated name; empty at the end of a list of attributes."""
    start = file.tell()
    text = file.read(_MAX_NAME_BYTES + 1)
    length = text.find(b"\0")
    if length < 0:
        raise ValueError("a name does not end")
    file.seek(start + length + 1)
    return text[:length].decode("latin-1")
