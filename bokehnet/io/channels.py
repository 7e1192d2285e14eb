"""EXR files with any number of named channels and text attributes."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio  # noqa: N813
from numpy.typing import NDArray

from bokehnet.errors import ShapeError
from bokehnet.io.formats.encode import encode
from bokehnet.io.image import check_writable
from bokehnet.io.pixels import ImageFile

__all__ = ["ChannelFile", "read_channels", "write_channels"]


@dataclass(frozen=True, kw_only=True)
class ChannelFile:
    """Channels of a file, (H, W) float32 by name, and its text attributes."""

    channels: dict[str, NDArray[np.float32]]
    attributes: dict[str, str]


def write_channels(
    path: Path | str, channels: Mapping[str, NDArray[Any]], attributes: Mapping[str, str] | None = None
) -> None:
    """Write channels as lossless float32 EXR, atomically; infinity is kept.

    Args:
        path: File to write, with extension ``.exr``.
        channels: Arrays (H, W) of one size by name, such as ``R`` or ``normal.X``.
        attributes: Text by name, such as ``bokehnet:samples``.

    Raises:
        ImageFileError: The extension is another one, or the file cannot be written.
        ShapeError: The sizes differ, or ``channels`` is empty.
    """
    path = Path(path)
    check_writable(path, (".exr",))
    sizes = {array.shape for array in channels.values()}
    if len(sizes) != 1 or len(next(iter(sizes))) != 2:
        raise ShapeError(f"channels: expected arrays (H, W) of one size, got {sorted(map(str, sizes))}")
    stack = np.stack([np.asarray(array, np.float32) for array in channels.values()], -1)
    hints = {"compression": "zip", **(attributes or {})}
    encode(path, stack.shape, np.float32, stack.__getitem__, tuple(channels), hints)


def read_channels(path: Path | str) -> ChannelFile:
    """Read all channels of the first part of a file, as stored, and its text attributes.

    Raises:
        ImageFileError: The file cannot be read.
    """
    with ImageFile(path) as file:
        part = file.parts[0]
        values = file.read(part, part.channels)
    header = oiio.ImageBuf(str(path)).spec()
    attributes = {entry.name: entry.value for entry in header.extra_attribs if isinstance(entry.value, str)}
    channels = {name: np.ascontiguousarray(values[..., i]) for i, name in enumerate(part.channels)}
    return ChannelFile(channels=channels, attributes=attributes)
