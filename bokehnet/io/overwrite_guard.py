"""Refuse outputs that would overwrite an input, except lossless in-place formats."""

from collections.abc import Iterable
from pathlib import Path

from bokehnet.errors import ImageFileError, ParameterError
from bokehnet.io.pixels import ImageFile
from bokehnet.io.selection.picture import find_picture

__all__ = ["check_overwrite"]

_LOSSY = (".jpg", ".jpeg", ".webp", ".hdr", ".avif", ".heic", ".heif")


def check_overwrite(output: Path, picture: Path, others: Iterable[Path], *, reduced: bool = False) -> None:
    """Raise unless the result may be written at ``output``; only headers are read.

    Args:
        output: File to write.
        picture: File of the picture. An EXR may be overwritten, since everything else in the file is kept;
            PNG and TIFF if they have 8 bits, like the output.
        others: All other input files, such as maps.
        reduced: True if the result is smaller than the picture.

    Raises:
        ParameterError: ``output`` is an input that must not be overwritten.
    """
    if not output.exists():
        return
    if any(_is_same_file(output, other) for other in others) and not _is_same_file(output, picture):
        raise _overwrite_error(output, "is read for this picture")
    if not _is_same_file(output, picture):
        return
    if output.suffix.lower() in _LOSSY:
        raise _overwrite_error(output, "is the picture itself, which would be compressed with loss once more")
    if reduced:
        raise _overwrite_error(output, "is the picture itself, which is larger")
    try:
        with ImageFile(picture) as file:
            deep = find_picture(file).part.deep
            wide = file.headers is None and any(name != "uint8" for name in file.parts[0].formats)
            other = file.headers is None and output.suffix.lower() == ".exr"
    except ImageFileError:  # reported when the picture is read
        return
    if deep or wide or other:
        content = "deep samples" if deep else "another format" if other else "more than 8 bits per channel"
        raise _overwrite_error(output, f"is the picture itself, which holds {content}")


def _is_same_file(one: Path, other: Path) -> bool:
    return other.exists() and one.samefile(other)


def _overwrite_error(output: Path, reason: str) -> ParameterError:
    return ParameterError("output", f"another name: {output} {reason}", remedy="write to a new file")
