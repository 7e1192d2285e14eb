"""Files (.npz) of arrays that were traced through a lens, with its prescription beside them."""

import tomllib
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np

from bokehnet.config import build_config
from bokehnet.errors import ConfigError, LensError
from bokehnet.lenses.prescription_file import Prescription
from bokehnet.lenses.prescription_toml import prescription_toml

__all__ = ["opened_archive", "write_archive"]


def write_archive(file: Path | IO[bytes], kind: str, prescription: Prescription, **arrays: Any) -> None:
    """Write arrays and numbers by name, of a lens, under the name of what they are."""
    np.savez_compressed(file, kind=kind, prescription=prescription_toml(prescription), **arrays)


@contextmanager
def opened_archive(path: str | Path, kind: str, what: str) -> Iterator[tuple[Any, Prescription]]:
    """The arrays of a file by name, and its lens; what is wrong with either inside the block is one line.

    Args:
        path: Of the file.
        kind: What it must be.
        what: A word for it, for messages.

    Raises:
        LensError: The file is missing or damaged, holds something else, or its lens cannot be.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            if str(file["kind"]) != kind:
                raise LensError(f"{path}: expected a {kind}, found {str(file['kind'])[:60]!r}")
            text = tomllib.loads(str(file["prescription"]))
            prescription = build_config(text, Prescription, f"{path}: prescription")
            yield file, prescription
    except OSError as error:
        raise LensError(f"cannot read {what} {path}: {error.strerror or error}") from error
    except (EOFError, KeyError, TypeError, ValueError, zipfile.BadZipFile) as error:
        raise LensError(f"{path}: expected a {kind}, found something else: {error}") from error
    except ConfigError as error:
        raise LensError(str(error)) from error
    problem = prescription.problem()
    if problem is not None:
        raise LensError(f"{path}: {problem}")
