"""Mutations of files: bytes, numbers in text, and structures whose checksums are corrected."""

import re
import struct
import zlib

import numpy as np

__all__ = ["mutated"]

TEXT_SUFFIXES = (".toml", ".csv", ".txt", ".agf", ".zmx", ".seq", ".len", ".json")

_WORDS = (
    b"0", b"-1", b"nan", b"inf", b"-inf", b"1e308", b"1e-308", b"1e99999", b"9" * 25, b"9" * 400, b"9" * 5000,
    b"true", b'""', b"[]", b"{}", b"null", b"\xff\xfe", b"\0", "é".encode(), b"1,", b"=", b"\n", b"#", b"'",
)  # fmt: skip
_INTEGERS = (0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 2**20, 2**24, 2**31 - 1, 2**31, 2**32 - 1)
_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
_PNG = b"\x89PNG\r\n\x1a\n"
_HEADER_BYTES = 600


def mutated(data: bytes, suffix: str, rng: np.random.Generator) -> bytes:
    """Return a damaged copy of a file.

    Args:
        data: Content of an intact file.
        suffix: Suffix of its name, which selects mutations for text.
        rng: Random generator.
    """
    for _ in range(min(int(rng.geometric(0.5)), 6)):
        data = _text(data, rng) if suffix in TEXT_SUFFIXES and rng.random() < 0.7 else _bytes(data, rng)
    if data.startswith(_PNG) and rng.random() < 0.8:
        data = _with_png_checksums(data)
    return data


def _position(data: bytes, rng: np.random.Generator) -> int:
    """Return a random offset; half of them are in the header, where decoders decide most."""
    end = len(data) if rng.random() < 0.5 else min(len(data), _HEADER_BYTES)
    return int(rng.integers(max(end, 1)))


def _text(data: bytes, rng: np.random.Generator) -> bytes:
    numbers = list(_NUMBER.finditer(data))
    word = _WORDS[int(rng.integers(len(_WORDS)))]
    kind = int(rng.integers(4))
    if kind < 2 and numbers:
        number = numbers[int(rng.integers(len(numbers)))]
        return data[: number.start()] + word + data[number.end() :]
    lines = data.split(b"\n")
    index = int(rng.integers(len(lines)))
    if kind == 2:
        lines.insert(index, lines[int(rng.integers(len(lines)))] * int(rng.integers(1, 200)))
    else:
        lines[index] = lines[index][: len(lines[index]) // 2] + word
    return b"\n".join(lines)


def _bytes(data: bytes, rng: np.random.Generator) -> bytes:
    position, kind = _position(data, rng), int(rng.integers(7))
    if kind == 0:
        return (
            data[:position]
            + bytes([(data[position] if data else 0) ^ (1 << int(rng.integers(8)))])
            + data[position + 1 :]
        )
    if kind == 1:
        return data[:position] + rng.bytes(int(rng.integers(1, 9))) + data[position + 4 :]
    if kind == 2:
        value = _INTEGERS[int(rng.integers(len(_INTEGERS)))]
        layout = ("<I", ">I", "<H", ">H", "<Q", "B")[int(rng.integers(6))]
        size = struct.calcsize(layout)
        packed = struct.pack(layout, value & (256**size - 1))
        return data[:position] + packed + data[position + size :]
    if kind == 3:
        return data[:position]
    if kind == 4:
        return data[:position] + data[position + int(rng.integers(1, 64)) :]
    if kind == 5:
        start = _position(data, rng)
        return data[:position] + data[start : start + int(rng.integers(1, 400))] + data[position:]
    block = data[position : position + int(rng.integers(4, 64))]
    return data[:position] + block * int(rng.integers(2, 300)) + data[position:]


def _with_png_checksums(data: bytes) -> bytes:
    """Return a PNG file with correct checksums, so that damage reaches the decoder."""
    result, position = bytearray(_PNG), len(_PNG)
    while position + 12 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, position)
        length = min(length, len(data) - position - 12)
        content = data[position + 8 : position + 8 + length]
        result += struct.pack(">I", length) + kind + content + struct.pack(">I", zlib.crc32(kind + content))
        position += 12 + length
    return bytes(result)
