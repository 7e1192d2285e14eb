"""Read and write pictures as scene-linear arrays."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO, Literal, cast

import numpy as np
from numpy.typing import NDArray

from bokehnet.checks import check_image, check_map, check_same_size
from bokehnet.deprecation import renamed_keywords
from bokehnet.errors import ParameterError
from bokehnet.io.color.color_space import LINEAR_REC709, ColorSpace, convert
from bokehnet.io.color.dither import quantise
from bokehnet.io.color.file_color import file_color_space
from bokehnet.io.containers.input_checks import check_name
from bokehnet.io.files.atomic import check_target
from bokehnet.io.files.buffers import Buffer, is_buffer, picture_file, write_to_stream
from bokehnet.io.formats.encode import encode
from bokehnet.io.formats.heif import is_heif, read_heif
from bokehnet.io.formats.output_format import (
    IMAGE_EXTENSIONS,
    Bits,
    OutputFormat,
    Subsampling,
    check_extension,
    check_format,
)
from bokehnet.io.formats.store import SourceFile, store_picture
from bokehnet.io.metadata.photo_metadata import read_metadata
from bokehnet.io.pixels import ImageFile
from bokehnet.io.selection.picture import find_picture, read_light

__all__ = [
    "IMAGE_EXTENSIONS",
    "MAP_EXTENSIONS",
    "check_extra_channels",
    "check_writable",
    "read_image",
    "write_image",
    "write_map",
]

MAP_EXTENSIONS = (".png", ".exr", ".pfm")


def read_image(path: Path | str | Buffer, *, like: ColorSpace = LINEAR_REC709) -> NDArray[np.float32]:
    """Read a picture as scene-linear light, Rec.709 primaries; 1 is white, larger values are kept.

    Integers (JPEG, PNG, TIFF, WebP) are decoded through the colour profile, otherwise through the colour
    metadata of the file, otherwise from sRGB; colours outside Rec.709 have negative values. EXR, HDR, PFM and
    floating-point TIFF without a profile are linear already. EXIF orientation is applied. Grey becomes three
    equal channels. EXR provides its channels R, G, B, bare or under a layer name, otherwise Y; others are
    ignored. The data window of an EXR is read, with overscan; its chromaticities are the primaries.

    Alpha is dropped by compositing over black, in linear light: straight colours (PNG, WebP) are
    multiplied by alpha, premultiplied ones (EXR) are the light itself and remain unchanged.

    Args:
        path: JPEG, PNG (8 or 16 bit), TIFF, WebP, JPEG XL, EXR, HDR or PFM file; HEIC and HEIF with the extra
            ``heif``, AVIF with the extra ``avif``. Or bytes, or a binary stream, of such a file.
        like: Colour space that provides the primaries of the result.

    Returns:
        Image of shape (H, W, 3).

    Raises:
        ImageFileError: The file cannot be read, has no colours, holds NaN or infinity, or the kind of its
            colour profile is unsupported.
        MissingExtraError: The file is HEIF or AVIF, and its extra is not installed.
    """
    if is_buffer(path):
        with picture_file(cast(Buffer, path)) as file_path:
            return read_image(file_path, like=like)
    path = cast("Path | str", path)
    if is_heif(path):
        heif = read_heif(path)
        image, space = heif.image, heif.space
    else:
        with ImageFile(path) as file:
            picture = find_picture(file)
            exif = read_metadata(file.path, file.file_format).exif
            space = file_color_space(file, picture.part, exif)
            image = read_light(file, picture, space)
    return convert(image, space, like, out=image)


@renamed_keywords
def write_image(
    path: Path | str | BinaryIO,
    image: NDArray[Any],
    *,
    format: str | None = None,
    alpha: NDArray[Any] | None = None,
    quality: int = 97,
    bits: Bits | None = None,
    color_space: Literal["keep", "srgb", "display-p3", "adobe-rgb", "prophoto", "rec2020"] = "srgb",
    subsampling: Subsampling = "4:4:4",
    dither: bool = True,
    shoulder: bool = False,
    extra_channels: Mapping[str, NDArray[Any]] | None = None,
) -> None:
    """Write a scene-linear picture atomically; the extension selects the format.

    ``.png``, ``.jpg``, ``.tif``, ``.webp``, ``.jxl``, ``.avif`` (extra ``avif``) and ``.heic`` (extra
    ``heif``) are clipped to [0, 1], encoded and rounded. ``.exr`` is linear half with ZIP compression,
    clipped to +-65504. ``.hdr`` is linear, negative values become 0; ``.pfm`` is linear.

    With ``alpha``, PNG, TIFF, WebP, AVIF and HEIC hold straight colours, divided by alpha in linear light;
    EXR and PFM hold premultiplied ones; JPEG, JPEG XL and HDR hold the picture over black.

    Args:
        path: File to write, with one of ``IMAGE_EXTENSIONS``; or a binary stream, such as ``io.BytesIO``.
        image: Scene-linear Rec.709, (H, W, 3), finite; premultiplied if there is alpha.
        format: Extension that selects the format of a stream, such as "png"; only for streams.
        alpha: Coverage, (H, W), 0 to 1, finite.
        quality: Quality of JPEG, WebP, JPEG XL, AVIF and HEIC, 1 to 100; WebP at 100 is lossless.
        bits: Bits per channel: 8 or 16 for PNG, 8, 16 or "float" (linear) for TIFF, "half" or "float" for
            EXR, 8 or 10 for HEIC. None selects the first of these.
        color_space: Colour space of the file, stored as a profile unless it is sRGB; "keep" means sRGB too.
        subsampling: Chroma subsampling of JPEG, AVIF and HEIC.
        dither: True dithers the rounding to 8 bits, so that gradients show no bands.
        shoulder: True compresses light above white to its square root before it is clipped.
        extra_channels: Additional channels of an EXR file, (H, W) by name, finite.

    Raises:
        ImageFileError: The extension is unknown, or the file cannot be written.
        ShapeError, ParameterError: The array or an option is not as described.
    """
    if hasattr(path, "write"):
        options: dict[str, Any] = {
            "alpha": alpha,
            "quality": quality,
            "bits": bits,
            "color_space": color_space,
            "subsampling": subsampling,
            "dither": dither,
            "shoulder": shoulder,
            "extra_channels": extra_channels,
        }
        write_to_stream(cast(BinaryIO, path), format, lambda file: write_image(file, image, **options))
        return
    if format is not None:
        raise ParameterError("format", "nothing for a file, whose extension selects it", format)
    path = Path(path)
    check_writable(path)
    check_image("image", image)
    output_format = OutputFormat(
        color_space=color_space,
        bits=bits,
        quality=quality,
        subsampling=subsampling,
        dither=dither,
        shoulder=shoulder,
    )
    check_format(path, output_format)
    if alpha is not None:
        check_map("alpha", alpha)
        check_same_size("the picture", image, "alpha", alpha)
    check_extra_channels(path, image, extra_channels)
    store_picture(path, image, alpha, output_format, SourceFile(), extra_channels=extra_channels)


def write_map(path: Path | str, values: NDArray[Any], *, channel: str = "Y") -> None:
    """Write a single-channel map, such as a defocus or an error map, without any transfer function.

    ``.png`` has 8 bits: values are clipped to [0, 1] and rounded. ``.exr`` and ``.pfm`` keep float32
    values.

    Args:
        path: File to write, with one of ``MAP_EXTENSIONS``.
        values: Map (H, W), finite.
        channel: Name of the channel in an EXR file.

    Raises:
        ImageFileError: The extension is unknown, or the file cannot be written.
        ShapeError, ParameterError: The array is not as described.
    """
    path = Path(path)
    check_writable(path, MAP_EXTENSIONS)
    check_map("map", values)
    values = values[..., None]
    if path.suffix.lower() in (".exr", ".pfm"):
        encode(path, values.shape, np.float32, values.__getitem__, (channel,), {"compression": "zip"})
    else:

        def grey(rows: slice) -> NDArray[Any]:
            return quantise(np.clip(values[rows], 0, 1), 8)

        encode(path, values.shape, np.uint8, grey, ("Y",), {})


def check_extra_channels(
    path: Path, image: NDArray[Any], extra_channels: Mapping[str, NDArray[Any]] | None
) -> None:
    """Raise unless additional channels can be written with a picture.

    Raises:
        ShapeError: Their size differs from that of the picture.
        ParameterError: They hold NaN or infinity, or the format has no additional channels.
    """
    for name, channel in (extra_channels or {}).items():
        if path.suffix.lower() != ".exr":
            expected = "nothing, as only EXR has further channels"
            raise ParameterError("extra_channels", expected, name, "write an .exr")
        check_map(name, channel)
        check_same_size("the picture", image, name, channel)


def check_writable(path: Path | str, extensions: tuple[str, ...] = IMAGE_EXTENSIONS) -> None:
    """Raise unless a picture can be written at ``path``; call this before any long computation.

    Args:
        path: File to write.
        extensions: Supported extensions, lower case.

    Raises:
        ImageFileError: The extension is unknown, the folder is missing or read-only, or ``path`` is a folder.
    """
    path = Path(path)
    check_name(path)
    check_target(path)
    check_extension(path, extensions)
