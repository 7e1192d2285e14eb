"""Atomic file writes: a crash or a full disk leaves no partial file and keeps the previous one."""

import contextlib
import os
import secrets
import shutil
from collections.abc import Callable
from pathlib import Path

from bokehnet.errors import BokehnetError, ImageFileError

__all__ = ["check_target", "folder_problem", "remove_leftovers", "write_atomic", "write_bytes", "write_text"]

_PREFIX = ".bokehnet-"


def check_target(path: Path | str, *, error: type[BokehnetError] = ImageFileError) -> None:
    """Raise ``error`` unless a file can be written at ``path``; leaves nothing behind.

    Args:
        path: File to write; its folder must exist and be writable, and so must an existing file.
        error: Class of the raised error.
    """
    _check_name(Path(path), error)
    if problem := folder_problem(Path(os.path.realpath(path)).parent):
        raise error(f"{path}: {problem}")


def folder_problem(folder: Path) -> str:
    """Return in a few words why no file can be created in a folder; empty if one can.

    Creates an empty hidden file and removes it: permission bits neither bind an administrator nor describe
    file systems that are read-only or full.

    Args:
        folder: Existing folder.

    Examples:
        >>> folder_problem(Path())
        ''
    """
    probe = folder / f"{_PREFIX}{secrets.token_hex(6)}"
    try:
        probe.touch(exist_ok=False)
        probe.unlink()
    except OSError as problem:
        return f"the folder {folder} is not writable: {problem.strerror or problem}"
    return ""


def _check_name(path: Path, error: type[BokehnetError]) -> None:
    """Raise unless the folder exists, and a file in it can have the name or be replaced."""
    folder = path.parent
    if path.is_dir():
        raise error(f"{path}: expected the name of a file to write, found a folder")
    if path.exists() and not path.is_file():
        raise error(f"{path}: exists and is not a regular file, will not replace it")
    if not folder.is_dir():
        state = "is not a folder" if folder.exists() else "does not exist"
        raise error(f"{path}: the folder {folder} {state}; create it first")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise error(f"{path}: the folder {folder} is not writable")
    if path.exists() and not os.access(path, os.W_OK):
        raise error(f"{path}: the file exists and is write-protected")


def write_atomic(
    path: Path | str,
    write: Callable[[Path], None],
    *,
    error: type[BokehnetError] = ImageFileError,
    room: int = 0,
) -> None:
    """Let ``write`` fill a temporary file in the folder of ``path``, then rename it in one step.

    The temporary file is hidden, has the same extension and is flushed to disk before the rename. On any
    failure it is removed and an existing file remains unchanged. The new file gets the mode of the replaced
    file, otherwise the mode from the umask; a symbolic link is followed, not replaced.

    Args:
        path: File to write.
        write: Callback that fills the file at the path it receives; that file exists and is empty.
        error: Class of the error that replaces an ``OSError``.
        room: Bytes that must be free before ``write`` is called, for encoders that crash on a full disk; 0
            skips the check.

    Raises:
        BokehnetError: Of class ``error``, if the file cannot be written; other exceptions of ``write``
            than ``OSError`` pass through.
    """
    _check_name(Path(path), error)
    target = Path(os.path.realpath(path))
    temporary = target.with_name(f"{_PREFIX}{secrets.token_hex(6)}{target.suffix}")
    try:
        _create(temporary, room)
        write(temporary)
        _flush(temporary)
        if target.exists():
            shutil.copymode(target, temporary)
        os.replace(temporary, target)
        _flush_folder(target.parent)
    except BaseException as problem:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
        if isinstance(problem, OSError) and not isinstance(problem, BokehnetError):
            reason = problem.strerror or str(problem)
            raise error(f"{path}: cannot be written, any older file is kept: {reason}") from problem
        raise


def write_text(path: Path | str, text: str, *, error: type[BokehnetError] = ImageFileError) -> None:
    """Write ``text`` as UTF-8 through :func:`write_atomic`."""

    def write(temporary: Path) -> None:
        temporary.write_text(text, encoding="utf-8")

    write_atomic(path, write, error=error)


def write_bytes(path: Path | str, content: bytes, *, error: type[BokehnetError] = ImageFileError) -> None:
    """Write ``content`` through :func:`write_atomic`."""

    def write(temporary: Path) -> None:
        temporary.write_bytes(content)

    write_atomic(path, write, error=error)


def remove_leftovers(folder: Path) -> None:
    """Remove temporary files that killed processes left in ``folder``; no other process may write there."""
    for leftover in folder.glob(f"{_PREFIX}*"):
        leftover.unlink()


def _create(temporary: Path, room: int) -> None:
    """Create an empty file after checking that ``room`` bytes fit on the disk."""
    with temporary.open("xb") as file:
        if room:
            if hasattr(os, "posix_fallocate"):
                os.posix_fallocate(file.fileno(), 0, room)
            else:
                file.write(bytes(room))
                file.flush()
            file.truncate(0)


def _flush(file: Path) -> None:
    with file.open("r+b") as handle:
        os.fsync(handle.fileno())


def _flush_folder(folder: Path) -> None:
    if os.name == "posix":  # other systems cannot open a folder
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
