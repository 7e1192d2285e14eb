"""Depth maps that phones embed in photos."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bokehnet.errors import ImageFileError
from bokehnet.io.color.color_space import SRGB, ColorSpace, convert
from bokehnet.io.color.file_color import file_color_space
from bokehnet.io.containers.jpeg import JPEG_START, jpeg_layout
from bokehnet.io.depth.apple_depth import apple_depth
from bokehnet.io.depth.depth_coding import StoredDepth
from bokehnet.io.depth.google_depth import google_depth
from bokehnet.io.formats.heif import is_heif, read_heif_depth
from bokehnet.io.metadata.photo_metadata import read_metadata
from bokehnet.io.metadata.xmp import jpeg_xmp
from bokehnet.io.pixels import ImageFile, apply_orientation
from bokehnet.io.selection.picture import find_picture, read_light

__all__ = ["PhoneDepth", "embedded_picture", "has_phone_depth", "read_phone_depth"]

_EXTENSIONS = {JPEG_START: ".jpg", b"\x89PNG\r\n\x1a\n": ".png"}
_MAX_GREY_DIFFERENCE = 0.1  # largest difference of the channels of a grey pixel


@dataclass(frozen=True, kw_only=True, slots=True)
class PhoneDepth:
    """A depth map embedded in a photo.

    Attributes:
        disparity: Disparity, larger is nearer, upright like the photo, at its own size (H, W); in 1/mm if
            ``metric``, otherwise relative, 0 to 1 over the range of the phone.
        metric: True if the photo states the scale.
        focus_disparity: Disparity in focus on the phone, on the scale of ``disparity``; None if unknown.
        all_in_focus: Photo before the phone blurred it, scene-linear (H', W', 3), if the file keeps it;
            None if the photo itself is the only picture.
    """

    disparity: NDArray[np.float32]
    metric: bool
    focus_disparity: float | None = None
    all_in_focus: NDArray[np.float32] | None = None

    @property
    def focus_distance(self) -> float | None:
        """Distance in focus, mm, ``inf`` for the sky; None if unknown or not metric."""
        if not self.metric or self.focus_disparity is None:
            return None
        return 1 / self.focus_disparity if self.focus_disparity > 0 else float("inf")


def read_phone_depth(path: Path | str) -> PhoneDepth | None:
    """Read the depth map inside a photo; None if it holds none.

    Supported are JPEG files with GDepth or Dynamic Depth (Android), and JPEG and HEIC files with Apple's
    depth or disparity map.

    Args:
        path: Photo.

    Raises:
        ImageFileError: The file cannot be read, or it announces a map that is damaged.
        MissingExtraError: The file is HEIC, and pillow-heif is not installed.

    Source: see ``google_depth`` and ``apple_depth``.
    """
    if is_heif(path):
        heif_depth = read_heif_depth(path)
        if heif_depth is None:
            return None
        values, coding = heif_depth
        return PhoneDepth(disparity=coding.decode(values), metric=coding.unit is not None)
    stored = _find_stored(Path(path))
    return None if stored is None else _decode(Path(path), *stored)


def has_phone_depth(path: Path | str) -> bool:
    """Return whether a photo holds a depth map; decodes no pixels of a JPEG.

    Args:
        path: Photo.

    Raises:
        ImageFileError, MissingExtraError: As for :func:`read_phone_depth`.
    """
    if is_heif(path):
        return read_heif_depth(path) is not None
    return _find_stored(Path(path)) is not None


def _find_stored(path: Path) -> tuple[StoredDepth, int, ColorSpace] | None:
    """Return the encoded map of a JPEG file, its orientation and colour space; None without a map."""
    with ImageFile(path) as file:  # reports the error of a file that is no picture
        orientation = file.parts[0].orientation
        if file.file_format != "jpeg":
            return None
        exif = read_metadata(file.path, file.file_format).exif
        space = file_color_space(file, file.parts[0], exif)
    data = path.read_bytes()
    layout = jpeg_layout(data)
    stored = google_depth(path, data, layout.end, jpeg_xmp(path, layout.app1))
    stored = stored or apple_depth(path, data, layout.end)
    return None if stored is None else (stored, orientation, space)


def _decode(path: Path, stored: StoredDepth, orientation: int, space: ColorSpace) -> PhoneDepth:
    coding = stored.coding
    values = _read_grey(path, stored.picture, orientation)
    original = None
    if stored.original is not None:
        original = _read_original(path, stored.original, orientation, space)
    return PhoneDepth(
        disparity=coding.decode(values),
        metric=coding.unit is not None,
        focus_disparity=None if stored.focus is None else coding.focus(stored.focus),
        all_in_focus=original,
    )


def _read_grey(path: Path, picture: bytes, orientation: int) -> NDArray[np.float32]:
    """Decode a map, which has the orientation of its photo, whatever its own metadata state."""
    with embedded_picture(path, picture, "depth map") as name, ImageFile(name) as file:
        part = file.parts[0]
        names = [channel for channel in part.channels if channel != part.alpha]
        values = file.read(replace(part, orientation=orientation), names)
        if np.ptp(values, axis=-1).max() > _MAX_GREY_DIFFERENCE:
            raise ImageFileError(f"{name}: expected a grey picture, found colours")
        return np.asarray(values.mean(axis=-1, dtype=np.float64), np.float32)


def _read_original(path: Path, picture: bytes, orientation: int, space: ColorSpace) -> NDArray[np.float32]:
    """Decode the unblurred picture into the primaries of its photo.

    A picture without orientation or profile has those of its photo.
    """
    with embedded_picture(path, picture, "original picture") as name, ImageFile(name) as file:
        original = find_picture(file)
        own = file_color_space(file, original.part, read_metadata(name, file.file_format).exif)
        own = space if own == SRGB else own
        image = read_light(file, original, own)
        image = convert(image, own, space, out=image)
        return apply_orientation(image, orientation) if original.part.orientation == 1 else image


@contextmanager
def embedded_picture(path: Path, content: bytes, role: str) -> Iterator[Path]:
    """Provide bytes as a file inside the block; errors name the photo and the role of the file in it."""
    label = f"{path}: the {role} inside"
    extension = next((name for start, name in _EXTENSIONS.items() if content.startswith(start)), None)
    if extension is None:
        raise ImageFileError(f"{label}: expected JPEG or PNG, found neither; the photo is damaged")
    with tempfile.TemporaryDirectory(prefix="bokehnet-") as folder:
        name = Path(folder) / f"embedded{extension}"
        name.write_bytes(content)
        try:
            yield name
        except ImageFileError as error:
            raise ImageFileError(str(error).replace(str(name), label, 1)) from error
