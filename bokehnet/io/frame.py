"""A picture with everything else its file holds, and writing a result back into such a file."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bokehnet.checks import check_choice, check_image, check_map, check_same_size
from bokehnet.deprecation import renamed_keywords
from bokehnet.errors import ImageFileError, ParameterError
from bokehnet.io.color.camera_spaces import INPUT_COLOR_SPACES
from bokehnet.io.color.color_space import LINEAR_REC709, ColorSpace
from bokehnet.io.color.file_color import FILM_FORMATS, file_color_space
from bokehnet.io.exr_splice import write_replaced
from bokehnet.io.files.atomic import write_atomic
from bokehnet.io.formats.encode import check_readable
from bokehnet.io.formats.heif import is_heif, read_heif
from bokehnet.io.formats.output_format import Bits, OutputFormat, check_format, choose_bits, target_space
from bokehnet.io.formats.store import SourceFile, store_picture
from bokehnet.io.gain_map import GainMap, read_gain_map
from bokehnet.io.image import check_extra_channels, check_writable
from bokehnet.io.metadata.camera import Camera, camera_from_exif, camera_from_exr
from bokehnet.io.metadata.photo_metadata import Metadata, read_metadata
from bokehnet.io.metadata.rendered_by import renderer_of
from bokehnet.io.pixels import ImageFile
from bokehnet.io.selection.notes import selection_notes
from bokehnet.io.selection.picture import Picture, find_picture, read_light_and_alpha
from bokehnet.io.window import Window
from bokehnet.progress import Progress, part_of

__all__ = ["Frame", "check_frame_format", "read_frame", "without_origin", "write_frame"]


@dataclass(frozen=True, kw_only=True)
class _Origin:
    """The EXR file of a frame, with its size and time at reading."""

    path: Path
    size: int
    changed: int
    picture: Picture


@dataclass(frozen=True, kw_only=True, eq=False)
class Frame:
    """A picture, its coverage and the other content of its file.

    Attributes:
        image: Scene-linear light over black, in the primaries of ``space``, (H, W, 3), float32;
            premultiplied if there is alpha.
        alpha: Coverage, (H, W), float32; None if the file has none or it is 1 everywhere.
        camera: Camera from the metadata of the file, or None.
        window: Data window and display window; the ``sensor_width`` of a camera corresponds to
            ``window.display_width`` pixels.
        space: Colour space of the values in the file.
        bits: Bits per channel of the file; None if a result needs no particular number.
        metadata: EXIF and XMP of the file, and notes on what a result omits.
        renderer: Program that wrote the file, as :func:`bokehnet.io.metadata.rendered_by.renderer_of`
            recognises it, or None.
        path: Path of the file; None for arrays.
        choices: One line for each selection among several pictures of the file.
        gain_map: Gain map inside a JPEG or HEIC file, or None.
        gain_map_error: Reason why a gain map in the file is ignored; empty otherwise.
    """

    image: NDArray[np.float32]
    alpha: NDArray[np.float32] | None
    camera: Camera | None
    window: Window
    space: ColorSpace = LINEAR_REC709
    bits: Bits | None = None
    metadata: Metadata = field(default_factory=Metadata, repr=False)
    renderer: str | None = None
    path: Path | None = None
    choices: tuple[str, ...] = ()
    gain_map: GainMap | None = field(default=None, repr=False)
    gain_map_error: str = ""
    _origin: _Origin | None = field(default=None, repr=False)

    @property
    def is_display_referred(self) -> bool:
        """True for a photograph in whole numbers whose white is 1, so that brighter light is clipped."""
        curves = {curve.kind for curve in self.space.curves}
        return self.bits in (8, 16) and not self.space.is_linear and curves.isdisjoint(("pq", "hlg", "log"))

    @property
    def notes(self) -> tuple[str, ...]:
        """Selections, unsupported profiles and content omitted from a result, one line each."""
        profile = f"{self.space.note} is not followed" if self.space.note else ""
        gain_map = f"the gain map is ignored: {self.gain_map_error}" if self.gain_map_error else ""
        return (*self.choices, *filter(None, [profile, gain_map]), *self.metadata.omitted)


def read_frame(path: Path | str, progress: Progress | None = None, color_space: str = "auto") -> Frame:
    """Read a picture with alpha, camera, colour space and metadata.

    Unlike :func:`bokehnet.io.image.read_image` it keeps the primaries of the file: no colour is out of gamut
    and negative, and a result written in the same space keeps untouched pixels unchanged.

    Args:
        path: JPEG, PNG (8 or 16 bit), TIFF, WebP, JPEG XL, EXR, HDR, PFM, DPX or Cineon file; HEIC and HEIF,
            without camera.
        progress: Progress callback.
        color_space: ``"auto"`` for the space that the file names, or one of ``INPUT_COLOR_SPACES``, which
            replaces it.

    Raises:
        ImageFileError: The file cannot be read, has no colours, its colours or alpha hold NaN or infinity,
            or the kind of its colour profile is unsupported.
        ParameterError: The colour space is unknown, or replaces that of a HEIC file.
    """
    check_choice("color_space", color_space, ("auto", *INPUT_COLOR_SPACES))
    if is_heif(path):
        if color_space != "auto":
            raise ParameterError("input.color_space", "auto for HEIC, which names its own", color_space)
        return _read_heif_frame(Path(path))
    with ImageFile(path, progress) as file:
        picture = find_picture(file)
        metadata = read_metadata(file.path, file.file_format)
        own = color_space == "auto"
        space = (
            file_color_space(file, picture.part, metadata.exif) if own else INPUT_COLOR_SPACES[color_space]
        )
        film = own and file.file_format in FILM_FORMATS
        image, alpha = read_light_and_alpha(file, picture, space)
        attributes = file.attributes(picture.part)
        height, width = image.shape[:2]
        if file.headers is None:
            camera = camera_from_exif(attributes, width, height)
            gain_map, gain_map_error = None, ""
            if file.file_format == "jpeg":
                gain_map, gain_map_error = _gain_map(file.path, picture.part.orientation, metadata)
            return Frame(
                image=image,
                alpha=alpha,
                camera=camera,
                window=replace(Window.whole(width, height), pixel_aspect=picture.part.window.pixel_aspect),
                space=space,
                bits=_stored_bits(file, picture),
                metadata=metadata,
                path=file.path,
                gain_map=gain_map,
                gain_map_error=gain_map_error,
                choices=(*_color_notes(attributes, space.name if film else ""), *_page_notes(file)),
            )
        state = file.path.stat()
        origin = _Origin(
            path=file.path.absolute(), size=state.st_size, changed=state.st_mtime_ns, picture=picture
        )
        return Frame(
            image=image,
            alpha=alpha,
            camera=camera_from_exr(attributes),
            window=picture.part.window,
            space=space,
            renderer=renderer_of(attributes),
            path=file.path,
            choices=selection_notes(file, picture),
            _origin=None if picture.part.deep else origin,  # a blurred picture has no deep samples to store
        )


def _read_heif_frame(path: Path) -> Frame:
    """Return a picture of a HEIC file with colour space, metadata and gain map."""
    heif = read_heif(path)
    height, width = heif.image.shape[:2]
    gain_map, gain_map_error = _gain_map(path, 1, heif.metadata)
    return Frame(
        image=heif.image,
        alpha=None,
        camera=None,
        window=Window.whole(width, height),
        space=heif.space,
        bits=8 if heif.bits == 8 else 16,
        metadata=heif.metadata,
        path=path,
        gain_map=gain_map,
        gain_map_error=gain_map_error,
    )


def _gain_map(path: Path, orientation: int, metadata: Metadata) -> tuple[GainMap | None, str]:
    """Return the gain map of a JPEG or HEIC file, and the reason why a damaged one is ignored."""
    try:
        return read_gain_map(path, orientation, metadata.exif), ""
    except ImageFileError as problem:
        return None, str(problem).removeprefix(f"{path}: ")


def _color_notes(attributes: Mapping[str, Any], film_space: str) -> tuple[str, ...]:
    """Return notes on colours that the header alone defines, or that the decoder converts."""
    notes = []
    if film_space:
        notes.append(f"its colours are read as {film_space}, as its header says")
    if "CMYK" in (attributes.get("jpeg:ColorSpace"), attributes.get("tiff:ColorSpace")):
        notes.append("its CMYK inks are converted without a profile; convert it to sRGB for exact colours")
    return tuple(notes)


def _page_notes(file: ImageFile) -> tuple[str, ...]:
    """Return a note on further pages of a TIFF and further frames of an animated WebP."""
    return ("of its pages or frames only the first is rendered",) if file.has_second_picture() else ()


def without_origin(frame: Frame) -> Frame:
    """Return the frame without the link to its EXR file, for results of another size."""
    return replace(frame, _origin=None)


@renamed_keywords
def write_frame(
    path: Path | str,
    frame: Frame,
    bokeh: NDArray[Any],
    alpha: NDArray[Any] | None = None,
    output_format: OutputFormat | None = None,
    progress: Progress | None = None,
    extra_channels: Mapping[str, NDArray[Any]] | None = None,
) -> None:
    """Write ``bokeh`` in place of the picture of ``frame``, atomically.

    From EXR to EXR, the colours of the picture's layer are replaced, and its alpha if ``alpha`` is passed.
    All other channels and parts (depth, mattes, Cryptomatte, deep data), data and display window, metadata
    and colour space, half or float, and the compression are kept (:mod:`bokehnet.io.exr_splice`). ``path``
    may be the file of the frame.

    Other results keep the profile and the bits of the frame's file as far as the format supports them
    and ``output_format`` does not override them, its EXIF and XMP, and alpha if the format supports it; from
    an EXR with overscan, other formats store the display window.

    Args:
        path: File to write, with one of ``IMAGE_EXTENSIONS``.
        frame: Frame from :func:`read_frame`.
        bokeh: Linear light in the primaries of the frame, (H, W, 3) of the frame's size, finite;
            premultiplied if there is alpha.
        alpha: Coverage of ``bokeh``, (H, W), 0 to 1; None keeps the coverage of the frame.
        output_format: Colour space, bits and quality of the file.
        progress: Progress callback, called by several threads.
        extra_channels: Additional channels of an EXR file, (H, W) by name, finite. In the file of the frame
            they join the layer of the picture and replace channels of the same names.

    Raises:
        ImageFileError: The extension is unknown, the file cannot be written, or the frame's file has changed.
        ShapeError, ParameterError: The arrays or an option are not as described, ``alpha`` is passed for
            an EXR picture without alpha, or bits or a colour space for EXR from EXR, which keeps its own.
    """
    path, output_format = Path(path), output_format or OutputFormat()
    check_writable(path)
    check_image("bokeh", bokeh)
    check_same_size("the frame", frame.image, "its bokeh", bokeh)
    if alpha is not None:
        check_map("alpha", alpha)
        check_same_size("the frame", frame.image, "its alpha", alpha)
    check_frame_format(path, frame, output_format)
    check_extra_channels(path, bokeh, extra_channels)
    if frame._origin is not None and path.suffix.lower() == ".exr":
        _write_back(path, frame._origin, bokeh, alpha, extra_channels or {}, progress)
        return
    alpha = frame.alpha if alpha is None else alpha
    cropped_alpha = None if alpha is None else frame.window.crop_to_display(alpha)
    store_picture(
        path,
        frame.window.crop_to_display(bokeh),
        cropped_alpha,
        output_format,
        SourceFile(space=frame.space, bits=frame.bits, metadata=frame.metadata, path=frame.path),
        progress=progress,
        extra_channels={
            name: frame.window.crop_to_display(channel) for name, channel in (extra_channels or {}).items()
        },
    )


def _stored_bits(file: ImageFile, picture: Picture) -> Bits | None:
    """Return the bits of a file with integer channels, or of a photograph in floating point."""
    kind = picture.part.formats[picture.part.channels.index(picture.colours[0])]
    kinds: dict[str, Bits] = {"uint8": 8, "uint16": 16, "half": "half", "float": "float"}
    return None if file.file_format in ("hdr", "pfm") else kinds.get(kind)


def check_frame_format(path: Path, frame: Frame, output_format: OutputFormat) -> None:
    """Raise unless the result of a frame can be written in ``output_format``; changes nothing.

    Raises:
        ImageFileError: The format cannot store the colour space of the frame.
        ParameterError: The format does not support the bits or colour space; EXR from EXR keeps its own.
    """
    check_format(path, output_format)
    extension = path.suffix.lower()
    if frame._origin is None or extension != ".exr":
        bits = choose_bits(extension, output_format.bits, frame.bits)
        target_space(path, frame.space, output_format.color_space, bits)
        return
    options = (("bits", output_format.bits, None), ("color_space", output_format.color_space, "keep"))
    for name, value, default in options:
        if value != default:
            expected = "nothing for EXR from EXR, which keeps its own"
            raise ParameterError(name, expected, value, "leave it out, or write another format")


def _write_back(
    path: Path,
    origin: _Origin,
    bokeh: NDArray[Any],
    alpha: NDArray[Any] | None,
    extra_channels: Mapping[str, NDArray[Any]],
    progress: Progress | None,
) -> None:
    """Write the frame's EXR file with other colours and additional channels."""
    picture = origin.picture
    formats = dict(zip(picture.part.channels, picture.part.formats, strict=True))
    if integers := [name for name in picture.colours if formats[name] == "uint"]:
        raise ImageFileError(
            f"{origin.path}: expected colours in half or float, found integers in {', '.join(integers)}; "
            "write to another format than EXR"
        )
    replaced = {name: np.asarray(bokeh[..., i], np.float32) for i, name in enumerate(picture.colours)}
    if alpha is not None:
        if picture.alpha is None:
            expected = f"None, as the picture in {origin.path} has no alpha channel"
            raise ParameterError("alpha", expected, alpha, "leave `alpha` out")
        replaced[picture.alpha] = np.asarray(alpha, np.float32)
    layer = picture.colours[0].rpartition(".")[0]
    added = {
        f"{layer}.{name}" if layer else name: np.asarray(channel, np.float32)
        for name, channel in extra_channels.items()
    }
    with ImageFile(origin.path, part_of(progress, 0, 2)) as source:
        state = origin.path.stat()
        if (state.st_size, state.st_mtime_ns) != (origin.size, origin.changed):
            raise ImageFileError(f"{origin.path}: the file has changed since it was read; read it again")
        part = picture.part

        def fill(temporary: Path) -> None:
            write_replaced(temporary, source, part, replaced | added)
            check_readable(temporary, part.index, part_of(progress, 1, 2))

        # Free space for the file and for its part once more: encoders crash on a full disk.
        part_bytes = part.width * part.height * (len(part.channels) + len(added)) * 4
        write_atomic(path, fill, room=2 * (part_bytes * 3 // 2 + 2**16) + state.st_size)
