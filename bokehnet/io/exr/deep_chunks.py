"""The samples of a deep OpenEXR part: chunks as they lie in the file to lists of samples for each pixel.

Chunks are unpacked here and not by a decoder, which loses its way in deep data that is cut or damaged and
takes the process with it. Deep data is stored raw, by run lengths or by zlib, and in no other way.
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

__all__ = ["DeepSamples", "read_samples"]

# Rows of a chunk of scan lines by the number of its compression: none, run lengths, zlib by the row, zlib.
_ROWS = {0: 1, 1: 1, 2: 1, 3: 16}

_TYPES: dict[int, np.dtype[Any]] = {0: np.dtype("<u4"), 1: np.dtype("<f2"), 2: np.dtype("<f4")}


@dataclass(frozen=True, kw_only=True, eq=False)
class DeepSamples:
    """Samples of some rows of a deep part.

    Attributes:
        counts: How many each pixel has, (H, W), int64.
        values: Of all of them by channel, float32, (samples,): pixel after pixel along rows, those of a pixel
            in the order of the file.
    """

    counts: NDArray[np.int64]
    values: dict[str, NDArray[np.float32]]


@dataclass(frozen=True)
class _Block:
    """A chunk: its place in the data window, and where its bytes lie."""

    x: int
    y: int
    width: int
    height: int
    pixels: int  # of a chunk that no border cuts
    counts: tuple[int, int]  # first byte and length of the packed numbers of samples
    samples: tuple[int, int, int]  # first byte, packed and unpacked length


def read_samples(
    path: Path, headers: ExrHeaders, part: int, rows: slice, names: Sequence[str]
) -> DeepSamples:
    """Read the samples of some rows.

    Args:
        path: The file.
        headers: Its own.
        part: Index of a deep part.
        rows: From the top of its data window.
        names: Of its channels.

    Raises:
        ImageFileError: The samples are truncated or damaged, or more than pixels may be.

    Source: "OpenEXR File Layout", openexr.com, Deep Data.
    """
    attributes = headers.parts[part]
    try:
        left, top, right, bottom = struct.unpack("<4i", attributes["dataWindow"].data)
        size = (right - left + 1, bottom - top + 1)
        packing = attributes["compression"].data[0]
        if packing not in _ROWS:
            raise ImageFileError(
                f"{path}: expected deep samples packed as none, rle, zips or zip, found compression {packing}"
            )
        channels = channel_list(attributes["channels"])
        if unknown := set(names) - set(channels):
            raise ValueError(f"no channel of the name {unknown.pop()!r}")
        with path.open("rb") as file:
            blocks = _blocks(file, headers, part, (left, top), size, packing)
            wanted = [
                block for block in blocks if block.y < rows.stop and block.y + block.height > rows.start
            ]
            runs: dict[tuple[int, int], tuple[NDArray[np.int64], dict[str, NDArray[np.float32]]]] = {}
            found = 0
            for block in wanted:
                for y, counts, values in _unpacked(file, block, packing, channels, names, path, found):
                    found += int(counts.sum())
                    runs[y, block.x] = counts, values
    except (ValueError, KeyError, IndexError, struct.error, zlib.error, OverflowError) as problem:
        raise ImageFileError(f"{path}: the deep samples are truncated or damaged ({problem})") from problem
    order = [runs[place] for place in sorted(runs) if rows.start <= place[0] < rows.stop]
    counts = np.concatenate([np.zeros(0, np.int64), *(counts for counts, _ in order)])
    height = rows.stop - rows.start
    if counts.size != height * size[0]:
        raise ImageFileError(f"{path}: the deep samples are truncated or damaged (chunks are missing)")
    values = {name: np.concatenate([np.zeros(0, np.float32), *(v[name] for _, v in order)]) for name in names}
    return DeepSamples(counts=counts.reshape(height, size[0]), values=values)


def _blocks(
    file: BinaryIO,
    headers: ExrHeaders,
    part: int,
    corner: tuple[int, int],
    size: tuple[int, int],
    packing: int,
) -> list[_Block]:
    """Return the chunks of full size of a part."""
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
            x, y, width, height = 0, y - corner[1], size[0], _ROWS[packing]
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
        places = (start, packed_counts), (start + packed_counts, packed, unpacked)
        blocks.append(_Block(x, y, width, height, pixels, *places))
    return blocks


def _chunk_count(attributes: dict[str, Attribute]) -> int:
    """Return how many chunks a part has, which files with deep data tell."""
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
    path: Path,
    before: int,
) -> list[tuple[int, NDArray[np.int64], dict[str, NDArray[np.float32]]]]:
    """Return row, numbers of samples and values of each row of a chunk."""
    file.seek(block.counts[0])
    size = 4 * block.width * block.height
    table = file.read(block.counts[1])
    if block.counts[1] == len(table) == 4 * block.pixels:  # raw tables are as long at the borders, too
        table = table[:size]
    else:
        table = _unpack(table, size, packing, block.counts[1])
    sums = np.frombuffer(table, "<i4").reshape(block.height, block.width).astype(np.int64)
    counts = np.diff(sums, axis=1, prepend=0)
    if (counts < 0).any():
        raise ValueError("a pixel has less than no samples")
    totals = sums[:, -1]
    check_pixel_count(path, before + int(totals.sum()), 1, "deep samples")
    sizes = {name: _TYPES[kind].itemsize for name, kind in channels.items()}
    expected = int(totals.sum()) * sum(sizes.values())
    start, packed, unpacked = block.samples
    if unpacked != expected:
        raise ValueError(f"{unpacked} bytes of samples in place of {expected}")
    file.seek(start)
    data = _unpack(file.read(packed), expected, packing, packed)
    rows, at = [], 0
    for row, total in enumerate(totals.tolist()):
        values = {}
        for name, kind in channels.items():
            if name in names:
                stored = np.frombuffer(data, _TYPES[kind], total, at)
                values[name] = stored.astype(np.float32)
            at += total * sizes[name]
        rows.append((block.y + row, counts[row], values))
    return rows


def _unpack(data: bytes, size: int, packing: int, packed: int) -> bytes:
    """Return the ``size`` bytes that ``data`` stands for; what does not shrink is stored raw."""
    if len(data) < packed:
        raise ValueError("the file ends within a chunk")
    if len(data) != size and packing == 1:
        data = _spread_runs(data, size)
    elif len(data) != size and packing in (2, 3):
        data = zlib.decompressobj().decompress(data, size + 1)
    else:
        packing = 0
    if len(data) != size:
        raise ValueError(f"{len(data)} bytes in place of {size}")
    if packing == 0 or size == 0:
        return data
    steps = np.frombuffer(data, np.uint8).copy()
    steps[1:] -= 128  # modulo 256, as all here: differences of bytes
    halves = np.cumsum(steps, dtype=np.uint8)
    result = np.empty(size, np.uint8)
    middle = (size + 1) // 2
    result[0::2], result[1::2] = halves[:middle], halves[middle:]
    return result.tobytes()


def _spread_runs(data: bytes, size: int) -> bytes:
    """Undo run lengths: below 0 that many bytes follow, else the next one stands one time more than told."""
    result, at = bytearray(), 0
    while at < len(data) and len(result) <= size:
        count = data[at] - 256 if data[at] > 127 else data[at]
        if count < 0:
            result += data[at + 1 : at + 1 - count]
            at += 1 - count
        else:
            result += data[at + 1 : at + 2] * (count + 1)
            at += 2
    return bytes(result)
