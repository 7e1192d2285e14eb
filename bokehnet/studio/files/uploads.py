"""Uploads of the page: bounded in size and time, with sanitised names."""

import asyncio
import re
from collections.abc import AsyncIterator
from pathlib import Path

from bokehnet.errors import BokehnetError, ImageFileError

__all__ = ["MAX_BYTES", "UploadTooLargeError", "receive", "safe_name"]

MAX_BYTES = 256 * 2**20
"""Maximum size of one upload."""

_MAX_SECONDS = 120.0
_MAX_NAME_CHARACTERS = 80
_PICTURES = (
    ".jpg",
    ".jpeg",
    ".png",
    ".tif",
    ".tiff",
    ".webp",
    ".jxl",
    ".exr",
    ".hdr",
    ".pfm",
    ".heic",
    ".heif",
    ".avif",
)


class UploadTooLargeError(BokehnetError):
    """An upload exceeds the size or the time limit."""


def safe_name(name: str, extensions: tuple[str, ...] = _PICTURES) -> str:
    r"""Return the last part of a file's name, reduced to safe characters.

    Args:
        name: Name sent by the page.
        extensions: Accepted extensions.

    Raises:
        ImageFileError: The extension is not accepted.

    Examples:
        >>> safe_name("../../etc/My photo;.JPG"), safe_name("..\\a.png")
        ('My_photo_.JPG', 'a.png')
    """
    last = re.split(r"[/\\]", name)[-1]
    clean = re.sub(r"[^\w.-]", "_", last, flags=re.ASCII).lstrip(".-")
    stem, suffix = Path(clean).stem, Path(clean).suffix
    if suffix.lower() not in extensions or not stem:
        raise ImageFileError(f"expected a file that ends in {', '.join(extensions)}, found {last[:40]!r}")
    return stem[:_MAX_NAME_CHARACTERS] + suffix


async def receive(
    chunks: AsyncIterator[bytes], path: Path, content_length: str | None, max_bytes: int = MAX_BYTES
) -> int:
    """Write an upload to a file and return its size in bytes; remove the file of a rejected upload.

    Args:
        chunks: Body of the request.
        path: Output file.
        content_length: ``Content-Length`` of the request; None if missing.
        max_bytes: Maximum size.

    Raises:
        UploadTooLargeError: The upload is larger, or takes longer than two minutes.
    """
    if content_length is not None and content_length.isdigit() and int(content_length) > max_bytes:
        raise UploadTooLargeError(_too_large(int(content_length), max_bytes))
    size = 0
    try:
        async with asyncio.timeout(_MAX_SECONDS):
            with path.open("wb") as file:
                async for chunk in chunks:
                    size += len(chunk)
                    if size > max_bytes:
                        raise UploadTooLargeError(_too_large(size, max_bytes))
                    file.write(chunk)
    except TimeoutError as error:
        path.unlink(missing_ok=True)
        raise UploadTooLargeError(f"expected the file within {_MAX_SECONDS:g} s; send it again") from error
    except BaseException:
        path.unlink(missing_ok=True)
        raise
    return size


def _too_large(size: int, max_bytes: int) -> str:
    return f"expected a file of up to {max_bytes / 2**20:.0f} MiB, found {size / 2**20:.0f} MiB or more"
