"""A picture with all that its file holds besides, and the way back into such a file."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bokehnet.checks import check_image, check_map, check_same_size
from bokehnet.errors import ImageFileError, ParameterError
from bokehnet.io.atomic import write_atomic
from bokehnet.io.color.color_space import LINEAR_REC709, ColorSpace
from bokehnet.io.color.file_color import file_color_space
from bokehnet.io.exr_splice import write_replaced
from bokehnet.io.formats.encode import check_readable
from bokehnet.io.formats.heif import is_heif, read_heif
from bokehnet.io.image import check_beside, check_writable
from bokehnet.io.metadata.camera import Camera, camera_from_exif, camera_from_exr
from bokehnet.io.metadata.photo_metadata import Metadata, read_metadata
from bokehnet.io.metadata.rendered_by import renderer_of
from bokehnet.io.output_format import Bits, OutputFormat, check_format, choose_bits, target_space
from bokehnet.io.part_choices import choices
from bokehnet.io.picture import Picture, find_picture, read_light_and_alpha
from bokehnet.io.pixels import ImageFile
from bokehnet.io.store import store_picture
from bokehnet.io.window import Window
from bokehnet.progress import Progress, part_of

__all__ = ["Frame", "check_frame_format", "detached", "read_frame", "write_frame"]


@dataclass(frozen=True, kw_only=True)
class _Origin:
    """The EXR file that a frame was read from, as it was then."""

    path: Path
    size: int
    changed: int
    picture: Picture


@dataclass(frozen=True, kw_only=True, eq=False)
class Frame:
    """A picture, its coverage, and what its file tells besides.

    Attributes:
        image: Scene-linear light over black, in the primaries of ``space``, (H, W, 3), float32:
            premultiplied where there is alpha.
        alpha: Coverage, (H, W), float32; None when the file has none or it is 1 everywhere.
        camera: What the file tells of the camera, or None.
        window: Where the pixels lie in the shown picture; a camera's ``sensor_width`` belongs to
            ``window.display_width`` pixels.
        space: Colour space that the values of the file have.
        bits: Of its channels; None where a result need not have as many.
        metadata: Its EXIF and XMP, and what of the file a result will not have.
        renderer: What wrote the file, as :func:`bokehnet.io.metadata.rendered_by.renderer_of` knows it, or
            None.
        path: The file; None for arrays.
        choices: What was chosen where the file holds several pictures, a line each.
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
    _origin: _Origin | None = field(default=None, repr=False)

    @property
    def notes(self) -> tuple[str, ...]:
        """What was chosen, is not followed, or left out of a result, a line each."""
        profile = f"{self.space.note} is not followed" if self.space.note else ""
        return (*self.choices, *filter(None, [profile]), *self.metadata.left_out)


def read_frame(path: Path | str, progress: Progress | None = None) -> Frame:
    """Read a picture with alpha, camera, colour space and metadata.

    Unlike :func:`bokehnet.io.image.read_image` it leaves the picture in its own primaries: no colour is
    outside them, so that none is negative, and written back in its own space all is as it was.

    Args:
        path: JPEG, PNG (8 or 16 bit), TIFF, WebP, JPEG XL, EXR, HDR or PFM file; HEIC and HEIF, without
            camera.
        progress: Is told how far it is.

    Raises:
        ImageFileError: The file cannot be read, has no colours, its colours or alpha hold NaN or infinity,
            or its colour profile is of a kind that is not followed.
    """
    if is_heif(path):
        found = read_heif(path)
        height, width = found.image.shape[:2]
        return Frame(
            image=found.image,
            alpha=None,
            camera=None,
            window=Window.whole(width, height),
            space=found.space,
            bits=8 if found.bits == 8 else 16,
            metadata=found.metadata,
            path=Path(path),
        )
    with ImageFile(path, progress) as file:
        picture = find_picture(file)
        metadata = read_metadata(file.path, file.file_format)
        space = file_color_space(file, picture.part, metadata.exif)
        image, alpha = read_light_and_alpha(file, picture, space)
        attributes = file.attributes(picture.part)
        height, width = image.shape[:2]
        if file.headers is None:
            camera = camera_from_exif(attributes, width, height)
            return Frame(
                image=image,
                alpha=alpha,
                camera=camera,
                window=Window.whole(width, height),
                space=space,
                bits=_stored_bits(file, picture),
                metadata=metadata,
                path=file.path,
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
            renderer=renderer_of(attributes),
            path=file.path,
            choices=choices(file, picture),
            _origin=None if picture.part.deep else origin,  # blur has no deep samples to put there
        )


def detached(frame: Frame) -> Frame:
    """The same without the way back into its EXR file, for results of another size."""
    return replace(frame, _origin=None)


def write_frame(
    path: Path | str,
    frame: Frame,
    bokeh: NDArray[Any],
    alpha: NDArray[Any] | None = None,
    wanted: OutputFormat | None = None,
    progress: Progress | None = None,
    beside: Mapping[str, NDArray[Any]] | None = None,
) -> None:
    """Write ``bokeh`` in the place of the picture of ``frame``, atomically.

    From EXR to EXR, the colours of the picture's layer are replaced, and its alpha where ``alpha`` is given.
    All other channels and parts (depth, mattes, Cryptomatte, deep data), data and display window, metadata
    and colour space, half or float, and the compression stay (:mod:`bokehnet.io.exr_splice`). The frame's
    file may be the one that is written.

    Everything else is written with the profile and the bits of the frame's file, where the format has them
    and ``wanted`` does not say otherwise, its EXIF and XMP, and alpha where the format has it; of an EXR
    with overscan, other formats show the display window.

    Args:
        path: where the picture goes; one of ``IMAGE_EXTENSIONS``.
        frame: what :func:`read_frame` gave.
        bokeh: linear light in the primaries of the frame, (H, W, 3) of its size, finite; premultiplied where
            there is alpha.
        alpha: its coverage, (H, W), 0 to 1; None keeps that of the frame.
        wanted: what the file is to be like.
        progress: is told how far it is, by several threads.
        beside: further channels of an EXR file, (H, W) by name, finite. In the place of a picture they
            stand in its layer, and in place of channels of their names.

    Raises:
        ImageFileError: unknown extension, the file cannot be written, or the frame's own file has changed.
        ShapeError, ParameterError: the arrays or an option are not as described, ``alpha`` is given for
            an EXR picture without alpha, or bits or a colour space for EXR from EXR, which keeps its own.
    """
    path, wanted = Path(path), wanted or OutputFormat()
    check_writable(path)
    check_image("bokeh", bokeh)
    check_same_size("the frame", frame.image, "its bokeh", bokeh)
    if alpha is not None:
        check_map("alpha", alpha)
        check_same_size("the frame", frame.image, "its alpha", alpha)
    check_frame_format(path, frame, wanted)
    check_beside(path, bokeh, beside)
    if frame._origin is not None and path.suffix.lower() == ".exr":
        _write_back(path, frame._origin, bokeh, alpha, beside or {}, progress)
        return
    alpha = frame.alpha if alpha is None else alpha
    shown = None if alpha is None else frame.window.shown(alpha)
    store_picture(
        path,
        frame.window.shown(bokeh),
        shown,
        wanted,
        source=frame.space,
        bits=frame.bits,
        metadata=frame.metadata,
        origin=frame.path,
        progress=progress,
        beside={name: frame.window.shown(channel) for name, channel in (beside or {}).items()},
    )


def _stored_bits(file: ImageFile, picture: Picture) -> Bits | None:
    """Bits of a file of whole numbers, or of a photograph in floating point."""
    kind = picture.part.formats[picture.part.channels.index(picture.colours[0])]
    kinds: dict[str, Bits] = {"uint8": 8, "uint16": 16, "half": "half", "float": "float"}
    return None if file.file_format in ("hdr", "pfm") else kinds.get(kind)


def check_frame_format(path: Path, frame: Frame, wanted: OutputFormat) -> None:
    """Raise unless the result of a frame can be written as wanted; nothing is touched.

    Raises:
        ImageFileError: The format cannot tell the colours of the frame.
        ParameterError: The format has no such bits or colour space; EXR from EXR keeps its own.
    """
    check_format(path, wanted)
    extension = path.suffix.lower()
    if frame._origin is None or extension != ".exr":
        bits = choose_bits(extension, wanted.bits, frame.bits)
        target_space(path, frame.space, wanted.color_space, bits)
        return
    for name, asked, own in (("bits", wanted.bits, None), ("color_space", wanted.color_space, "keep")):
        if asked != own:
            expected = "nothing for EXR from EXR, which keeps its own"
            raise ParameterError(name, expected, asked, "leave it out, or write another format")


def _write_back(
    path: Path,
    origin: _Origin,
    bokeh: NDArray[Any],
    alpha: NDArray[Any] | None,
    beside: Mapping[str, NDArray[Any]],
    progress: Progress | None,
) -> None:
    """Write the frame's EXR file with other colours, and channels beside them."""
    picture = origin.picture
    formats = dict(zip(picture.part.channels, picture.part.formats, strict=True))
    if whole := [name for name in picture.colours if formats[name] == "uint"]:
        raise ImageFileError(
            f"{origin.path}: expected colours in half or float, found whole numbers in {', '.join(whole)}; "
            "write to another format than EXR"
        )
    replaced = {name: np.asarray(bokeh[..., i], np.float32) for i, name in enumerate(picture.colours)}
    if alpha is not None:
        if picture.alpha is None:
            expected = f"None, as the picture in {origin.path} has no alpha channel"
            raise ParameterError("alpha", expected, alpha, "leave `alpha` out")
        replaced[picture.alpha] = np.asarray(alpha, np.float32)
    layer = picture.colours[0].rpartition(".")[0]
    added = {f"{layer}.{name}" if layer else name: np.asarray(it, np.float32) for name, it in beside.items()}
    with ImageFile(origin.path, part_of(progress, 0, 2)) as source:
        state = origin.path.stat()
        if (state.st_size, state.st_mtime_ns) != (origin.size, origin.changed):
            raise ImageFileError(f"{origin.path}: the file has changed since it was read; read it again")
        part = picture.part

        def fill(temporary: Path) -> None:
            write_replaced(temporary, source, part, replaced | added)
            check_readable(temporary, part.index, part_of(progress, 1, 2))

        # Room for the file and for its part once more: encoders do not survive a full disk.
        own = part.width * part.height * (len(part.channels) + len(added)) * 4
        write_atomic(path, fill, room=2 * (own * 3 // 2 + 2**16) + state.st_size)
