"""Encode arrays as image files."""

import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio  # noqa: N813
from numpy.typing import NDArray

from bokehnet.arrays.row_blocks import make_in_row_blocks
from bokehnet.errors import ImageFileError
from bokehnet.io.containers.pfm import write_pfm
from bokehnet.io.containers.png import write_png
from bokehnet.io.files.atomic import write_atomic
from bokehnet.io.pixels import ImageFile
from bokehnet.progress import Progress, part_of

__all__ = ["check_readable", "encode"]

_BAND_ROWS = 256  # enough for the encoders' own threads


def encode(
    path: Path,
    shape: tuple[int, int, int],
    dtype: Any,
    stored: Callable[[slice], NDArray[Any]],
    channels: Sequence[str],
    attributes: Mapping[str, Any],
    *,
    chunks: Sequence[tuple[bytes, bytes]] = ((b"sRGB", b"\0"),),
    finish: Callable[[Path], None] | None = None,
    progress: Progress | None = None,
) -> None:
    """Encode a picture band by band and put it in place atomically.

    Args:
        path: File to write; the extension selects the format.
        shape: (H, W, C).
        dtype: Type in the file: float32, float16, uint8 or uint16.
        stored: Function from rows to their stored values, (rows, W, C), in any type that can be converted;
            called by several threads.
        channels: Names of the channels.
        attributes: Attributes of the file, such as its compression.
        chunks: Chunks of a PNG file before its pixels.
        finish: Callback that adds to the file after its pixels are written.
        progress: Progress callback, called by several threads.

    Raises:
        ImageFileError: The file cannot be written.
    """
    verified = path.suffix.lower() not in (".png", ".pfm")
    if progress is not None:
        stored = _counted(stored, shape[0], part_of(progress, 0, 2) if verified else progress)
    if path.suffix.lower() == ".png":
        write_atomic(path, lambda temporary: write_png(temporary, shape, dtype, stored, chunks))
        return
    if path.suffix.lower() == ".pfm":
        write_atomic(path, lambda temporary: write_pfm(temporary, shape, stored))
        return
    kind = {"float16": "half", "float32": "float"}.get(np.dtype(dtype).name, np.dtype(dtype).name)
    spec = oiio.ImageSpec(shape[1], shape[0], shape[2], kind)
    spec.channelnames = tuple(channels)
    if path.suffix.lower() in (".exr", ".tif", ".tiff"):
        spec.attribute("DateTime", "")  # otherwise the current time is added, and files are not reproducible
    for name, value in attributes.items():
        if isinstance(value, bytes):
            spec.attribute(name, oiio.TypeDesc(f"uint8[{len(value)}]"), np.frombuffer(value, np.uint8))
        elif isinstance(value, tuple):
            spec.attribute(name, oiio.TypeDesc(f"float[{len(value)}]"), value)
        else:
            spec.attribute(name, value)

    def fill(temporary: Path) -> None:
        output = oiio.ImageOutput.create(str(temporary))
        if output is None or not output.open(str(temporary), spec):
            raise OSError(output.geterror() if output else oiio.geterror())
        written = True
        for top in range(0, shape[0], _BAND_ROWS):
            bottom = min(top + _BAND_ROWS, shape[0])
            band = _make_band(stored, top, (bottom - top, *shape[1:]), dtype)
            written = written and output.write_scanlines(top, bottom, 0, band)
        problem = output.geterror()
        closed = output.close()
        if not (written and closed) or problem:
            raise OSError(problem or output.geterror())
        if finish is not None:
            finish(temporary)
        check_readable(temporary, progress=part_of(progress, 1, 2))

    # On a full disk the encoders crash or hang, so free space is checked first; none needs more than this.
    room = shape[0] * shape[1] * shape[2] * np.dtype(dtype).itemsize
    write_atomic(path, fill, room=room * 3 // 2 + 2**16)


def _counted(
    stored: Callable[[slice], NDArray[Any]], height: int, progress: Progress | None
) -> Callable[[slice], NDArray[Any]]:
    """Return ``stored`` with a progress report of the requested rows; some are requested twice."""
    lock, count = threading.Lock(), 0

    def counted(rows: slice) -> NDArray[Any]:
        nonlocal count
        values = stored(rows)
        with lock:
            count = min(count + len(values), height)
            if progress is not None:
                progress(count, height)
        return values

    return counted


def _make_band(
    stored: Callable[[slice], NDArray[Any]], top: int, shape: tuple[int, ...], dtype: Any
) -> NDArray[Any]:
    """Return the rows of a picture that begin at ``top``."""

    def make(rows: slice) -> NDArray[Any]:
        return stored(slice(top + rows.start, top + rows.stop))

    return make_in_row_blocks(make, shape, dtype)


def check_readable(path: Path, part: int = 0, progress: Progress | None = None) -> None:
    """Raise ``OSError`` unless the pixels can be read: encoders do not report every failed last write."""
    try:
        with ImageFile(path, progress) as file:
            parts = file.parts[part]
            for rows in file.bands(parts):
                file.read_stored(parts, rows)
    except ImageFileError as damage:
        raise OSError("what was written cannot be read back; is the disk full?") from damage
