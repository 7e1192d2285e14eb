"""Read the samples of a deep OpenEXR part: chunks of the file to lists of samples per pixel.

This module unpacks the chunks itself, because decoders crash the process on truncated or damaged deep data.
Deep data is stored raw, with run-length coding or with zlib, and in no other way.
"""

import os
import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from bokehnet.errors import ImageFileError
from bokehnet.io.containers.input_checks import check_pixel_count
from bokehnet.io.exr.header import Attribute, ExrHeaders, channel_list

__all__ = ["DeepSamples", "largest_band", "read_samples"]

# Upper bound of the samples of a part: this many, two for each pixel, and one for each byte of the file.
# Files of renderers have 5 to 20 bytes per sample; a chunk of zeros unpacks to a thousand times its size.
_MAX_SAMPLES = 4_000_000

# Rows per scan-line chunk by compression number: none, run lengths, zlib by the row, zlib.
_CHUNK_ROWS = {0: 1, 1: 1, 2: 1, 3: 16}

_TYPES: dict[int, np.dtype[Any]] = {0: np.dtype("<u4"), 1: np.dtype("<f2"), 2: np.dtype("<f4")}


@dataclass(frozen=True, kw_only=True, eq=False)
class DeepSamples:
    """Samples of some rows of a deep part.

    Attributes:
        counts: Number of samples per pixel, (H, W), int64.
        values: Values of all samples by channel, float32, (samples,): pixel by pixel along rows, those of a
            pixel in file order.
    """

    counts: NDArray[np.int64]
    values: dict[str, NDArray[np.float32]]


@dataclass(frozen=True)
class _Block:
    """A chunk: its rectangle in the data window, and the position of its bytes."""

    x: int
    y: int
    width: int
    height: int
    pixels: int  # number of pixels of a chunk that no border crops
    counts: tuple[int, int]  # first byte and length of the packed sample counts
    samples: tuple[int, int, int]  # first byte, packed length and unpacked length


def read_samples(
    path: Path, headers: ExrHeaders, part: int, rows: slice, names: Sequence[str]
) -> DeepSamples:
    """Read the samples of some rows.

    Args:
        path: EXR file.
        headers: Headers of the file.
        part: Index of a deep part.
        rows: Rows from the top of the data window.
        names: Channels to read.

    Raises:
        ImageFileError: The samples are truncated or damaged, or exceed their upper bound.

    Source: "OpenEXR File Layout", openexr.com, Deep Data.
    """
    attributes = headers.parts[part]
    try:
        left, top, right, bottom = struct.unpack("<4i", attributes["dataWindow"].data)
        size = (right - left + 1, bottom - top + 1)
        packing = attributes["compression"].data[0]
        if packing not in _CHUNK_ROWS:
            raise ImageFileError(
                f"{path}: expected deep samples packed as none, rle, zips or zip, found compression {packing}"
            )
        channels = channel_list(attributes["channels"])
        if unknown := set(names) - set(channels):
            raise ValueError(f"no channel of the name {unknown.pop()!r}")
        with path.open("rb") as file:
            blocks = _blocks(file, headers, part, (left, top), size, packing)
            sample_bytes = sum(_TYPES[kind].itemsize for kind in channels.values())
            _check_samples(path, sum(block.samples[2] for block in blocks) // sample_bytes, size[0] * size[1])
            needed = [
                block for block in blocks if block.y < rows.stop and block.y + block.height > rows.start
            ]
            runs: dict[tuple[int, int], tuple[NDArray[np.int64], dict[str, NDArray[np.float32]]]] = {}
            for block in needed:
                for y, counts, values in _unpacked(file, block, packing, channels, names):
                    runs[y, block.x] = counts, values
    except (ValueError, KeyError, IndexError, struct.error, zlib.error, OverflowError) as problem:
        raise ImageFileError(f"{path}: the deep samples are truncated or damaged ({problem})") from problem
    order = [runs[corner] for corner in sorted(runs) if rows.start <= corner[0] < rows.stop]
    counts = np.concatenate([np.zeros(0, np.int64), *(counts for counts, _ in order)])
    height = rows.stop - rows.start
    if counts.size != height * size[0]:
        raise ImageFileError(f"{path}: the deep samples are truncated or damaged (chunks are missing)")
    values = {name: np.concatenate([np.zeros(0, np.float32), *(v[name] for _, v in order)]) for name in names}
    return DeepSamples(counts=counts.reshape(height, size[0]), values=values)


def largest_band(path: Path, headers: ExrHeaders, part: int, rows: int) -> int:
    """Return the largest number of samples in successive bands of ``rows`` rows; reads no samples.

    Raises:
        ImageFileError: The part is truncated or damaged.
    """
    attributes = headers.parts[part]
    try:
        left, top, right, bottom = struct.unpack("<4i", attributes["dataWindow"].data)
        size, packing = (right - left + 1, bottom - top + 1), attributes["compression"].data[0]
        kinds = channel_list(attributes["channels"]).values()
        counts: dict[int, int] = {}
        with path.open("rb") as file:
            for block in _blocks(file, headers, part, (left, top), size, packing):
                counts[block.y // rows] = counts.get(block.y // rows, 0) + block.samples[2]
    except (ValueError, KeyError, IndexError, struct.error) as problem:
        raise ImageFileError(f"{path}: the deep samples are truncated or damaged ({problem})") from problem
    return max(counts.values(), default=0) // sum(_TYPES[kind].itemsize for kind in kinds)


def _blocks(
    file: BinaryIO,
    headers: ExrHeaders,
    part: int,
    corner: tuple[int, int],
    size: tuple[int, int],
    packing: int,
) -> list[_Block]:
    """Return the full-resolution chunks of a part."""
    counts = [_chunk_count(attributes) for attributes in headers.parts]
    limit = file.seek(0, os.SEEK_END)
    if 8 * sum(counts) > limit:
        raise ValueError("the table of chunks is cut off")
    file.seek(headers.end + 8 * sum(counts[:part]))
    table = file.read(8 * counts[part])
    offsets = struct.unpack(f"<{counts[part]}Q", table)
    tiles = headers.parts[part].get("tiles")
    tile = (0, 0) if tiles is None else struct.unpack("<2I", tiles.data[:8])
    blocks = []
    for offset in offsets:
        if offset > limit:
            raise ValueError("a chunk beyond the end of the file")
        file.seek(offset + (4 if headers.multi_part else 0))
        if tiles is None:
            (y,) = struct.unpack("<i", file.read(4))
            x, y, width, height = 0, y - corner[1], size[0], _CHUNK_ROWS[packing]
        else:
            column, row, *level = struct.unpack("<4i", file.read(16))
            if level != [0, 0]:
                continue
            x, y, width, height = column * tile[0], row * tile[1], *tile
        if not (0 <= x < size[0] and 0 <= y < size[1]):
            raise ValueError(f"a chunk at {x}, {y}")
        packed_counts, packed, unpacked = struct.unpack("<3Q", file.read(24))
        if packed_counts + packed > limit:
            raise ValueError("a chunk beyond the end of the file")
        start = file.tell()
        pixels = width * height
        width, height = min(width, size[0] - x), min(height, size[1] - y)
        extents = (start, packed_counts), (start + packed_counts, packed, unpacked)
        blocks.append(_Block(x, y, width, height, pixels, *extents))
    return blocks


def _chunk_count(attributes: dict[str, Attribute]) -> int:
    """Return the number of chunks of a part, which files with deep data must store."""
    (count,) = struct.unpack("<i", attributes["chunkCount"].data)
    if count < 0:
        raise ValueError(f"{count} chunks")
    return int(count)


def _unpacked(
    file: BinaryIO,
    block: _Block,
    packing: int,
    channels: dict[str, int],
    names: Sequence[str],
) -> list[tuple[int, NDArray[np.int64], dict[str, NDArray[np.float32]]]]:
    """Return row, sample counts and values of each row of a chunk."""
    file.seek(block.counts[0])
    size = 4 * block.width * block.height
    table = file.read(block.counts[1])
    if block.counts[1] == len(table) == 4 * block.pixels:  # raw tables have full length at the borders too
        table = table[:size]
    else:
        table = _unpack(table, size, packing, block.counts[1])
    sums = np.frombuffer(table, "<i4").reshape(block.height, block.width).astype(np.int64)
    counts = np.diff(sums, axis=1, prepend=0)
    if (counts < 0).any():
        raise ValueError("a pixel has a negative number of samples")
    totals = sums[:, -1]
    sizes = {name: _TYPES[kind].itemsize for name, kind in channels.items()}
    expected = int(totals.sum()) * sum(sizes.values())
    start, packed, unpacked = block.samples
    if unpacked != expected:
        raise ValueError(f"{unpacked} bytes of samples instead of {expected}")
    file.seek(start)
    data = _unpack(file.read(packed), expected, packing, packed)
    rows, position = [], 0
    for row, total in enumerate(totals.tolist()):
        values = {}
        for name, kind in channels.items():
            if name in names:
                stored = np.frombuffer(data, _TYPES[kind], total, position)
                values[name] = stored.astype(np.float32)
            position += total * sizes[name]
        rows.append((block.y + row, counts[row], values))
    return rows


def _check_samples(path: Path, count: int, pixels: int) -> None:
    """Raise if a part of so many pixels has more samples than allowed."""
    check_pixel_count(path, count, 1, "deep samples")
    max_count = _MAX_SAMPLES + 2 * pixels + path.stat().st_size
    if count > max_count:
        raise ImageFileError(
            f"{path}: expected at most {max_count} deep samples in a file of this size, found {count}; "
            "the file is damaged"
        )


def _unpack(data: bytes, size: int, packing: int, packed: int) -> bytes:
    """Return the unpacked ``size`` bytes of ``data``; incompressible data is stored raw."""
    if len(data) < packed:
        raise ValueError("the file ends within a chunk")
    if len(data) != size and packing == 1:
        data = _spread_runs(data, size)
    elif len(data) != size and packing in (2, 3):
        data = zlib.decompressobj().decompress(data, size + 1)
    else:
        packing = 0
    if len(data) != size:
        raise ValueError(f"{len(data)} bytes instead of {size}")
    if packing == 0 or size == 0:
        return data
    steps = np.frombuffer(data, np.uint8).copy()
    steps[1:] -= 128  # differences of bytes, modulo 256
    halves = np.cumsum(steps, dtype=np.uint8)
    result = np.empty(size, np.uint8)
    middle = (size + 1) // 2
    result[0::2], result[1::2] = halves[:middle], halves[middle:]
    return result.tobytes()


def _spread_runs(data: bytes, size: int) -> bytes:
    """Decode run lengths: -n precedes n literal bytes, n >= 0 repeats the next byte n + 1 times."""
    result, position = bytearray(), 0
    while position < len(data) and len(result) <= size:
        count = data[position] - 256 if data[position] > 127 else data[position]
        if count < 0:
            result += data[position + 1 : position + 1 - count]
            position += 1 - count
        else:
            result += data[position + 1 : position + 2] * (count + 1)
            position += 2
    return bytes(result)
