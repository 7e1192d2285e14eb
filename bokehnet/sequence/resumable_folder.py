"""Folders in which a run keeps what it has made until all is done, for the same command to go on with."""

import contextlib
import hashlib
import importlib
import itertools
import json
import os
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import IO, Any

from bokehnet.errors import ImageFileError
from bokehnet.io.atomic import remove_leftovers, write_text

__all__ = ["claim_folder", "own_folder", "stamp"]

_MARK, _LOCK = "job.txt", "lock"


def stamp(path: Path) -> list[Any]:
    """What tells a file from another one, or from itself before it was changed."""
    state = path.stat()
    return [str(path.resolve()), state.st_size, state.st_mtime_ns]


def claim_folder(folder: Path, told: Mapping[str, Any]) -> None:
    """Make a folder, empty unless it was made for the very same work.

    Args:
        folder: Nobody else may use it now.
        told: All that the work depends on, in plain values.

    Raises:
        ImageFileError: It cannot be made.
    """
    digest = hashlib.sha256(json.dumps(told, sort_keys=True, default=str).encode()).hexdigest()
    mark = folder / _MARK
    try:
        if mark.exists() and mark.read_text(encoding="utf-8") == digest:
            remove_leftovers(folder)
            return
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
    except OSError as error:
        raise _unusable(folder, error) from error
    write_text(mark, digest)


@contextlib.contextmanager
def own_folder(folder: Path) -> Iterator[Path]:
    """Give a folder that no other process has: this one, or the first free one with a number behind its name.

    It is kept for the next process; ``shutil.rmtree`` within the block removes it.

    Raises:
        ImageFileError: It cannot be made.
    """
    for number in itertools.count(1):
        path = folder if number == 1 else folder.with_name(f"{folder.name}-{number}")
        try:
            path.mkdir(parents=True, exist_ok=True)
            held = _locked(path / _LOCK)
        except OSError as error:
            raise _unusable(path, error) from error
        if held is not None:
            with held:
                yield path
            return


def _locked(path: Path) -> IO[str] | None:
    """A file that this process alone has locked, until it is closed; None if another one has it."""
    try:
        fcntl: Any = importlib.import_module("fcntl")
    except ImportError:  # Windows
        return path.open("a", encoding="utf-8")
    try:
        file = path.open("a", encoding="utf-8")
    except FileNotFoundError:  # its folder was removed meanwhile
        return None
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        file.close()
        return None
    except OSError:  # a file system without locks
        return file
    try:
        same = path.stat().st_ino == os.fstat(file.fileno()).st_ino
    except FileNotFoundError:
        same = False
    if not same:  # who had it has removed it
        file.close()
        return None
    return file


def _unusable(folder: Path, error: OSError) -> ImageFileError:
    reason = error.strerror or str(error)
    return ImageFileError(f"{folder}: expected a folder to keep work in, found: {reason}")
