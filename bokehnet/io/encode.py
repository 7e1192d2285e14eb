"""Arrays to image files."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio  # noqa: N813
from numpy.typing import NDArray

from bokehnet.errors import ImageFileError
from bokehnet.io.atomic import write_atomic
from bokehnet.io.pixels import ImageFile

__all__ = ["check_readable", "encode"]


def encode(
    path: Path, array: NDArray[Any], channels: Sequence[str], attributes: Mapping[str, str | int]
) -> None:
    """Encode ``array`` (H, W, C) in its own type and put it in place atomically.

    Args:
        path: where the file goes; the extension picks the format.
        array: float32, float16, uint8 or uint16.
        channels: their names.
        attributes: of the file, such as its compression.

    Raises:
        ImageFileError: the file cannot be written.
    """
    kind = {"float16": "half", "float32": "float"}.get(array.dtype.name, array.dtype.name)
    spec = oiio.ImageSpec(array.shape[1], array.shape[0], array.shape[2], kind)
    spec.channelnames = tuple(channels)
    if path.suffix.lower() == ".exr":
        spec.attribute("DateTime", "")  # else the time of writing is added, and no two files are alike
    for name, value in attributes.items():
        spec.attribute(name, value)

    def fill(temporary: Path) -> None:
        output = oiio.ImageOutput.create(str(temporary))
        if output is None or not output.open(str(temporary), spec):
            raise OSError(output.geterror() if output else oiio.geterror())
        written = output.write_image(np.ascontiguousarray(array))
        problem = output.geterror()
        closed = output.close()
        if not (written and closed) or problem:
            raise OSError(problem or output.geterror())
        check_readable(temporary)

    # On a full disk the encoders crash or hang, so the room is proven first; none needs more than this.
    write_atomic(path, fill, room=array.nbytes * 3 // 2 + 2**16)


def check_readable(path: Path, part: int = 0) -> None:
    """Raise ``OSError`` unless the pixels can be read: encoders miss some failures of their last write."""
    try:
        with ImageFile(path) as file:
            found = file.parts[part]
            if file.headers is None:
                file.read(found, found.channels)
            else:
                for rows in file.bands(found):
                    file.read_stored(found, rows)
    except ImageFileError as damage:
        raise OSError("what was written cannot be read back; is the disk full?") from damage
