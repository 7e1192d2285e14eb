"""Files that are complete or absent, never half written."""

import os
import tempfile
from collections.abc import Callable
from pathlib import Path

from bokehnet.errors import BokehnetError, ImageFileError

__all__ = ["write_atomic"]


def write_atomic(
    path: str | Path, write: Callable[[Path], object], *, error: type[BokehnetError] = ImageFileError
) -> None:
    """Let ``write`` fill a temporary file beside ``path``, then put it in place of ``path``.

    Whatever goes wrong, a crash or a full disk included, an older file at ``path`` stays as it was.

    Args:
        path: Target file; its folder must exist.
        write: Called with the temporary path, which has the suffix of ``path``.
        error: Raised, with one line, when the operating system refuses.
    """
    path = Path(path)
    temporary: Path | None = None
    try:
        handle, name = tempfile.mkstemp(prefix=f".{path.stem[:40]}-", suffix=path.suffix, dir=path.parent)
        os.close(handle)
        temporary = Path(name)
        write(temporary)
        with temporary.open("rb+") as file:
            os.fsync(file.fileno())
        mask = os.umask(0)
        os.umask(mask)
        temporary.chmod(0o666 & ~mask)
        temporary.replace(path)
    except BokehnetError:
        raise
    except OSError as problem:
        raise error(f"cannot write {path}: {problem.strerror or problem}") from problem
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)
