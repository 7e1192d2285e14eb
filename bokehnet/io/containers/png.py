"""Write PNG files on all cores: bands of rows are filtered and compressed separately, then joined."""

import os
import struct
import zlib
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["compressed_profile", "png_chunks", "png_text", "text_chunk", "write_png"]

_SIGNATURE = b"\x89PNG\r\n\x1a\n"

# Colour types by number of channels: grey, RGB, RGB with straight alpha.
_COLOUR_TYPES = {1: 0, 3: 2, 4: 6}

# Approximate bytes per band: restarting deflate between bands costs less than a thousandth of the size.
_BAND_BYTES = 2**20

# Upper bounds of text and EXIF chunks: bytes of a chunk, also once unpacked, and number of chunks.
_MAX_METADATA_BYTES, _MAX_CHUNKS = 2**24, 1000

# On photographs the size is within half a percent of level 6, in less than half of its time.
_COMPRESSION_LEVEL = 3


def write_png(
    path: Path,
    shape: tuple[int, int, int],
    dtype: Any,
    stored: Callable[[slice], NDArray[Any]],
    chunks: Sequence[tuple[bytes, bytes]] = ((b"sRGB", b"\0"),),
) -> None:
    """Write a PNG file; on a full disk raise ``OSError`` and leave a partial file.

    Args:
        path: File to overwrite.
        shape: (H, W, C), C = 1, 3 or 4.
        dtype: uint8 or uint16.
        stored: Function from rows to their stored values, (rows, W, C); called by several threads.
        chunks: Names and contents of the chunks before the pixels.

    Source:
        W3C, "Portable Network Graphics (PNG) Specification (Third Edition)", 2025; for separately
        compressed pieces of a deflate stream: Adler, "pigz", 2007.
    """
    height, width, channels = shape
    size = np.dtype(dtype).itemsize
    with path.open("wb") as file:
        file.write(_SIGNATURE)
        header = struct.pack(">2I5B", width, height, 8 * size, _COLOUR_TYPES[channels], 0, 0, 0)
        file.write(_chunk(b"IHDR", header))
        for kind, content in chunks:
            file.write(_chunk(kind, content))
        checksum = 1
        start = b"\x78\x5e"  # zlib header for a window of 32 KB
        for filtered, packed in _bands(shape, size, stored):
            checksum = zlib.adler32(filtered, checksum)
            file.write(_chunk(b"IDAT", start + packed))
            start = b""
        file.write(_chunk(b"IDAT", b"\x03\x00" + struct.pack(">I", checksum)))  # an empty last block
        file.write(_chunk(b"IEND", b""))


def png_chunks(path: Path, names: Sequence[bytes]) -> list[tuple[bytes, bytes]]:
    """Return names and contents of the chunks of these names, in order; the file must be complete.

    Chunks above 16 MiB, and those after the first thousand, are ignored.
    """
    chunks: list[tuple[bytes, bytes]] = []
    with path.open("rb") as file:
        file.seek(len(_SIGNATURE))
        while len(head := file.read(8)) == 8 and len(chunks) < _MAX_CHUNKS:
            length, kind = struct.unpack(">I4s", head)
            if kind in names and length <= _MAX_METADATA_BYTES:
                chunks.append((kind, file.read(length)))
                file.seek(4, 1)
            else:
                file.seek(length + 4, 1)
    return chunks


def png_text(content: bytes, keyword: str) -> bytes | None:
    """Return the UTF-8 text of an iTXt chunk with this keyword; None for others, or above 16 MiB."""
    name, _, rest = content.partition(b"\0")
    if name != keyword.encode() or len(rest) < 2:
        return None
    text = rest[2:].split(b"\0", 2)[-1]
    if not rest[0]:
        return text
    try:
        unpacker = zlib.decompressobj()
        unpacked = unpacker.decompress(text, _MAX_METADATA_BYTES)
    except zlib.error:
        return None
    return unpacked if unpacker.eof else None


def text_chunk(keyword: str, text: bytes) -> tuple[bytes, bytes]:
    """Return an iTXt chunk of UTF-8."""
    return b"iTXt", keyword.encode() + bytes(5) + text


def compressed_profile(icc: bytes) -> tuple[bytes, bytes]:
    """Return an iCCP chunk."""
    return b"iCCP", b"ICC profile\0\0" + zlib.compress(icc, 9)


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def _bands(
    shape: tuple[int, int, int], size: int, stored: Callable[[slice], NDArray[Any]]
) -> Iterator[tuple[bytes, bytes]]:
    """Yield filtered and compressed bands from top to bottom; a bounded number is held in memory."""
    height, width, channels = shape
    rows = max(1, _BAND_BYTES // (width * channels * size))

    def pack(top: int) -> tuple[bytes, bytes]:
        first = max(0, top - 1)
        values = stored(slice(first, min(top + rows, height)))
        lines = np.ascontiguousarray(values, f">u{size}").view(np.uint8).reshape(len(values), -1)
        if top == 0:
            lines = np.concatenate([np.zeros_like(lines[:1]), lines])
        filtered = _filtered(lines, channels * size).tobytes()
        deflate = zlib.compressobj(_COMPRESSION_LEVEL, zlib.DEFLATED, -15, 9)
        return filtered, deflate.compress(filtered) + deflate.flush(zlib.Z_SYNC_FLUSH)

    workers = min(8, os.cpu_count() or 1)
    waiting: deque[Future[tuple[bytes, bytes]]] = deque()
    with ThreadPoolExecutor(workers) as pool:
        for top in range(0, height, rows):
            waiting.append(pool.submit(pack, top))
            if len(waiting) > 2 * workers:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


def _filtered(lines: NDArray[np.uint8], step: int) -> NDArray[np.uint8]:
    """Return rows of bytes as differences to their predictions, preceded by the filter type.

    Args:
        lines: (1 + rows, bytes); the first is the row above.
        step: Bytes per pixel.

    Returns:
        (rows, 1 + bytes): for each row, the filter of three with the smallest sum of differences.
    """
    current, above = lines[1:], lines[:-1]
    left, corner = np.zeros_like(current), np.zeros_like(current)
    left[:, step:], corner[:, step:] = current[:, :-step], above[:, :-step]
    best = current - left
    kinds = np.ones(len(current), np.uint8)
    min_cost = _cost(best)
    for kind, prediction in ((2, above), (4, _paeth(left, above, corner))):
        differences = current - prediction
        cost = _cost(differences)
        better = cost < min_cost
        best[better], kinds[better], min_cost[better] = differences[better], kind, cost[better]
    return np.concatenate([kinds[:, None], best], axis=1)


def _cost(differences: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Return the sum of the absolute differences modulo 256, by row."""
    signed = differences.view(np.int8)
    return np.abs(signed.astype(np.int16)).sum(axis=1, dtype=np.int64)


def _paeth(left: NDArray[np.uint8], above: NDArray[np.uint8], corner: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the neighbour nearest to left + above - corner; ties prefer the left one, then the one above."""
    a, b, c = (x.astype(np.int16) for x in (left, above, corner))
    to_left, to_above = np.abs(b - c), np.abs(a - c)
    to_corner = np.abs(a + b - 2 * c)
    is_left = (to_left <= to_above) & (to_left <= to_corner)
    return np.where(is_left, left, np.where(to_above <= to_corner, above, corner))
