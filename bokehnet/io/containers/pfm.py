"""Read and write portable float maps.

The header consists of words: the kind, width and height, and a scale whose sign gives the byte order (below
0: least significant byte first). Rows are stored from the bottom upwards. ``Pf`` is grey, ``PF`` has red,
green and blue.

The magnitude of the scale, which writers use for units of their own, is ignored: values are those stored.

Source: Debevec, "PFM portable floatmap image format", 2001.
"""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio  # noqa: N813
from numpy.typing import NDArray

from bokehnet.errors import ImageFileError

__all__ = ["PfmInput", "is_pfm", "write_pfm"]

_KINDS = {b"Pf": 1, b"PF": 3}
_HEADER = re.compile(rb"(P[Ff])\s+(\d{1,9})\s+(\d{1,9})\s+([-+0-9.eE]{1,40})\s")
_MAX_HEADER_BYTES = 200
_BAND_ROWS = 256


def is_pfm(path: Path) -> bool:
    """Return whether a file begins like a portable float map."""
    with path.open("rb") as file:
        return re.match(rb"P[Ff]\s", file.read(3)) is not None


class PfmInput:
    """An open portable float map with the methods of ``OpenImageIO.ImageInput`` used in this package.

    Args:
        path: PFM file.

    Raises:
        ImageFileError: The header is damaged, or the file too short.
    """

    def __init__(self, path: Path) -> None:
        with path.open("rb") as file:
            head = file.read(_MAX_HEADER_BYTES)
        header = _HEADER.match(head)
        try:
            scale = float(header[4]) if header else 0.0
        except ValueError:
            scale = 0.0
        width, height = (int(header[2]), int(header[3])) if header else (0, 0)
        if header is None or not width or not height or not abs(scale) > 0:
            raise ImageFileError(
                f"{path}: expected PFM (Pf or PF, width, height, scale), found a damaged header"
            )
        channels = _KINDS[header[1]]
        length, size = header.end() + 4 * width * height * channels, path.stat().st_size
        if size < length:
            raise ImageFileError(f"{path}: the PFM file is truncated: expected {length} bytes, found {size}")
        kind = "<f4" if scale < 0 else ">f4"
        self._rows = np.memmap(path, kind, "r", header.end(), (height, width, channels))
        self._spec = oiio.ImageSpec(width, height, channels, "float")
        self._spec.channelnames = ("Y",) if channels == 1 else ("R", "G", "B")

    def format_name(self) -> str:
        """Return the name of the format."""
        return "pfm"

    def seek_subimage(self, index: int, level: int) -> bool:
        """Return whether this part exists; a file has exactly one."""
        return index == 0 and level == 0

    def spec(self) -> oiio.ImageSpec:
        """Return width, height and channels."""
        return self._spec

    def read_scanlines(
        self, part: int, level: int, top: int, bottom: int, z: int, first: int, last: int, kind: str
    ) -> NDArray[np.float32]:
        """Return rows ``top`` to ``bottom``, from the top, of the channels ``first`` up to ``last``."""
        upwards = self._rows[len(self._rows) - bottom : len(self._rows) - top, :, first:last]
        return np.ascontiguousarray(upwards[::-1], np.float32)

    def geterror(self) -> str:
        """Return an empty message: the constructor has checked everything that can fail."""
        return ""

    def close(self) -> bool:
        """Close the file."""
        del self._rows
        return True


def write_pfm(path: Path, shape: tuple[int, int, int], stored: Callable[[slice], NDArray[Any]]) -> None:
    """Write a portable float map, least significant byte first.

    Args:
        path: File to overwrite.
        shape: (H, W, C), C = 1 or 3.
        stored: Function from rows, counted from the top, to their values (rows, W, C).
    """
    height, width, channels = shape
    letters = next(letters for letters, count in _KINDS.items() if count == channels)
    with path.open("wb") as file:
        file.write(letters + f"\n{width} {height}\n-1.0\n".encode())
        for bottom in range(height, 0, -_BAND_ROWS):
            rows = stored(slice(max(0, bottom - _BAND_ROWS), bottom))
            file.write(np.ascontiguousarray(rows[::-1], "<f4").tobytes())
