"""Replace some channels of one part of an OpenEXR file and keep everything else.

The part is encoded anew from its stored channels and the new ones; then its chunks replace the old ones in a
copy of the file. Headers and all other parts, deep ones too, are copied byte by byte.
"""

import os
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import BinaryIO

import numpy as np
import OpenImageIO as oiio  # noqa: N813
from numpy.typing import NDArray

from bokehnet.errors import ImageFileError
from bokehnet.io.exr.header import Attribute, ExrHeaders, channel_sizes, read_headers, with_channels
from bokehnet.io.pixels import ImageFile, Part

__all__ = ["write_replaced"]

_MAX_HALF = 65504.0

# Attributes that the new encoding may change; all others are kept.
_ENCODING_ATTRIBUTES = ("compression", "lineOrder", "tiles")

# Layout of the position and size fields in front of the data of a chunk, by type of part.
_CHUNK_HEADS = {"scanlineimage": "<iI", "tiledimage": "<4iI", "deepscanline": "<i3Q", "deeptile": "<4i3Q"}


def write_replaced(
    target: Path, source: ImageFile, part: Part, replaced: Mapping[str, NDArray[np.float32]]
) -> None:
    """Write ``source`` to ``target`` with the channels ``replaced`` (H, W) of ``part`` exchanged.

    Channel types are kept; half is clipped to +-65504. Compression is kept, except that HTJ2K, and PXR24 with
    integer channels, become ZIP. Other channels of the same part are unchanged under lossless compression,
    and are compressed once more under B44 and DWA. Mip levels are dropped.

    Args:
        target: Empty file to overwrite; a temporary second file is created in its folder.
        source: Open EXR file.
        part: Part of ``source``.
        replaced: Float32 values by channel name; names missing from the part are added as float channels.

    Raises:
        OSError: The target cannot be written, or the source changes during the copy.
        ImageFileError: The source is damaged.
    """
    assert source.headers is not None
    donor = target.with_name(f"{target.stem}-part{target.suffix}")
    try:
        _encode_part(donor, source, part, replaced)
        _splice(target, source.path, source.headers, part.index, donor)
    finally:
        donor.unlink(missing_ok=True)


def _encode_part(
    donor: Path, source: ImageFile, part: Part, replaced: Mapping[str, NDArray[np.float32]]
) -> None:
    """Write one part to a file of its own, band of rows by band of rows."""
    added = [name for name in replaced if name not in part.channels]
    names = (*part.channels, *added)
    spec = _donor_spec(source, part, added)
    output = oiio.ImageOutput.create(str(donor))
    if output is None or not output.open(str(donor), spec):
        raise OSError(output.geterror() if output else oiio.geterror())
    left, right = spec.x, spec.x + spec.width
    for rows in source.bands(part):
        values = source.read_stored(part, rows)
        if added:
            values = np.dstack([values, *(replaced[name][rows] for name in added)])
        for name, channel in replaced.items():
            index = names.index(name)
            clipped = name not in added and part.formats[index] == "half"
            new = np.clip(channel[rows], -_MAX_HALF, _MAX_HALF) if clipped else channel[rows]
            values[..., index] = new
        top, bottom = spec.y + rows.start, spec.y + rows.stop
        written = (
            output.write_tiles(left, right, top, bottom, 0, 1, values)
            if spec.tile_width
            else output.write_scanlines(top, bottom, 0, values)
        )
        if not written:
            raise OSError(output.geterror())
    problem = output.geterror()
    if not output.close() or problem:
        raise OSError(problem or output.geterror())


def _donor_spec(source: ImageFile, part: Part, added: Sequence[str]) -> oiio.ImageSpec:
    """Return the header of the part alone. Integers pass through the encoder as the bits of floats."""
    stored = source.spec(part)
    formats = ["half" if name == "half" else "float" for name in part.formats] + ["float"] * len(added)
    spec = oiio.ImageSpec(part.width, part.height, len(formats), formats[0])
    try:
        spec.channelnames = (*part.channels, *added)
    except RuntimeError as error:  # bytes that are not UTF-8
        expected = "expected names of channels in UTF-8; the file is damaged"
        raise ImageFileError(f"{source.path}: {expected}") from error
    if len(set(formats)) > 1:  # otherwise the encoder uses the common type
        spec.channelformats = tuple(oiio.TypeDesc(name) for name in formats)
    spec.x, spec.y = stored.x, stored.y
    spec.full_x, spec.full_y = stored.full_x, stored.full_y
    spec.full_width, spec.full_height = stored.full_width, stored.full_height
    spec.tile_width, spec.tile_height = stored.tile_width, stored.tile_height
    compression = stored.get_string_attribute("compression", "zip")
    if compression == "pxr24" and "uint" in part.formats:
        compression = "zip"
    if compression.startswith("dwa"):
        compression += f":{stored.get_float_attribute('openexr:dwaCompressionLevel', 45.0):g}"
    spec.attribute("compression", compression)
    return spec


def _splice(target: Path, path: Path, headers: ExrHeaders, index: int, donor: Path) -> None:
    """Copy the file at ``path`` with the chunks of the part ``index`` replaced by those of ``donor``."""
    new = read_headers(donor)
    attributes = dict(headers.parts[index])
    attributes["channels"] = with_channels(attributes["channels"], new.parts[0]["channels"])
    if channel_sizes(new.parts[0]["channels"]) != channel_sizes(attributes["channels"]):
        raise OSError("the encoder cannot keep the channels as they are")
    for name in _ENCODING_ATTRIBUTES:
        if name in new.parts[0]:
            attributes[name] = new.parts[0][name]
    with target.open("wb") as output, path.open("rb") as old, donor.open("rb") as fresh:
        fresh.seek(new.end)
        first = _offsets(fresh, 1)  # the first chunk follows the table of offsets
        own = first + _offsets(fresh, (first[0] - new.end) // 8 - 1)
        if "chunkCount" in attributes:
            attributes["chunkCount"] = Attribute("int", struct.pack("<i", len(own)))
        parts = (*headers.parts[:index], attributes, *headers.parts[index + 1 :])
        merged = ExrHeaders(flags=headers.flags, parts=parts, end=0).pack()
        tables = _tables(old, headers) if headers.multi_part else [own]
        tables[index] = own
        output.write(merged)
        output.write(bytes(8 * sum(map(len, tables))))
        max_size = output.tell() + path.stat().st_size + donor.stat().st_size
        written: list[int] = []
        for number, table in enumerate(tables):
            kind = _kind(parts[number])
            for offset in table:
                written.append(output.tell())
                if headers.multi_part:
                    output.write(struct.pack("<i", number))
                if number == index:
                    _copy_chunk(fresh, offset, kind, output)
                else:
                    _copy_chunk(old, offset + 4, kind, output)  # after the part number
                if output.tell() > max_size:
                    raise ImageFileError(f"{path}: the chunks of a part overlap; the file is damaged")
        output.seek(len(merged))
        output.write(struct.pack(f"<{len(written)}Q", *written))


def _tables(file: BinaryIO, headers: ExrHeaders) -> list[list[int]]:
    """Return the chunk offsets of each part of a multi-part file."""
    file.seek(headers.end)
    counts = [attributes.get("chunkCount") for attributes in headers.parts]
    if None in counts:
        raise OSError("a part has no chunk count; the file is damaged")
    values = [count.value() for count in counts if count is not None]
    return [_offsets(file, value if isinstance(value, int) else 0) for value in values]


def _offsets(file: BinaryIO, count: int) -> list[int]:
    """Read ``count`` chunk offsets from a file."""
    if count < 0:
        raise OSError("a part has a negative chunk count; the file is damaged")
    table = file.read(8 * count)
    if len(table) < 8 * count:
        raise OSError("the table of chunks is cut off")
    return list(struct.unpack(f"<{count}Q", table))


def _kind(attributes: Mapping[str, Attribute]) -> str:
    """Return the type of a part."""
    if "type" in attributes:
        kind = str(attributes["type"].value())
        if kind not in _CHUNK_HEADS:
            raise OSError(f"expected a part of the type {', '.join(_CHUNK_HEADS)}, got {kind!r}")
        return kind
    return "tiledimage" if "tiles" in attributes else "scanlineimage"


def _copy_chunk(file: BinaryIO, offset: int, kind: str, output: BinaryIO) -> None:
    """Copy one chunk, without its part number."""
    layout = _CHUNK_HEADS[kind]
    head = b""
    if offset < os.fstat(file.fileno()).st_size:  # a damaged table may point beyond the end of the file
        file.seek(offset)
        head = file.read(struct.calcsize(layout))
    if len(head) < struct.calcsize(layout):
        raise OSError(f"the source ends before its chunk at byte {offset}")
    fields = struct.unpack(layout, head)
    size = fields[-3] + fields[-2] if kind.startswith("deep") else fields[-1]
    output.write(head)
    start = output.tell()
    _copy(file, size, output)
    if output.tell() - start != size:
        raise OSError(f"the source ends within its chunk at byte {offset}")


def _copy(file: BinaryIO, size: int, output: BinaryIO) -> None:
    """Copy ``size`` bytes, or fewer if the file ends before."""
    while size > 0 and (block := file.read(min(size, 2**20))):
        output.write(block)
        size -= len(block)
