"""Stored pixels of an image file by channel name, without colour conversion.

A file has one part, except for multi-part EXR. Formats are recognised by content, not by extension.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
import OpenImageIO as oiio  # noqa: N813
from numpy.typing import NDArray

import bokehnet.io.files.decoder_threads  # noqa: F401  # prepares forks
from bokehnet.errors import ImageFileError
from bokehnet.io.containers.input_checks import check_intact, check_pixel_count, check_value_count
from bokehnet.io.containers.pfm import PfmInput, is_pfm
from bokehnet.io.exr.deep import flatten
from bokehnet.io.exr.deep_chunks import DeepSamples, largest_band, read_samples
from bokehnet.io.exr.header import ExrHeaders, Value, is_exr, read_headers, sub_sampled
from bokehnet.io.window import Window, plausible_aspect
from bokehnet.progress import Progress

__all__ = [
    "READABLE_EXTENSIONS",
    "ImageFile",
    "Part",
    "apply_orientation",
    "as_stored",
]

READABLE_EXTENSIONS = (
    ".jpg",
    ".jpeg",
    ".png",
    ".tif",
    ".tiff",
    ".webp",
    ".exr",
    ".hdr",
    ".pfm",
    ".jxl",
    ".dpx",
    ".cin",
)

_FORMATS = ("jpeg", "png", "tiff", "webp", "openexr", "hdr", "pfm", "jpegxl", "dpx", "cineon")
_LINEAR_FORMATS = ("openexr", "hdr", "pfm")
_FLOAT_TYPES = ("half", "float", "double")

_TRANSPOSED = (5, 6, 7, 8)  # orientations whose stored rows are columns of the picture

# Rows per band, a multiple of the rows per chunk; fewer where rows are long, except with DWAB (256 rows).
_DEEP_SAMPLE_BYTES = 60  # memory of a deep sample while it is read
_BAND_ROWS, _MIN_BAND_ROWS, _BAND_BYTES = 256, 32, 2**27


@dataclass(frozen=True, kw_only=True)
class Part:
    """Header data of one picture in a file.

    ``width`` and ``height`` are pixels as stored, before ``orientation`` (EXIF, 1 to 8; 1 is upright).
    For EXR they are those of the data window, and ``name`` is the name of the part. ``formats`` are the types
    of the channels (``"half"``, ``"uint8"``, ...). ``alpha`` is the name of the alpha channel, and
    ``premultiplied`` is True if the colours are already multiplied by it. ``window`` holds data and display
    window. A ``deep`` part is read flattened, see :mod:`bokehnet.io.exr.deep`.
    """

    index: int
    name: str
    width: int
    height: int
    channels: tuple[str, ...]
    formats: tuple[str, ...]
    orientation: int
    alpha: str | None
    premultiplied: bool
    linear: bool
    window: Window
    deep: bool = False

    @property
    def pixel_type(self) -> str:
        """Distinct channel types, such as ``"half, float"``."""
        return ", ".join(dict.fromkeys(self.formats))

    @property
    def upright_size(self) -> tuple[int, int]:
        """Height and width of the upright pixels."""
        return (self.width, self.height) if self.orientation in _TRANSPOSED else (self.height, self.width)


class ImageFile:
    """An open image file and context manager.

    Args:
        path: JPEG, PNG, TIFF, WebP, JPEG XL, EXR, HDR or PFM file.
        progress: Progress callback, counting rows of a part.

    Raises:
        ImageFileError: The file is missing, a folder, empty, damaged, of another format, or has more pixels
            than the environment variable ``BOKEHNET_MAX_PIXELS`` allows (200 million if it is not set).
        ParameterError: That variable is not a number.
    """

    def __init__(self, path: Path | str, progress: Progress | None = None) -> None:
        self.path, self._progress = Path(path), progress
        check_intact(self.path)
        self.headers: ExrHeaders | None = read_headers(self.path) if is_exr(self.path) else None
        self._check_sampling()
        hints = oiio.ImageSpec()
        hints.attribute("oiio:UnassociatedAlpha", 1)  # return the values as stored
        opened = PfmInput(self.path) if is_pfm(self.path) else oiio.ImageInput.open(str(self.path), hints)
        if opened is None:
            raise ImageFileError(f"{self.path}: {_open_error(self.path, _message(oiio.geterror))}")
        self._input = opened
        self.file_format: str = opened.format_name()
        try:
            if self.file_format not in _FORMATS:
                raise ImageFileError(
                    f"{self.path}: expected {_known()}, found the format {self.file_format!r}"
                )
            self.parts = tuple(self._describe())
        except BaseException:
            self._input.close()
            raise

    def _check_sampling(self) -> None:
        """Raise if an EXR has sub-sampled channels, which the decoder does not support."""
        for attributes in self.headers.parts if self.headers is not None else ():
            try:
                names = sub_sampled(attributes["channels"])
            except (KeyError, ValueError) as problem:
                raise ImageFileError(f"{self.path}: the EXR header is damaged ({problem})") from problem
            if names:
                raise ImageFileError(
                    f"{self.path}: expected channels at full size, found {', '.join(names)} sub-sampled, "
                    "as luminance and chroma are; write R, G, B instead"
                )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._input.close()

    def read(self, part: Part, names: Sequence[str]) -> NDArray[np.float32]:
        """Return the channels ``names`` of ``part``, (H, W, len(names)), upright.

        Integer types are scaled to [0, 1]; floating-point values are returned unchanged.

        Raises:
            ImageFileError: The pixels are truncated or damaged.
        """
        result = self.empty(part, len(names))
        stored = as_stored(result, part.orientation)
        for rows, values in self.read_bands(part, names):
            stored[rows] = values
        return result

    def empty(self, part: Part, channels: int) -> NDArray[np.float32]:
        """Return an uninitialised array (H, W, channels) for the upright pixels of ``part``."""
        try:
            return np.empty((*part.upright_size, channels), np.float32)
        except MemoryError as full:
            raise ImageFileError(
                f"{self.path}: {part.width}x{part.height} pixels do not fit into memory"
            ) from full

    def read_bands(
        self, part: Part, names: Sequence[str], kind: str = "float"
    ) -> Iterator[tuple[slice, NDArray[Any]]]:
        """Yield the channels ``names`` as :meth:`read`, in successive bands of stored rows.

        Args:
            part: Part of this file.
            names: Channels of the part.
            kind: Type of the values, ``"float"``, or an integer type if the file stores that type.

        Yields:
            Rows of the stored picture and their values, (rows, W, len(names)).

        Raises:
            ImageFileError: The pixels are truncated or damaged.
        """
        indices = [part.channels.index(name) for name in names]
        first, last = min(indices), max(indices)
        in_order = indices == list(range(first, last + 1))
        for rows in self.bands(part):
            values = self._read_rows(part, rows, (first, last + 1), kind)
            yield rows, values if in_order else values[..., [i - first for i in indices]]

    def bands(self, part: Part) -> Iterator[slice]:
        """Yield the rows of a part in groups that end at chunk boundaries, for sequential reading."""
        spec = self.spec(part)
        tile, row_bytes = spec.tile_height, 4 * part.width * len(part.channels)
        min_rows = _BAND_ROWS if spec.get_string_attribute("compression") == "dwab" else _MIN_BAND_ROWS
        rows = min(_BAND_ROWS, max(min_rows, _BAND_BYTES // max(row_bytes, 1)))
        step = tile * max(1, rows // tile) if tile else rows // min_rows * min_rows
        for first in range(0, part.height, step):
            yield slice(first, min(first + step, part.height))

    def reading_bytes(self, part: Part) -> int:
        """Return the approximate memory in bytes to decode a part band by band, without the result."""
        rows = next(self.bands(part)).stop
        size = 2 * 4 * rows * part.width * len(part.channels)
        if part.deep and self.headers is not None:
            size += _DEEP_SAMPLE_BYTES * largest_band(self.path, self.headers, part.index, rows)
        return size

    def read_stored(self, part: Part, rows: slice) -> NDArray[np.float32]:
        """Return some rows of all channels of a part, (rows, W, C), as stored.

        Integers of EXR are returned as the float32 of the same bits, those of other formats as in
        :meth:`read`.

        Args:
            part: Part of this file.
            rows: Rows of one of :meth:`bands`.

        Raises:
            ImageFileError: The pixels are truncated or damaged.
        """
        values = self._read_rows(part, rows, (0, len(part.channels)), "float")
        for index, name in enumerate(part.formats):
            if name == "uint" and self.headers is not None:
                bits = self._read_rows(part, rows, (index, index + 1), "uint")
                values[..., index] = bits[..., 0].view(np.float32)
        return values

    def read_deep(self, part: Part, names: Sequence[str], rows: slice | None = None) -> DeepSamples:
        """Return the samples of a deep part: Z, ZBack and A if present, and ``names``.

        Raises:
            ImageFileError: The part has no Z, has coverage per colour, or is truncated or damaged.
        """
        assert self.headers is not None
        if "Z" not in part.channels or {"AR", "AG", "AB"} & set(part.channels):
            channels = ", ".join(part.channels)
            raise ImageFileError(
                f"{self.path}: expected deep samples with Z, and A for all colours, found {channels}"
            )
        needed = [name for name in part.channels if name in ("A", "Z", "ZBack", *names)]
        rows = rows or slice(0, part.height)
        return read_samples(self.path, self.headers, part.index, rows, needed)

    def _read_flattened(self, part: Part, rows: slice, names: Sequence[str]) -> NDArray[np.float32]:
        samples = self.read_deep(part, names, rows)
        try:
            flat = flatten(samples, [name for name in names if name not in ("A", "Z", "ZBack")])
        except ImageFileError as problem:
            raise ImageFileError(f"{self.path}: {problem}") from problem
        light = iter(np.moveaxis(flat.light, -1, 0))
        own = {"A": flat.coverage, "Z": flat.depth, "ZBack": flat.depth}
        return np.stack([own[name] if name in own else next(light) for name in names], axis=-1)

    def _read_rows(self, part: Part, rows: slice, channels: tuple[int, int], kind: str) -> NDArray[Any]:
        if self._progress is not None:
            self._progress(rows.start, part.height)
        if part.deep:
            return self._read_flattened(part, rows, part.channels[slice(*channels)])
        spec = self.spec(part)
        top, bottom = spec.y + rows.start, spec.y + rows.stop
        # The decoder may return a partial picture together with an error: an error always counts.
        try:
            if spec.tile_width:
                values = self._input.read_tiles(  # type: ignore[union-attr]
                    part.index, 0, spec.x, spec.x + spec.width, top, bottom, 0, 1, *channels, kind
                )
            else:
                values = self._input.read_scanlines(part.index, 0, top, bottom, 0, *channels, kind)
        except MemoryError as full:
            raise ImageFileError(
                f"{self.path}: {part.width}x{part.height} pixels do not fit into memory"
            ) from full
        problem = _message(self._input.geterror)
        if values is None or problem:
            raise ImageFileError(f"{self.path}: the pixels are truncated or damaged ({_first_line(problem)})")
        return np.ascontiguousarray(values.reshape(bottom - top, part.width, channels[1] - channels[0]))

    def spec(self, part: Part) -> oiio.ImageSpec:
        """Return the header of ``part`` from the decoder."""
        self._input.seek_subimage(part.index, 0)
        return self._input.spec()

    def attributes(self, part: Part) -> dict[str, Value]:
        """Return the metadata in the header of ``part``: numbers and texts by name.

        EXR names are those in the file; others are those of OpenImageIO, such as ``Exif:FocalLength``.
        """
        if self.headers is not None:
            stored = self.headers.parts[part.index]
            values = {name: attribute.value() for name, attribute in stored.items()}
            return {name: value for name, value in values.items() if value is not None}
        entries = {entry.name: entry.value for entry in self.spec(part).extra_attribs}
        return {name: value for name, value in entries.items() if isinstance(value, int | float | str)}

    def has_second_picture(self) -> bool:
        """Return whether a file other than EXR has a second page or frame of the size of the first.

        Smaller pages are thumbnails.
        """
        if self.headers is not None or not self._input.seek_subimage(1, 0):
            _message(self._input.geterror)
            return False
        spec, first = self._input.spec(), self.parts[0]
        return bool((spec.width, spec.height) == (first.width, first.height))

    def _describe(self) -> list[Part]:
        parts: list[Part] = []
        count = 0
        while self._input.seek_subimage(len(parts), 0):
            spec = self._input.spec()
            check_pixel_count(self.path, spec.width, spec.height)
            count += spec.width * spec.height * spec.nchannels
            check_value_count(self.path, count)
            parts.append(self._part(len(parts), spec))
            if self.file_format != "openexr":  # further pages of a TIFF are other pictures or thumbnails
                break
        _message(self._input.geterror)  # seeking beyond the last part leaves an error message behind
        if self.headers is not None and len(parts) != len(self.headers.parts):
            raise ImageFileError(
                f"{self.path}: expected {len(self.headers.parts)} parts as in the EXR header, "
                f"found {len(parts)}; the file is damaged"
            )
        return parts

    def _part(self, index: int, spec: Any) -> Part:
        formats = tuple(str(spec.channelformat(i)) for i in range(spec.nchannels))
        exr = self.file_format == "openexr"
        window = Window.whole(spec.width, spec.height)
        if exr:
            window = Window(
                x=spec.x - spec.full_x,
                y=spec.y - spec.full_y,
                width=spec.width,
                height=spec.height,
                display_width=spec.full_width,
                display_height=spec.full_height,
            )
        window = replace(window, pixel_aspect=self._pixel_aspect(spec))
        return Part(
            index=index,
            name=spec.get_string_attribute("oiio:subimagename") if exr else "",
            width=spec.width,
            height=spec.height,
            channels=tuple(spec.channelnames),
            formats=formats,
            orientation=1 if exr else spec.get_int_attribute("Orientation", 1),
            alpha=spec.channelnames[spec.alpha_channel] if spec.alpha_channel >= 0 else None,
            premultiplied=not spec.get_int_attribute("oiio:UnassociatedAlpha", 0),
            linear=self.file_format in _LINEAR_FORMATS or all(name in _FLOAT_TYPES for name in formats),
            window=window,
            deep=bool(spec.deep),
        )

    def _pixel_aspect(self, spec: Any) -> float:
        """Return width over height of a pixel by the header of EXR and TIFF; 1 if absent or implausible.

        Source: OpenEXR, "Standard Attributes", pixelAspectRatio; TIFF 6.0, XResolution and YResolution.
        """
        aspect = 1.0
        if self.file_format == "openexr":
            aspect = float(spec.get_float_attribute("PixelAspectRatio", 1.0))
        elif self.file_format == "tiff":
            across, down = (float(spec.get_float_attribute(f"{axis}Resolution", 0.0)) for axis in "XY")
            aspect = down / across if across > 0 and down > 0 else 1.0
        aspect = plausible_aspect(aspect)
        return 1 / aspect if spec.get_int_attribute("Orientation", 1) in _TRANSPOSED else aspect


def apply_orientation(values: NDArray[Any], orientation: int) -> NDArray[Any]:
    """Rotate and mirror stored rows and columns (H, W, C) to the upright picture.

    Source: CIPA DC-008, "Exchangeable image file format (Exif)", 2019, tag Orientation.
    """
    if orientation in _TRANSPOSED:
        values = values.swapaxes(0, 1)
    if orientation in (3, 4, 7, 8):
        values = values[::-1]
    if orientation in (2, 3, 6, 7):
        values = values[:, ::-1]
    return np.ascontiguousarray(values)


def as_stored(upright: NDArray[np.float32], orientation: int) -> NDArray[np.float32]:
    """Return a view of upright pixels (H, W, C) in file order; see :func:`apply_orientation`."""
    if orientation in (2, 3, 6, 7):
        upright = upright[:, ::-1]
    if orientation in (3, 4, 7, 8):
        upright = upright[::-1]
    return upright.swapaxes(0, 1) if orientation in _TRANSPOSED else upright


def _open_error(path: Path, reason: str) -> str:
    extension = path.suffix.lower()
    if extension in READABLE_EXTENSIONS:
        return (
            f"expected {extension.lstrip('.').upper()}, found a damaged or other file ({_first_line(reason)})"
        )
    return f"unknown extension {path.suffix!r} and unknown content, expected {_known()}"


def _known() -> str:
    return "one of " + ", ".join(READABLE_EXTENSIONS)


def _message(get_error: Callable[[], str]) -> str:
    """Return the message of a decoder; a damaged file may put bytes into it that are not text."""
    try:
        return get_error()
    except UnicodeDecodeError as problem:
        return problem.object.decode("utf-8", "replace")


def _first_line(message: str) -> str:
    return message.strip().splitlines()[0] if message.strip() else "the decoder gave no reason"
