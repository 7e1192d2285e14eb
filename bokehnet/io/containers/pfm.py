"""Portable float maps: read and written, with an alpha channel where there is one.

The header is three lines of words: what it is, width and height, and a scale whose sign tells the order of
bytes (below 0: the least significant first). Rows follow from the bottom upwards. ``Pf`` is grey, ``PF`` has
red, green and blue; ``PF4`` adds alpha, which readers of the plain format do not know.

The size of the scale, in which writers tell units of their own, is not applied: values are those in the file.

Source: Debevec, "PFM portable floatmap image format", 2001. The fourth channel is in the float maps of the
    BokehLab thesis (its 4.5, "Portable float map library"), which names no letters for it; ``PF4`` is
    chosen here.
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

_KINDS = {b"Pf": 1, b"PF": 3, b"PF4": 4}
_HEADER = re.compile(rb"(P[Ff]|PF4)\s+(\d{1,9})\s+(\d{1,9})\s+([-+0-9.eE]{1,40})\s")
_LONGEST_HEADER = 200
_BAND = 256  # rows at a time


def is_pfm(path: Path) -> bool:
    """Whether a file begins as a portable float map."""
    with path.open("rb") as file:
        return re.match(rb"(?:P[Ff]|PF4)\s", file.read(4)) is not None


class PfmInput:
    """An open portable float map, with those methods of ``OpenImageIO.ImageInput`` that are used here.

    Args:
        path: The file.

    Raises:
        ImageFileError: The header is damaged, or the file too short.
    """

    def __init__(self, path: Path) -> None:
        with path.open("rb") as file:
            head = file.read(_LONGEST_HEADER)
        found = _HEADER.match(head)
        try:
            scale = float(found[4]) if found else 0.0
        except ValueError:
            scale = 0.0
        width, height = (int(found[2]), int(found[3])) if found else (0, 0)
        if found is None or not width or not height or not abs(scale) > 0:
            raise ImageFileError(
                f"{path}: expected PFM (Pf, PF or PF4, width, height, scale), found a damaged header"
            )
        channels = _KINDS[found[1]]
        needed, size = found.end() + 4 * width * height * channels, path.stat().st_size
        if size < needed:
            raise ImageFileError(f"{path}: the PFM file is truncated: expected {needed} bytes, found {size}")
        kind = "<f4" if scale < 0 else ">f4"
        self._rows = np.memmap(path, kind, "r", found.end(), (height, width, channels))
        self._spec = oiio.ImageSpec(width, height, channels, "float")
        self._spec.channelnames = ("Y",) if channels == 1 else tuple("RGBA"[:channels])
        self._spec.alpha_channel = 3 if channels == 4 else -1

    def format_name(self) -> str:
        """Return the name of the format."""
        return "pfm"

    def seek_subimage(self, index: int, level: int) -> bool:
        """Tell whether there is such a part; there is one."""
        return index == 0 and level == 0

    def spec(self) -> oiio.ImageSpec:
        """Return width, height and channels."""
        return self._spec

    def read_scanlines(
        self, part: int, level: int, top: int, bottom: int, z: int, first: int, last: int, kind: str
    ) -> NDArray[np.float32]:
        """Return some rows, counted from the top, of the channels from ``first`` up to ``last``."""
        upwards = self._rows[len(self._rows) - bottom : len(self._rows) - top, :, first:last]
        return np.ascontiguousarray(upwards[::-1], np.float32)

    def geterror(self) -> str:
        """Return nothing: all that can fail has been looked at."""
        return ""

    def close(self) -> bool:
        """Let the file go."""
        del self._rows
        return True


def write_pfm(path: Path, shape: tuple[int, int, int], stored: Callable[[slice], NDArray[Any]]) -> None:
    """Write a portable float map, the least significant byte first.

    Args:
        path: Of the file, overwritten.
        shape: (H, W, C), C = 1, 3 or 4.
        stored: Gives some of the rows, (rows, W, C), counted from the top.
    """
    height, width, channels = shape
    letters = next(letters for letters, count in _KINDS.items() if count == channels)
    with path.open("wb") as file:
        file.write(letters + f"\n{width} {height}\n-1.0\n".encode())
        for bottom in range(height, 0, -_BAND):
            rows = stored(slice(max(0, bottom - _BAND), bottom))
            file.write(np.ascontiguousarray(rows[::-1], "<f4").tobytes())
