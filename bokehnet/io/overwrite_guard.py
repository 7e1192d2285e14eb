"""What may be written over: nothing that is read, save a picture that loses nothing by it."""

from collections.abc import Iterable
from pathlib import Path

from bokehnet.errors import ImageFileError, ParameterError
from bokehnet.io.picture import find_picture
from bokehnet.io.pixels import ImageFile

__all__ = ["check_not_over"]

_LOSSY = (".jpg", ".jpeg", ".webp", ".hdr", ".avif", ".heic", ".heif")


def check_not_over(output: Path, picture: Path, others: Iterable[Path], *, reduced: bool = False) -> None:
    """Raise unless the result may be written at ``output``; headers are all that is read.

    Args:
        output: Where the result goes.
        picture: The picture. An EXR may be written in its place, since all else in the file stays;
            PNG and TIFF where they have 8 bits, as what is written.
        others: All other files that are read, such as maps.
        reduced: Whether the result is smaller than the picture.

    Raises:
        ParameterError: It is one of them.
    """
    if not output.exists():
        return
    if any(_same(output, other) for other in others) and not _same(output, picture):
        raise _over(output, "is read for this picture")
    if not _same(output, picture):
        return
    if output.suffix.lower() in _LOSSY:
        raise _over(output, "is the picture itself, which would be compressed with loss once more")
    if reduced:
        raise _over(output, "is the picture itself, which is larger")
    try:
        with ImageFile(picture) as file:
            deep = find_picture(file).part.deep
            wide = file.headers is None and any(name != "uint8" for name in file.parts[0].formats)
            other = file.headers is None and output.suffix.lower() == ".exr"
    except ImageFileError:  # told where it is read
        return
    if deep or wide or other:
        what = "deep samples" if deep else "another format" if other else "more than 8 bits per channel"
        raise _over(output, f"is the picture itself, which holds {what}")


def _same(one: Path, other: Path) -> bool:
    return other.exists() and one.samefile(other)


def _over(output: Path, why: str) -> ParameterError:
    return ParameterError("output", f"another name: {output} {why}", remedy="write to a new file")
