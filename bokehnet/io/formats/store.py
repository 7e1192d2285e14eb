"""Encode light as the stored values of a file: primaries, curve, bits, alpha, profile and metadata."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bokehnet.arrays.row_blocks import cut_row_blocks
from bokehnet.errors import ImageFileError
from bokehnet.io.color.color_space import LINEAR_REC709, SRGB, ColorSpace, chromaticities_of, convert
from bokehnet.io.color.dither import quantise
from bokehnet.io.containers.png import compressed_profile, text_chunk
from bokehnet.io.formats.encode import encode
from bokehnet.io.formats.output_format import (
    Bits,
    OutputFormat,
    choose_bits,
    dtype_of,
    profile_to_embed,
    target_space,
)
from bokehnet.io.formats.whole_picture import WHOLE_EXTENSIONS, Coding, encode_whole
from bokehnet.io.metadata.photo_metadata import Metadata, add_metadata
from bokehnet.progress import Progress

__all__ = ["SourceFile", "store_picture"]

_MAX_HALF = 65504.0
_MAX_HDR_SIDE_PX = 32767  # beyond it the run lengths of the rows no longer fit
# JPEG XL could hold alpha, but the decoder does not report its kind.
_NO_ALPHA_EXTENSIONS = (".jpg", ".jpeg", ".hdr", ".pfm", ".jxl")
_GREY_EXTENSIONS = (".png", ".jpg", ".jpeg", ".tif", ".tiff")
_CODECS = {".jpg": "jpeg", ".jpeg": "jpeg", ".webp": "webp", ".jxl": "jpegxl"}

# Quality at which WebP is lossless: below it, chroma has half the resolution.
_LOSSLESS_QUALITY = 100

Array = NDArray[Any]


@dataclass(frozen=True, kw_only=True, slots=True)
class SourceFile:
    """File that a picture was read from, as far as results inherit from it.

    Attributes:
        space: Colour space of the picture.
        bits: Bits per channel; None if results do not inherit them.
        metadata: Metadata of the file.
        path: Path of the file, for messages.
    """

    space: ColorSpace = LINEAR_REC709
    bits: Bits | None = None
    metadata: Metadata = field(default_factory=Metadata)
    path: Path | None = None


def store_picture(
    path: Path,
    image: Array,
    alpha: Array | None,
    output_format: OutputFormat,
    source: SourceFile,
    *,
    progress: Progress | None = None,
    extra_channels: Mapping[str, Array] | None = None,
) -> None:
    """Write a picture atomically; the caller has checked its arrays and its format.

    Args:
        path: File to write.
        image: Linear light in the primaries of the source's space, (H, W, 3), premultiplied if there is
            alpha.
        alpha: Coverage, (H, W).
        output_format: Colour space, bits and quality of the file.
        source: File of the picture.
        progress: Progress callback, called by several threads.
        extra_channels: Additional channels of an EXR file, (H, W) by name.

    Raises:
        ImageFileError: The file cannot be written, or cannot hold the picture.
    """
    extension = path.suffix.lower()
    stored_bits = choose_bits(extension, output_format.bits, source.bits)
    target = target_space(path, source.space, output_format.color_space, stored_bits)
    alpha = None if extension in _NO_ALPHA_EXTENSIONS else alpha
    if target.grey:
        target = _grey_or_color_space(target, image, alpha, extension)
    profile = profile_to_embed(target, source.space)
    height, width = image.shape[:2]
    metadata = source.metadata
    if metadata.exif is not None or metadata.xmp is not None:
        is_srgb = None if target == source.space else target == SRGB
        metadata = metadata.refreshed(source.path or path, width, height, is_srgb=is_srgb)
    channels = ("Y",) if target.grey else ("R", "G", "B") if alpha is None else ("R", "G", "B", "A")
    stored = _stored_values(image, alpha, source.space, target, stored_bits, output_format, extension)
    if extra_channels:
        stored = _with_channels(stored, tuple(extra_channels.values()))
        channels = (*channels, *extra_channels)
    if extension == ".hdr" and max(height, width) > _MAX_HDR_SIDE_PX:
        raise ImageFileError(
            f"{path}: HDR files are at most {_MAX_HDR_SIDE_PX} pixels wide and high, "
            f"got {width}x{height}; use .exr"
        )
    if extension in WHOLE_EXTENSIONS:
        coding = Coding(
            bits=int(stored_bits),
            quality=output_format.quality,
            subsampling=output_format.subsampling,
            icc=profile,
        )
        encode_whole(path, (height, width, len(channels)), stored, coding, metadata, progress)
        return
    attributes = _attributes(extension, output_format, target, profile)
    if alpha is not None and not isinstance(stored_bits, str):
        attributes["oiio:UnassociatedAlpha"] = 1  # the values are straight already
    encode(
        path,
        (height, width, len(channels)),
        dtype_of(stored_bits),
        stored,
        channels,
        attributes,
        chunks=_png_chunks(target, profile, metadata),
        finish=lambda temporary: add_metadata(temporary, width, height, metadata, profile),
        progress=progress,
    )


def _attributes(
    extension: str, output_format: OutputFormat, target: ColorSpace, profile: bytes | None
) -> dict[str, Any]:
    """Return the attributes of OpenImageIO for a format: compression, primaries, profile."""
    attributes: dict[str, Any] = {}
    if extension == ".exr":
        attributes["compression"] = "zip"
        if not target.shares_primaries(LINEAR_REC709):
            attributes["chromaticities"] = chromaticities_of(target)
    elif extension in _CODECS:
        attributes["compression"] = f"{_CODECS[extension]}:{output_format.quality}"
        if extension == ".webp" and output_format.quality == _LOSSLESS_QUALITY:
            attributes["compression"] = "lossless"
        if _CODECS[extension] == "jpeg":
            attributes["jpeg:subsampling"] = output_format.subsampling
    if extension in (".tif", ".tiff", ".jxl") and profile is not None:
        attributes["ICCProfile"] = profile
    return attributes


def _stored_values(
    image: Array,
    alpha: Array | None,
    source: ColorSpace,
    target: ColorSpace,
    bits: Bits,
    output_format: OutputFormat,
    extension: str,
) -> Callable[[slice], Array]:
    """Return a function from rows to their stored values."""
    # Code points and logarithms can represent light above white.
    bound = np.inf if target.cicp is not None or target.curves[0].kind == "log" else 1.0
    channels = 1 if target.grey else 3

    def light_of(rows: slice) -> Array:
        return convert(np.asarray(image[rows], np.float32), source, target)

    def floating(rows: slice) -> Array:
        values = light_of(rows) if alpha is None else np.dstack([light_of(rows), alpha[rows]])
        if bits == "half":
            return np.clip(values, -_MAX_HALF, _MAX_HALF)
        return np.maximum(values, 0) if extension == ".hdr" else values

    def integers(rows: slice) -> Array:
        light = light_of(rows)[..., :channels]
        if alpha is not None:
            coverage = alpha[rows]
            light = light / np.where(coverage > 0, coverage, 1)[..., None]
        if output_format.shoulder and bound == 1.0:
            light = light / np.sqrt(np.maximum(light.max(axis=-1, keepdims=True), 1))
        values = target.encode(np.clip(light, 0, bound))
        if alpha is not None:
            values = np.dstack([values, np.clip(coverage, 0, 1)])
        top = rows.start if output_format.dither and bits == 8 else None
        return quantise(values, int(bits), top=top)

    return floating if isinstance(bits, str) else integers


def _with_channels(stored: Callable[[slice], Array], others: Sequence[Array]) -> Callable[[slice], Array]:
    """Return a function that appends the rows of ``others``, (H, W), to those of ``stored``."""
    return lambda rows: np.dstack([stored(rows), *(other[rows] for other in others)])


def _grey_or_color_space(space: ColorSpace, image: Array, alpha: Array | None, extension: str) -> ColorSpace:
    """Return the grey space, or for pictures that now have colours, a colour space of the same curve."""
    neutral = all(
        (image[rows, :, 0] == image[rows, :, 1]).all() and (image[rows, :, 0] == image[rows, :, 2]).all()
        for rows in cut_row_blocks(image.shape)
    )
    if neutral and alpha is None and extension in _GREY_EXTENSIONS:
        return space
    return replace(space, name=f"{space.name}, in colour", icc=None, grey=False)


def _png_chunks(target: ColorSpace, profile: bytes | None, metadata: Metadata) -> list[tuple[bytes, bytes]]:
    """Return the chunks in front of the pixels of a PNG."""
    chunks = []
    if target.cicp is not None:
        chunks.append((b"cICP", bytes(target.cicp)))
    if profile is not None:
        chunks.append(compressed_profile(profile))
    elif target == SRGB:
        chunks.append((b"sRGB", b"\0"))
    if metadata.exif is not None:
        chunks.append((b"eXIf", metadata.exif))
    if metadata.xmp is not None:
        chunks.append(text_chunk("XML:com.adobe.xmp", metadata.xmp))
    return chunks
