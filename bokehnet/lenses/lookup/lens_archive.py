"""Archives (.npz) of arrays traced through a lens, together with its prescription."""

import tomllib
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np

from bokehnet.config import build_config
from bokehnet.errors import ConfigError, LensError, errors_of_file
from bokehnet.lenses.prescription_file import Prescription
from bokehnet.lenses.prescription_toml import prescription_toml

__all__ = ["open_archive", "write_archive"]

_MAX_BYTES = 2**28  # of all arrays, unpacked


def write_archive(file: Path | IO[bytes], kind: str, prescription: Prescription, **arrays: Any) -> None:
    """Write named arrays and numbers of a lens, with the kind of data they are."""
    np.savez_compressed(file, kind=kind, prescription=prescription_toml(prescription), **arrays)


@contextmanager
def open_archive(path: str | Path, kind: str, what: str) -> Iterator[tuple[Any, Prescription]]:
    """Yield the arrays of a file by name, and its lens; errors inside the block become one line.

    Args:
        path: Path of the file.
        kind: Required kind of data.
        what: Name of the data, for messages.

    Raises:
        LensError: The file is missing or damaged, contains other data, or its lens is invalid.
    """
    try:
        with errors_of_file(path, f"a {kind}", LensError):
            with zipfile.ZipFile(path) as archive:
                size = sum(entry.file_size for entry in archive.infolist())
            if size > _MAX_BYTES:
                raise LensError(f"{path}: expected a {kind} of up to {_MAX_BYTES} bytes, found {size}")
            with np.load(path, allow_pickle=False) as file:
                if str(file["kind"]) != kind:
                    raise LensError(f"{path}: expected a {kind}, found {str(file['kind'])[:60]!r}")
                text = tomllib.loads(str(file["prescription"]))
                prescription = build_config(text, Prescription, f"{path}: prescription")
                yield file, prescription
    except ConfigError as error:
        raise LensError(str(error)) from error
    problem = prescription.problem()
    if problem is not None:
        raise LensError(f"{path}: {problem}")
