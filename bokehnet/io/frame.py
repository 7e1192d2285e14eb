"""A picture with all that its file holds besides, and the way back into such a file."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from bokehnet.checks import check_image, check_map, check_same_size
from bokehnet.errors import ImageFileError, ParameterError
from bokehnet.io.atomic import write_atomic
from bokehnet.io.camera import Camera, camera_from_exif, camera_from_exr
from bokehnet.io.choices import choices
from bokehnet.io.encode import check_readable
from bokehnet.io.exr_splice import write_replaced
from bokehnet.io.heif import is_heif, read_heif_image
from bokehnet.io.image import check_writable, write_image
from bokehnet.io.picture import Picture, find_picture, read_light_and_alpha
from bokehnet.io.pixels import ImageFile
from bokehnet.io.window import Window

__all__ = ["Frame", "read_frame", "write_frame"]


@dataclass(frozen=True, kw_only=True)
class _Origin:
    """The EXR file that a frame was read from, as it was then."""

    path: Path
    size: int
    changed: int
    picture: Picture


@dataclass(frozen=True, kw_only=True, eq=False)
class Frame:
    """A picture, its coverage, and what its file tells of the camera.

    Attributes:
        image: Scene-linear light over black, (H, W, 3), float32: premultiplied where there is alpha.
        alpha: Coverage, (H, W), float32; None when the file has none or it is 1 everywhere.
        camera: What the file tells of the camera, or None.
        window: Where the pixels lie in the shown picture; a camera's ``sensor_width`` belongs to
            ``window.display_width`` pixels.
        notes: What was chosen where the file holds several pictures, a line each.
    """

    image: NDArray[np.float32]
    alpha: NDArray[np.float32] | None
    camera: Camera | None
    window: Window
    notes: tuple[str, ...] = ()
    _origin: _Origin | None = field(default=None, repr=False)


def read_frame(path: Path | str) -> Frame:
    """Read a picture as :func:`bokehnet.io.image.read_image` does, with alpha and camera beside it.

    Args:
        path: JPEG, PNG (8 or 16 bit), TIFF, WebP, EXR or HDR file; HEIC and HEIF, without camera.

    Raises:
        ImageFileError: the file cannot be read, has no colours, or its colours or alpha hold NaN or infinity.
    """
    if is_heif(path):
        image = read_heif_image(path)
        height, width = image.shape[:2]
        return Frame(image=image, alpha=None, camera=None, window=Window.whole(width, height))
    with ImageFile(path) as file:
        picture = find_picture(file)
        image, alpha = read_light_and_alpha(file, picture)
        attributes = file.attributes(picture.part)
        height, width = image.shape[:2]
        if file.headers is None:
            camera = camera_from_exif(attributes, width, height)
            return Frame(image=image, alpha=alpha, camera=camera, window=Window.whole(width, height))
        state = file.path.stat()
        origin = _Origin(
            path=file.path.absolute(), size=state.st_size, changed=state.st_mtime_ns, picture=picture
        )
        return Frame(
            image=image,
            alpha=alpha,
            camera=camera_from_exr(attributes),
            window=picture.part.window,
            notes=choices(file, picture),
            _origin=None if picture.part.deep else origin,  # blur has no deep samples to put there
        )


def write_frame(
    path: Path | str,
    frame: Frame,
    bokeh: NDArray[Any],
    alpha: NDArray[Any] | None = None,
    *,
    quality: int = 95,
    bits: Literal[8, 16] = 8,
) -> None:
    """Write ``bokeh`` in the place of the picture of ``frame``, atomically.

    From EXR to EXR, the colours of the picture's layer are replaced, and its alpha where ``alpha`` is given.
    All other channels and parts (depth, mattes, Cryptomatte, deep data), data and display window, metadata
    and colour space, half or float, and the compression stay (:mod:`bokehnet.io.exr_splice`). The frame's
    file may be the one that is written.

    Everything else is written as by :func:`bokehnet.io.image.write_image`, with alpha where the format has
    it; of an EXR with overscan, other formats show the display window.

    Args:
        path: where the picture goes; one of ``IMAGE_EXTENSIONS``.
        frame: what :func:`read_frame` gave.
        bokeh: scene-linear (H, W, 3) of the frame's size, finite; premultiplied where there is alpha.
        alpha: its coverage, (H, W), 0 to 1; None keeps that of the frame.
        quality: of JPEG and WebP, 1 to 100.
        bits: per channel of PNG and TIFF, 8 or 16.

    Raises:
        ImageFileError: unknown extension, the file cannot be written, or the frame's own file has changed.
        ShapeError, ParameterError: the arrays or an option are not as described, or ``alpha`` is given for
            an EXR picture without alpha.
    """
    path = Path(path)
    check_writable(path)
    check_image("bokeh", bokeh)
    check_same_size("the frame", frame.image, "its bokeh", bokeh)
    if alpha is not None:
        check_map("alpha", alpha)
        check_same_size("the frame", frame.image, "its alpha", alpha)
    if frame._origin is not None and path.suffix.lower() == ".exr":
        _write_back(path, frame._origin, bokeh, alpha)
        return
    alpha = frame.alpha if alpha is None else alpha
    shown = None if alpha is None else frame.window.shown(alpha)
    write_image(path, frame.window.shown(bokeh), alpha=shown, quality=quality, bits=bits)


def _write_back(path: Path, origin: _Origin, bokeh: NDArray[Any], alpha: NDArray[Any] | None) -> None:
    """Write the frame's EXR file with other colours."""
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
    with ImageFile(origin.path) as source:
        state = origin.path.stat()
        if (state.st_size, state.st_mtime_ns) != (origin.size, origin.changed):
            raise ImageFileError(f"{origin.path}: the file has changed since it was read; read it again")
        part = picture.part

        def fill(temporary: Path) -> None:
            write_replaced(temporary, source, part, replaced)
            check_readable(temporary, part.index)

        # Room for the file and for its part once more: encoders do not survive a full disk.
        own = part.width * part.height * len(part.channels) * 4
        write_atomic(path, fill, room=2 * (own * 3 // 2 + 2**16) + state.st_size)
