"""Pictures: files to scene-linear arrays and back."""

from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from bokehnet.checks import check_image, check_map, check_range, check_same_size
from bokehnet.errors import ImageFileError, ParameterError
from bokehnet.io.atomic import check_target
from bokehnet.io.color import linear_to_srgb
from bokehnet.io.encode import encode
from bokehnet.io.heif import is_heif, read_heif_image
from bokehnet.io.intact import check_name
from bokehnet.io.picture import find_picture, read_light
from bokehnet.io.pixels import ImageFile

__all__ = [
    "IMAGE_EXTENSIONS",
    "MAP_EXTENSIONS",
    "check_writable",
    "read_image",
    "write_image",
    "write_map",
]

IMAGE_EXTENSIONS = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".webp", ".exr", ".hdr")
MAP_EXTENSIONS = (".png", ".exr")

_LARGEST_HALF = 65504.0
_WIDEST_HDR = 32767  # beyond it the run lengths of its rows no longer fit
_WITHOUT_ALPHA = (".jpg", ".jpeg", ".hdr")


def read_image(path: Path | str) -> NDArray[np.float32]:
    """Read a picture as scene-linear light, Rec.709 primaries; 1 is white, values above 1 are kept.

    Integer files (JPEG, PNG, TIFF, WebP) are decoded from sRGB, embedded colour profiles are not applied;
    EXR, HDR and floating-point TIFF are linear already. EXIF orientation is applied. Grey becomes three
    equal channels. EXR gives its channels R, G, B, bare or under a layer name, else Y; others are ignored.
    Of an EXR the data window is read, with overscan.

    Alpha is dropped by laying the picture over black, in linear light: straight colours (PNG, WebP) are
    multiplied by alpha, premultiplied ones (EXR) are the light itself and stay as they are.

    Args:
        path: JPEG, PNG (8 or 16 bit), TIFF, WebP, EXR or HDR file; HEIC and HEIF with the extra ``heif``.

    Returns:
        Image of shape (H, W, 3).

    Raises:
        ImageFileError: the file cannot be read, has no colours, or holds NaN or infinity.
        MissingExtraError: a HEIF file, and pillow-heif is not installed.
    """
    if is_heif(path):
        return read_heif_image(path)
    with ImageFile(path) as file:
        return read_light(file, find_picture(file))


def write_image(
    path: Path | str,
    image: NDArray[Any],
    *,
    alpha: NDArray[Any] | None = None,
    quality: int = 95,
    bits: Literal[8, 16] = 8,
) -> None:
    """Write a scene-linear picture atomically; the extension picks the format.

    ``.png``, ``.jpg``, ``.tif`` and ``.webp`` are sRGB, clipped to [0, 1] and rounded. ``.exr`` is linear
    half with ZIP compression, clipped to +-65504. ``.hdr`` is linear, negative values become 0.

    With ``alpha``, PNG, TIFF and WebP hold straight colours, which are divided by alpha in linear light, and
    EXR premultiplied ones; JPEG and HDR, which have no alpha, hold the picture over black.

    Args:
        path: where the picture goes; one of ``IMAGE_EXTENSIONS``.
        image: scene-linear Rec.709, (H, W, 3), finite; premultiplied where there is alpha.
        alpha: coverage, (H, W), 0 to 1, finite.
        quality: of JPEG and WebP, 1 to 100.
        bits: per channel of PNG and TIFF, 8 or 16.

    Raises:
        ImageFileError: unknown extension, or the file cannot be written.
        ShapeError, ParameterError: the array or an option is not as described.
    """
    path = Path(path)
    check_writable(path)
    check_image("image", image)
    check_range("quality", quality, 1, 100)
    extension = path.suffix.lower()
    if bits not in (8, 16) or (bits == 16 and extension not in (".png", ".tif", ".tiff")):
        raise ParameterError("bits", "8, or 16 for .png and .tif", bits, shown=f"{bits} for {extension}")
    if alpha is not None:
        check_map("alpha", alpha)
        check_same_size("the picture", image, "alpha", alpha)
        if extension in _WITHOUT_ALPHA:
            alpha = None
    channels = ("R", "G", "B") if alpha is None else ("R", "G", "B", "A")
    shape = (*image.shape[:2], len(channels))
    if extension == ".exr":

        def half(rows: slice) -> NDArray[Any]:
            values = image[rows] if alpha is None else np.dstack([image[rows], alpha[rows]])
            return np.clip(values, -_LARGEST_HALF, _LARGEST_HALF)

        encode(path, shape, np.float16, half, channels, {"compression": "zip"})
    elif extension == ".hdr":
        if max(image.shape[:2]) > _WIDEST_HDR:
            raise ImageFileError(
                f"{path}: HDR files are at most {_WIDEST_HDR} pixels wide and high, "
                f"got {image.shape[1]}x{image.shape[0]}; use .exr"
            )
        encode(path, shape, np.float32, lambda rows: np.maximum(image[rows], 0), channels, {})
    else:
        codec = {".jpg": "jpeg", ".jpeg": "jpeg", ".webp": "webp"}.get(extension)
        hints: dict[str, str | int] = {"compression": f"{codec}:{quality}"} if codec else {}
        if codec == "jpeg":
            hints["jpeg:subsampling"] = "4:4:4"  # halved colour resolution shows at small bright discs
        if alpha is not None:
            hints["oiio:UnassociatedAlpha"] = 1  # the values are straight as they stand

        def whole(rows: slice) -> NDArray[Any]:
            if alpha is None:
                return _quantise(_encoded(image[rows]), bits)
            cover = alpha[rows]
            straight = image[rows] / np.where(cover > 0, cover, 1)[..., None]
            return _quantise(np.dstack([_encoded(straight), np.clip(cover, 0, 1)]), bits)

        encode(path, shape, np.uint8 if bits == 8 else np.uint16, whole, channels, hints)


def write_map(path: Path | str, values: NDArray[Any], *, channel: str = "Y") -> None:
    """Write a single-channel map, such as a defocus or an error map, without any transfer function.

    ``.png`` has 8 bits: values are clipped to [0, 1] and rounded. ``.exr`` keeps float32 values.

    Args:
        path: where the map goes; one of ``MAP_EXTENSIONS``.
        values: (H, W), finite.
        channel: name of the channel in an EXR file.

    Raises:
        ImageFileError: unknown extension, or the file cannot be written.
        ShapeError, ParameterError: the array is not as described.
    """
    path = Path(path)
    check_writable(path, MAP_EXTENSIONS)
    check_map("map", values)
    values = values[..., None]
    if path.suffix.lower() == ".exr":
        encode(path, values.shape, np.float32, values.__getitem__, (channel,), {"compression": "zip"})
    else:

        def grey(rows: slice) -> NDArray[Any]:
            return _quantise(np.clip(values[rows], 0, 1), 8)

        encode(path, values.shape, np.uint8, grey, ("Y",), {})


def check_writable(path: Path | str, extensions: tuple[str, ...] = IMAGE_EXTENSIONS) -> None:
    """Raise unless a picture could be written at ``path``; call it before any long work.

    Args:
        path: where a picture shall go.
        extensions: the known ones, lower case.

    Raises:
        ImageFileError: unknown extension, folder missing or not writable, or ``path`` is a folder.
    """
    path = Path(path)
    check_name(path)
    check_target(path)
    if path.suffix.lower() not in extensions:
        known = ", ".join(extensions)
        raise ImageFileError(f"{path}: unknown extension {path.suffix!r}, expected one of {known}")


def _encoded(light: NDArray[Any]) -> NDArray[Any]:
    """Return sRGB values in [0, 1]."""
    encoded: NDArray[Any] = linear_to_srgb(np.clip(light, 0, 1))
    return encoded


def _quantise(values: NDArray[Any], bits: int) -> NDArray[Any]:
    """Round values in [0, 1] to unsigned integers."""
    scaled = np.asarray(values, dtype=np.float64) * (2**bits - 1)
    return np.rint(scaled).astype(np.uint8 if bits == 8 else np.uint16)
