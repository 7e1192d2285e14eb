"""Lines of a text file in whatever encoding a lens program wrote it."""

import codecs
from pathlib import Path

from bokehnet.errors import LensError

__all__ = ["number", "read_lines"]

_LARGEST = 64 * 2**20  # bytes; catalogues of glasses are a few MB
_MARKS = ((codecs.BOM_UTF8, "utf-8-sig"), (codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16"))


def read_lines(path: Path) -> list[str]:
    """Return the lines of a file: UTF-8 or 16 with or without a mark, else Latin.

    Raises:
        LensError: It cannot be read, is too large, or is no text.
    """
    try:
        size = path.stat().st_size
        if size > _LARGEST:
            raise LensError(f"{path}: expected a lens file of up to {_LARGEST} bytes, got {size}")
        data = path.read_bytes()
    except OSError as error:
        raise LensError(f"cannot read {path}: {error.strerror or error}") from error
    encoding = next((name for mark, name in _MARKS if data.startswith(mark)), None)
    if encoding is None and len(data) > 3:
        # Latin letters in UTF-16 without a mark: every other byte is 0.
        encoding = {(False, True): "utf-16-le", (True, False): "utf-16-be"}.get((data[0] == 0, data[1] == 0))
    if encoding is None and b"\0" in data[:4096]:
        raise LensError(f"{path}: expected text, got bytes of something else")
    for one in [encoding] if encoding else ["utf-8", "latin-1"]:
        try:
            return data.decode(one).splitlines()
        except UnicodeDecodeError:
            continue
    raise LensError(f"{path}: expected text, got bytes of something else")


def number(text: str) -> float:
    """Return a number; ``ValueError`` for what is none. Fortran's D is an E."""
    return float(text.upper().replace("D", "E") if "INF" not in text.upper() else text)
