"""Description of the content of an image file."""

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bokehnet.errors import ImageFileError
from bokehnet.io.color.file_color import file_color_space
from bokehnet.io.depth.numpy_maps import NUMPY_EXTENSIONS, array_names, read_numpy_map
from bokehnet.io.formats.heif import is_avif, is_heif, read_heif
from bokehnet.io.gain_map import read_gain_map
from bokehnet.io.metadata.gain_map import gain_map_kind
from bokehnet.io.metadata.photo_metadata import read_metadata
from bokehnet.io.phone_depth import read_phone_depth
from bokehnet.io.pixels import ImageFile
from bokehnet.io.selection.map_channels import depth_channels
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
    cover all parts; ``ranges`` holds depth-like channels only. ``depth_map`` and ``gain_map`` describe the
    maps that phones store beside the picture; both are empty if there are none. ``pixel_aspect`` is width
    over height of a displayed pixel. Of a NumPy file, ``channels`` are its arrays, ``ranges`` holds all that
    are maps, in stored numbers, and size and type are those of the first.
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
    depth_map: str = ""
    gain_map: str = ""
    pixel_aspect: float = 1.0


def image_info(path: Path | str, progress: Progress | None = None) -> ImageInfo:
    """Describe an image file. All pixels are decoded, so damage anywhere in the file is detected.

    Args:
        path: JPEG, PNG, TIFF, WebP, JPEG XL, EXR, HDR or PFM file; HEIC and HEIF with the extra ``heif``,
            AVIF with the extra ``avif``. ``.npy`` or ``.npz``.
        progress: Progress callback; the count restarts for each part and each group of channels.

    Raises:
        ImageFileError: The file cannot be read.
    """
    if Path(path).suffix.lower() in NUMPY_EXTENSIONS:
        return _numpy_info(Path(path))
    if is_heif(path):
        return _heif_info(Path(path))
    with ImageFile(path, progress) as file:
        ranges: dict[str, ChannelRange] = {}
        for part in file.parts:
            depth_names, own = depth_channels(part.channels), dict[str, ChannelRange]()
            for start in range(0, len(part.channels), 4):  # in groups: all of an EXR may not fit in memory
                names = part.channels[start : start + 4]
                for _, values in file.read_bands(part, names):
                    for i, name in enumerate(names):
                        if name in depth_names:
                            own[name] = _wider(own.get(name), _range(values[..., i]))
            ranges |= own
        first = file.parts[0]
        name, refusal = "", ""
        exif = read_metadata(file.path, file.file_format).exif
        try:
            space = file_color_space(file, first, exif)
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
            depth_map=_depth_map(file.path) if file.file_format == "jpeg" else "",
            gain_map=_gain_map(file.path, first.orientation, exif) if file.file_format == "jpeg" else "",
            pixel_aspect=first.window.pixel_aspect,
        )


def _numpy_info(path: Path) -> ImageInfo:
    names = array_names(path)
    maps: dict[str, NDArray[Any]] = {}
    for name in names:
        with suppress(ImageFileError):  # an array that is no map
            maps[name] = read_numpy_map(path, name)
    if not maps:
        maps["values"] = read_numpy_map(path)
    first = next(iter(maps.values()))
    height, width = first.shape
    return ImageInfo(
        width=width,
        height=height,
        channels=names or tuple(maps),
        pixel_type=first.dtype.name,
        file_format="npz" if names else "npy",
        color_space="",
        refusal=f"{path}: NumPy files hold maps",
        orientation=1,
        parts=1,
        ranges={name: _range(values) for name, values in maps.items()},
    )


def _heif_info(path: Path) -> ImageInfo:
    picture = read_heif(path)
    height, width = picture.image.shape[:2]
    return ImageInfo(
        width=width,
        height=height,
        channels=("R", "G", "B"),
        pixel_type=f"{picture.bits} bits",
        file_format="avif" if is_avif(path) else "heif",
        color_space=picture.space.name,
        refusal="",
        orientation=1,
        parts=1,
        ranges={},
        depth_map=_depth_map(path),
        gain_map=_gain_map(path, 1, picture.metadata.exif),
    )


def _gain_map(path: Path, orientation: int, exif: bytes | None) -> str:
    """Return a description of the gain map inside a JPEG or HEIC file; empty if there is none."""
    kind = gain_map_kind(path)
    if not kind:
        return ""
    try:
        gain_map = read_gain_map(path, orientation, exif)
    except ImageFileError as problem:
        return f"{kind}, damaged ({str(problem).removeprefix(f'{path}: ')})"
    if gain_map is None:
        return kind
    height, width = gain_map.stored.shape[:2]
    return f"{gain_map.kind}, {width} x {height} pixels, up to {gain_map.largest:.3g}x white"


def _depth_map(path: Path) -> str:
    """Return a description of the depth map inside a photo; empty if there is none."""
    try:
        depth = read_phone_depth(path)
    except ImageFileError as problem:
        return f"damaged ({str(problem).removeprefix(f'{path}: ')})"
    if depth is None:
        return ""
    height, width = depth.disparity.shape
    unit = "relative"
    if depth.metric:
        near, far = float(depth.disparity.max()), float(depth.disparity.min())
        unit = f"{_metres(near)} to {_metres(far)}"
    focus = depth.focus_disparity
    at = "no focus stored" if focus is None else "focus stored"
    if depth.metric and focus is not None:
        at = f"focus at {_metres(focus)}"
    original = "" if depth.all_in_focus is None else ", with the picture before the portrait blur"
    return f"{width} x {height} pixels, {unit}, {at}{original}"


def _metres(disparity: float) -> str:
    return "infinity" if disparity <= 0 else f"{1 / (1000 * disparity):.3g} m"


def _wider(known: ChannelRange | None, band: ChannelRange) -> ChannelRange:
    """Return the range of two bands of rows; the first one may be missing."""
    if known is None:
        return band
    return ChannelRange(
        lowest=float(np.fmin(known.lowest, band.lowest)),
        highest=float(np.fmax(known.highest, band.highest)),
        infinite=known.infinite + band.infinite,
        nan=known.nan + band.nan,
    )


def _range(values: NDArray[Any]) -> ChannelRange:
    finite = values[np.isfinite(values)]
    return ChannelRange(
        lowest=float(finite.min()) if finite.size else float("nan"),
        highest=float(finite.max()) if finite.size else float("nan"),
        infinite=int(np.isinf(values).sum()),
        nan=int(np.isnan(values).sum()),
    )
