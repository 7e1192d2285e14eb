"""The pixels of an image file as they are stored, named by channel; no colour conversion.

A file has one part, except for multi-part EXR. Formats are recognised by content, not by extension.
"""

import os
import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
import OpenImageIO as oiio  # noqa: N813
from numpy.typing import NDArray

from bokehnet.errors import ImageFileError

__all__ = ["READABLE_EXTENSIONS", "ImageFile", "Part", "apply_orientation"]

READABLE_EXTENSIONS = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp", ".exr", ".hdr")

_FORMATS = ("jpeg", "png", "tiff", "webp", "openexr", "hdr")
_LINEAR_FORMATS = ("openexr", "hdr")
_FLOAT_TYPES = ("half", "float", "double")
_PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"


@dataclass(frozen=True, kw_only=True)
class Part:
    """What the header says about one picture in a file.

    ``width`` and ``height`` are pixels as stored, before ``orientation`` (EXIF, 1 to 8; 1 is upright).
    For EXR they are those of the data window. ``alpha`` is the name of the alpha channel, and
    ``premultiplied`` tells whether the colours are already multiplied by it.
    """

    index: int
    width: int
    height: int
    channels: tuple[str, ...]
    pixel_type: str
    orientation: int
    alpha: str | None
    premultiplied: bool
    linear: bool


class ImageFile:
    """An open image file; use it in a ``with`` statement.

    Args:
        path: JPEG, PNG, TIFF, WebP, EXR or HDR file.

    Raises:
        ImageFileError: the file is missing, a folder, empty, damaged or of another format.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        _check_file(self.path)
        hints = oiio.ImageSpec()
        hints.attribute("oiio:UnassociatedAlpha", 1)  # hand out the values as stored
        opened = oiio.ImageInput.open(str(self.path), hints)
        if opened is None:
            raise ImageFileError(f"{self.path}: {_why_not_opened(self.path, oiio.geterror())}")
        self._input = opened
        self.file_format: str = opened.format_name()
        if self.file_format not in _FORMATS:
            self._input.close()
            raise ImageFileError(f"{self.path}: expected {_known()}, found the format {self.file_format!r}")
        self.parts = tuple(self._describe())

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._input.close()

    def read(self, part: Part, names: Sequence[str]) -> NDArray[np.float32]:
        """Return the channels ``names`` of ``part``, (H, W, len(names)), upright.

        Integer types are scaled to [0, 1]; floating-point values come as they are.

        Raises:
            ImageFileError: the pixels are truncated or damaged.
        """
        indices = [part.channels.index(name) for name in names]
        first, last = min(indices), max(indices)
        # The decoder may hand out a partial picture beside an error: an error always counts.
        values = self._input.read_image(part.index, 0, first, last + 1, "float")
        problem = self._input.geterror()
        if values is None or problem:
            raise ImageFileError(f"{self.path}: the pixels are truncated or damaged ({_first_line(problem)})")
        values = values.reshape(part.height, part.width, last + 1 - first)
        picked = (
            values if indices == list(range(first, last + 1)) else values[..., [i - first for i in indices]]
        )
        return apply_orientation(picked, part.orientation)

    def _describe(self) -> list[Part]:
        parts: list[Part] = []
        while self._input.seek_subimage(len(parts), 0):
            spec = self._input.spec()
            types = dict.fromkeys(str(spec.channelformat(i)) for i in range(spec.nchannels))
            linear = self.file_format in _LINEAR_FORMATS or all(name in _FLOAT_TYPES for name in types)
            part = Part(
                index=len(parts),
                width=spec.width,
                height=spec.height,
                channels=tuple(spec.channelnames),
                pixel_type=", ".join(types),
                orientation=spec.get_int_attribute("Orientation", 1),
                alpha=spec.channelnames[spec.alpha_channel] if spec.alpha_channel >= 0 else None,
                premultiplied=not spec.get_int_attribute("oiio:UnassociatedAlpha", 0),
                linear=linear,
            )
            parts.append(part)
            if self.file_format != "openexr":  # further pages of a TIFF are other pictures or thumbnails
                break
        self._input.geterror()  # running past the last part leaves a message behind
        return parts


def apply_orientation(values: NDArray[np.float32], orientation: int) -> NDArray[np.float32]:
    """Turn stored rows and columns (H, W, C) upright.

    Source: CIPA DC-008, "Exchangeable image file format (Exif)", 2019, tag Orientation.
    """
    if orientation in (5, 6, 7, 8):  # stored rows are columns of the picture
        values = values.swapaxes(0, 1)
    if orientation in (3, 4, 7, 8):
        values = values[::-1]
    if orientation in (2, 3, 6, 7):
        values = values[:, ::-1]
    return np.ascontiguousarray(values)


def _check_file(path: Path) -> None:
    if path.is_dir():
        raise ImageFileError(f"{path}: expected an image file, found a folder")
    if not path.exists():
        raise ImageFileError(f"{path}: no such file")
    if not path.is_file():
        raise ImageFileError(f"{path}: expected an image file, found something that is not a regular file")
    if not os.access(path, os.R_OK):
        raise ImageFileError(f"{path}: no permission to read this file")
    if path.stat().st_size == 0:
        raise ImageFileError(f"{path}: the file is empty (0 bytes)")
    _check_png(path)


def _check_png(path: Path) -> None:
    """Check lengths and checksums of a PNG file, because libpng tells of damage on stderr by itself."""
    size = path.stat().st_size
    with path.open("rb") as file:
        if file.read(8) != _PNG_SIGNATURE:
            return
        kind = b""
        while kind != b"IEND":
            head = file.read(8)
            length, kind = struct.unpack(">I4s", head) if len(head) == 8 else (size, b"")
            if file.tell() + length + 4 > size:
                raise ImageFileError(f"{path}: the PNG file is truncated at byte {size}")
            if zlib.crc32(file.read(length), zlib.crc32(kind)) != int.from_bytes(file.read(4), "big"):
                raise ImageFileError(f"{path}: the PNG file is damaged before byte {file.tell()}")


def _why_not_opened(path: Path, reason: str) -> str:
    extension = path.suffix.lower()
    if extension in READABLE_EXTENSIONS:
        return (
            f"expected {extension.lstrip('.').upper()}, found a damaged or other file ({_first_line(reason)})"
        )
    return f"unknown extension {path.suffix!r} and unknown content, expected {_known()}"


def _known() -> str:
    return "one of " + ", ".join(READABLE_EXTENSIONS)


def _first_line(message: str) -> str:
    return message.strip().splitlines()[0] if message.strip() else "the decoder gave no reason"
