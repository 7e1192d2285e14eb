"""Text files of lens programs in any of their encodings."""

import codecs
from pathlib import Path

from bokehnet.errors import LensError

__all__ = ["number", "read_lines"]

_MAX_BYTES = 64 * 2**20  # glass catalogues are a few MB
_MARKS = ((codecs.BOM_UTF8, "utf-8-sig"), (codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16"))


def read_lines(path: Path) -> list[str]:
    """Return the lines of a file: UTF-8 or UTF-16 with or without a byte order mark, else Latin-1.

    Raises:
        LensError: The file cannot be read, is too large, or is not text.
    """
    try:
        size = path.stat().st_size
        if size > _MAX_BYTES:
            raise LensError(f"{path}: expected a lens file of up to {_MAX_BYTES} bytes, got {size}")
        data = path.read_bytes()
    except OSError as error:
        raise LensError(f"cannot read {path}: {error.strerror or error}") from error
    encoding = next((name for mark, name in _MARKS if data.startswith(mark)), None)
    if encoding is None and len(data) > 3:
        # Latin letters in UTF-16 without a byte order mark: every other byte is 0.
        encoding = {(False, True): "utf-16-le", (True, False): "utf-16-be"}.get((data[0] == 0, data[1] == 0))
    if encoding is None and b"\0" in data[:4096]:
        raise LensError(f"{path}: expected text, got binary data")
    for candidate in [encoding] if encoding else ["utf-8", "latin-1"]:
        try:
            return data.decode(candidate).splitlines()
        except UnicodeDecodeError:
            continue
    raise LensError(f"{path}: expected text, got binary data")


def number(text: str) -> float:
    """Return a number; accepts Fortran's D as an exponent.

    Raises:
        ValueError: ``text`` is not a number.
    """
    return float(text.upper().replace("D", "E") if "INF" not in text.upper() else text)
