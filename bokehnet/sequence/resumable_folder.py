"""Folders for the intermediate results of a run, so that the same command can resume it."""

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
from bokehnet.io.files.atomic import remove_leftovers, write_text

__all__ = ["claim_folder", "exclusive_folder", "file_signature"]

_JOB_FILE, _LOCK_FILE = "job.txt", "lock"


def file_signature(path: Path) -> list[Any]:
    """Return path, size and modification time, which identify a version of a file."""
    state = path.stat()
    return [str(path.resolve()), state.st_size, state.st_mtime_ns]


def claim_folder(folder: Path, job: Mapping[str, Any]) -> None:
    """Create a folder, and empty it unless it belongs to the same job.

    Args:
        folder: Folder that no other process uses.
        job: All inputs that the results depend on, as plain values.

    Raises:
        ImageFileError: The folder cannot be created.
    """
    digest = hashlib.sha256(json.dumps(job, sort_keys=True, default=str).encode()).hexdigest()
    mark = folder / _JOB_FILE
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
def exclusive_folder(folder: Path) -> Iterator[Path]:
    """Yield a locked folder: this one, or the first free one with a number appended to its name.

    The folder remains for the next process; the block may remove it with ``shutil.rmtree``.

    Raises:
        ImageFileError: The folder cannot be created.
    """
    for number in itertools.count(1):
        path = folder if number == 1 else folder.with_name(f"{folder.name}-{number}")
        try:
            path.mkdir(parents=True, exist_ok=True)
            lock = _lock(path / _LOCK_FILE)
        except OSError as error:
            raise _unusable(path, error) from error
        if lock is not None:
            with lock:
                yield path
            return


def _lock(path: Path) -> IO[str] | None:
    """Return a file that is locked by this process until closed; None if another process holds the lock."""
    try:
        fcntl: Any = importlib.import_module("fcntl")
    except ImportError:  # Windows
        return path.open("a", encoding="utf-8")
    try:
        file = path.open("a", encoding="utf-8")
    except FileNotFoundError:  # the folder was removed in the meantime
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
    if not same:  # the previous owner has removed it
        file.close()
        return None
    return file


def _unusable(folder: Path, error: OSError) -> ImageFileError:
    reason = error.strerror or str(error)
    return ImageFileError(f"{folder}: expected a folder for intermediate results, found: {reason}")
