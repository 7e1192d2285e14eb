"""Maps in NumPy files, ``.npy`` and ``.npz``, as depth networks and data sets store them."""

import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bokehnet.errors import ImageFileError, errors_of_file
from bokehnet.io.containers.input_checks import check_intact, check_pixel_count

__all__ = ["NUMPY_EXTENSIONS", "array_names", "numpy_map_header", "read_numpy_map"]

NUMPY_EXTENSIONS = (".npy", ".npz")

# Names of arrays in a .npz file, best first.
_NAMES = ("depth", "disparity", "disp", "depth_map", "inverse_depth", "z", "arr_0")

_MAX_BYTES_PER_VALUE = 8


def read_numpy_map(path: Path, channel: str | None = None) -> NDArray[Any]:
    """Return the map in a NumPy file, (H, W), in its own type; axes of length 1 are removed.

    Args:
        path: File with one array, or ``.npz`` with several.
        channel: Name of the array in a ``.npz`` file; default: the only one, or depth or disparity.

    Raises:
        ImageFileError: The file is damaged, too large, holds objects, or no map can be chosen.
    """
    with _opened_map(path, channel) as (file, size):
        return _read_array(path, file, size)


def numpy_map_header(path: Path, channel: str | None = None) -> tuple[int, int, np.dtype[Any]]:
    """Return height, width and type of the map that :func:`read_numpy_map` returns; reads its header only.

    Args:
        path: See :func:`read_numpy_map`.
        channel: See :func:`read_numpy_map`.

    Raises:
        ImageFileError: As :func:`read_numpy_map`, except for values that are missing in a ``.npz`` file.
    """
    with _opened_map(path, channel) as (file, size):
        header = _read_header(path, file, size)
    return header.height, header.width, header.dtype.newbyteorder("=")


def array_names(path: Path) -> tuple[str, ...]:
    """Return the names of the arrays in a ``.npz`` file, that of its map first; none for other files.

    Args:
        path: File with one array, or ``.npz`` with several.

    Raises:
        ImageFileError: The file is missing or damaged.

    Examples:
        >>> np.savez("maps.npz", error=np.zeros((2, 3)), depth=np.ones((2, 3)))
        >>> array_names(Path("maps.npz"))
        ('depth', 'error')
    """
    check_intact(path)
    with errors_of_file(path, "a NumPy array", ImageFileError):
        if not zipfile.is_zipfile(path):
            return ()
        with zipfile.ZipFile(path) as archive:
            names = _names_in(archive)
    best = _choose(names)
    return tuple(sorted(names, key=lambda name: name != best))


@contextmanager
def _opened_map(path: Path, channel: str | None) -> Iterator[tuple[IO[bytes], int]]:
    """Yield the array of a map as a file, and its size in bytes."""
    check_intact(path)
    with errors_of_file(path, "a NumPy array", ImageFileError), path.open("rb") as file:
        if not zipfile.is_zipfile(file):
            file.seek(0)
            yield file, path.stat().st_size
            return
        file.seek(0)
        with zipfile.ZipFile(file) as archive:
            info = _member(path, archive, channel)
            with archive.open(info) as member:
                yield member, info.file_size


def _member(path: Path, archive: zipfile.ZipFile, channel: str | None) -> zipfile.ZipInfo:
    """Return the entry of the map in a ``.npz`` file."""
    names = _names_in(archive)
    name = channel if channel is not None else _choose(names)
    if name is None or name not in names:
        shown = ", ".join(names) or "nothing"
        expected = "one array" if channel is None else f"the array {channel!r}"
        raise ImageFileError(f"{path}: expected {expected}, found {shown}; name one as `input.channel`")
    return archive.infolist()[names.index(name)]


def _names_in(archive: zipfile.ZipFile) -> list[str]:
    return [info.filename.removesuffix(".npy") for info in archive.infolist()]


def _choose(names: list[str]) -> str | None:
    if len(names) == 1:
        return names[0]
    by_name = {name.lower(): name for name in names}
    return next((by_name[name] for name in _NAMES if name in by_name), None)


class _Header(NamedTuple):
    """Shape and type of a map; ``by_columns`` if its columns are stored one by one."""

    height: int
    width: int
    by_columns: bool
    dtype: np.dtype[Any]


def _read_array(path: Path, file: IO[bytes], size: int) -> NDArray[Any]:
    """Read an array of ``size`` bytes, header included, after checking what the header announces."""
    height, width, by_columns, dtype = _read_header(path, file, size)
    count = height * width
    data = file.read(count * dtype.itemsize)
    if len(data) < count * dtype.itemsize:
        raise ImageFileError(f"{path}: the array is truncated")
    values = np.frombuffer(data, dtype).reshape((height, width), order="F" if by_columns else "C")
    return values.astype(dtype.newbyteorder("="), copy=False)


def _read_header(path: Path, file: IO[bytes], size: int) -> _Header:
    """Read the header of a map of ``size`` bytes, header included."""
    version = np.lib.format.read_magic(file)
    read_header = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }.get(version)
    if read_header is None:
        raise ImageFileError(f"{path}: expected a NumPy file of version 1 or 2, found {version}")
    shape, by_columns, dtype = read_header(file)
    sides = [side for side in shape if side != 1]
    if len(sides) < 2 and len(shape) == 2:  # a map of one row, one column or one pixel
        sides = list(shape)
    if len(sides) != 2 or min(sides) < 1 or dtype.kind not in "fiub":
        raise ImageFileError(
            f"{path}: expected an array of numbers (H, W), found {dtype} of shape {tuple(shape)}"
        )
    check_pixel_count(path, sides[1], sides[0])
    count = sides[0] * sides[1]
    if dtype.itemsize > 2 * _MAX_BYTES_PER_VALUE or count * dtype.itemsize > size:
        raise ImageFileError(f"{path}: the array is truncated: {count} values announced in {size} bytes")
    return _Header(sides[0], sides[1], by_columns, dtype)
