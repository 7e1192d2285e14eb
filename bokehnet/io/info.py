"""Description of the content of an image file."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bokehnet.errors import ImageFileError
from bokehnet.io.color.file_color import file_color_space
from bokehnet.io.maps import depth_channels
from bokehnet.io.metadata.photo_metadata import read_metadata
from bokehnet.io.pixels import ImageFile
from bokehnet.progress import Progress

__all__ = ["ChannelRange", "ImageInfo", "image_info"]


@dataclass(frozen=True, kw_only=True)
class ChannelRange:
    """Smallest and largest finite value of a stored channel; both NaN if no value is finite."""

    lowest: float
    highest: float
    infinite: int
    nan: int


@dataclass(frozen=True, kw_only=True)
class ImageInfo:
    """Size, channels, colour space and value ranges of an image file.

    ``width`` and ``height`` are pixels of the upright picture, ``orientation`` is the EXIF tag that was
    applied (1: none). ``color_space`` is ``"linear"``, or the space that decodes the file: ``"sRGB"``, or
    the name in its colour profile; it is empty if the profile is damaged or its kind is unsupported, and
    ``refusal`` gives the reason why such a file cannot be read as a picture. ``channels`` and ``ranges``
    cover all parts; ``ranges`` holds depth-like channels only. ``pixel_aspect`` is width over height
    of a displayed pixel.
    """

    width: int
    height: int
    channels: tuple[str, ...]
    pixel_type: str
    file_format: str
    color_space: str
    refusal: str
    orientation: int
    parts: int
    ranges: dict[str, ChannelRange]
    pixel_aspect: float = 1.0


def image_info(path: Path | str, progress: Progress | None = None) -> ImageInfo:
    """Describe an image file. All pixels are decoded, so damage anywhere in the file is detected.

    Args:
        path: JPEG, PNG, TIFF, WebP, JPEG XL, EXR, HDR or PFM file.
        progress: Progress callback; the count restarts for each part and each group of channels.

    Raises:
        ImageFileError: The file cannot be read.
    """
    with ImageFile(path, progress) as file:
        ranges: dict[str, ChannelRange] = {}
        for part in file.parts:
            depth_names = depth_channels(part.channels)
            for start in range(0, len(part.channels), 4):  # in groups: all of an EXR may not fit in memory
                names = part.channels[start : start + 4]
                values = file.read(part, names)
                ranges |= {
                    name: _range(values[..., i]) for i, name in enumerate(names) if name in depth_names
                }
        first = file.parts[0]
        name, refusal = "", ""
        try:
            space = file_color_space(file, first, read_metadata(file.path, file.file_format).exif)
            name = "linear" if space.is_linear and space.icc is None else space.name
        except ImageFileError as problem:
            refusal = str(problem)
        turned = first.orientation >= 5
        return ImageInfo(
            width=first.height if turned else first.width,
            height=first.width if turned else first.height,
            channels=tuple(name for part in file.parts for name in part.channels),
            pixel_type=first.pixel_type,
            file_format=file.file_format,
            color_space=name,
            refusal=refusal,
            orientation=first.orientation,
            parts=len(file.parts),
            ranges=ranges,
            pixel_aspect=first.window.pixel_aspect,
        )


def _range(values: NDArray[np.float32]) -> ChannelRange:
    finite = values[np.isfinite(values)]
    return ChannelRange(
        lowest=float(finite.min()) if finite.size else float("nan"),
        highest=float(finite.max()) if finite.size else float("nan"),
        infinite=int(np.isinf(values).sum()),
        nan=int(np.isnan(values).sum()),
    )
