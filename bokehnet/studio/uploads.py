"""Files that the page sends: bounded in size and time, under names that lead nowhere."""

import asyncio
import re
from collections.abc import AsyncIterator
from pathlib import Path

from bokehnet.errors import BokehnetError, ImageFileError

__all__ = ["MOST_BYTES", "UploadTooLargeError", "receive", "safe_name"]

MOST_BYTES = 256 * 2**20
"""Of one upload."""

_MOST_SECONDS = 120.0
_LONGEST_NAME = 80
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
)


class UploadTooLargeError(BokehnetError):
    """More bytes, or more time, than an upload may take."""


def safe_name(name: str, extensions: tuple[str, ...] = _PICTURES) -> str:
    r"""Return the last part of a file's name with nothing in it that leads elsewhere.

    Args:
        name: As the page tells it.
        extensions: Those that are taken.

    Raises:
        ImageFileError: Another extension.

    Examples:
        >>> safe_name("../../etc/My photo;.JPG"), safe_name("..\\a.png")
        ('My_photo_.JPG', 'a.png')
    """
    last = re.split(r"[/\\]", name)[-1]
    clean = re.sub(r"[^\w.-]", "_", last, flags=re.ASCII).lstrip(".-")
    stem, suffix = Path(clean).stem, Path(clean).suffix
    if suffix.lower() not in extensions or not stem:
        raise ImageFileError(f"expected a file that ends in {', '.join(extensions)}, found {last[:40]!r}")
    return stem[:_LONGEST_NAME] + suffix


async def receive(chunks: AsyncIterator[bytes], path: Path, told: str | None, most: int = MOST_BYTES) -> int:
    """Write what comes to a file and return its bytes; nothing stays of what is refused.

    Args:
        chunks: The body of the request.
        path: Where it goes.
        told: Its ``Content-Length``; None where none was told.
        most: Bytes that it may have.

    Raises:
        UploadTooLargeError: It is larger, or takes longer than two minutes.
    """
    if told is not None and told.isdigit() and int(told) > most:
        raise UploadTooLargeError(_too_large(int(told), most))
    size = 0
    try:
        async with asyncio.timeout(_MOST_SECONDS):
            with path.open("wb") as file:
                async for chunk in chunks:
                    size += len(chunk)
                    if size > most:
                        raise UploadTooLargeError(_too_large(size, most))
                    file.write(chunk)
    except TimeoutError as error:
        path.unlink(missing_ok=True)
        raise UploadTooLargeError(f"expected the file within {_MOST_SECONDS:g} s; send it again") from error
    except BaseException:
        path.unlink(missing_ok=True)
        raise
    return size


def _too_large(size: int, most: int) -> str:
    return f"expected a file of up to {most / 2**20:.0f} MiB, found {size / 2**20:.0f} MiB or more"
