"""Pictures in memory: encoded bytes and binary streams, read and written through a temporary file.

The decoders and encoders work on files, whose content they check and whose metadata they read.
"""

import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from bokehnet.errors import ImageFileError, ParameterError

__all__ = ["Buffer", "is_buffer", "picture_file", "write_to_stream"]

# Encoded picture, or a binary stream of one.
Buffer = bytes | bytearray | memoryview | BinaryIO

# Extension by the first bytes of a file, and by the bytes from the fifth on for ISO base media files.
_SIGNATURES = {
    b"\x89PNG": ".png",
    b"\xff\xd8\xff": ".jpg",
    b"II*\0": ".tif",
    b"MM\0*": ".tif",
    b"\x76\x2f\x31\x01": ".exr",
    b"RIFF": ".webp",
    b"#?R": ".hdr",
    b"PF": ".pfm",
    b"Pf": ".pfm",
    b"\xff\x0a": ".jxl",
    b"\0\0\0\x0cJXL": ".jxl",
}
_BRANDS = {b"ftypavif": ".avif", b"ftypheic": ".heic", b"ftypheix": ".heic", b"ftypmif1": ".heic"}


def is_buffer(source: object) -> bool:
    """Return whether an object is an encoded picture in memory, or a binary stream."""
    return isinstance(source, bytes | bytearray | memoryview) or hasattr(source, "read")


@contextmanager
def picture_file(source: Buffer) -> Iterator[Path]:
    """Provide a temporary file with an encoded picture; a stream is read from its start if it can seek.

    Raises:
        ImageFileError: The content is no picture of a known format.
        ParameterError: The stream is a text stream.
    """
    if isinstance(source, bytes | bytearray | memoryview):
        data: bytes | bytearray | memoryview = source
    else:
        if source.seekable():
            source.seek(0)
        data = source.read()
    if isinstance(data, str):
        raise ParameterError("picture", "a binary stream", shown="a text stream", remedy='open it with "rb"')
    data = bytes(data)
    known = (extension for start, extension in _SIGNATURES.items() if data.startswith(start))
    extension = next(known, _BRANDS.get(data[4:12]))
    if extension is None:
        start = data[:8].hex(" ") or "nothing"
        raise ImageFileError(f"expected an encoded picture such as PNG, JPEG or EXR, found bytes {start}")
    with tempfile.TemporaryDirectory(prefix="bokehnet-") as folder:
        path = Path(folder) / f"picture{extension}"
        path.write_bytes(data)
        yield path


def write_to_stream(stream: BinaryIO, extension: str | None, write: Callable[[Path], None]) -> None:
    """Let ``write`` write a file with an extension, and copy it to a binary stream.

    Args:
        stream: Writable binary stream, such as ``io.BytesIO``.
        extension: Extension that selects the format, with or without its dot.
        write: Function that writes the file at a path.

    Raises:
        ParameterError: There is no extension.
    """
    if not extension:
        raise ParameterError("format", "the format of the stream, such as png", shown="none")
    with tempfile.TemporaryDirectory(prefix="bokehnet-") as folder:
        path = Path(folder) / f"picture.{os.path.basename(extension).lstrip('.').lower()}"
        write(path)
        stream.write(path.read_bytes())
