"""Bits, colour space and quality of output files, and the formats that support them."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import OpenImageIO as oiio  # noqa: N813

from bokehnet.checks import check_choice, check_flag, check_range
from bokehnet.errors import ImageFileError, ParameterError
from bokehnet.io.color.color_space import COLOR_SPACES, LINEAR_REC709, SRGB, ColorSpace
from bokehnet.io.color.icc import make_profile
from bokehnet.io.color.transfer import LINEAR
from bokehnet.io.formats.whole_picture import WHOLE_EXTENSIONS, check_encoder

__all__ = [
    "COLOR_SPACE_NAMES",
    "IMAGE_EXTENSIONS",
    "SUBSAMPLINGS",
    "Bits",
    "OutputFormat",
    "Subsampling",
    "check_extension",
    "check_format",
    "choose_bits",
    "dtype_of",
    "profile_to_embed",
    "target_space",
]

Bits = Literal[8, 10, 16, "half", "float"]
Subsampling = Literal["4:4:4", "4:2:2", "4:2:0"]

COLOR_SPACE_NAMES = ("keep", *COLOR_SPACES)
SUBSAMPLINGS = ("4:4:4", "4:2:2", "4:2:0")

# Supported bits of each format, default first.
_BITS: dict[str, tuple[Bits, ...]] = {
    ".png": (8, 16),
    ".jpg": (8,),
    ".jpeg": (8,),
    ".tif": (8, 16, "float"),
    ".tiff": (8, 16, "float"),
    ".webp": (8,),
    ".exr": ("half", "float"),
    ".hdr": (),
    ".pfm": ("float",),
    ".jxl": (8, 16, "half", "float"),
    ".avif": (8,),
    ".heic": (8, 10),
    ".heif": (8, 10),
}
IMAGE_EXTENSIONS = tuple(_BITS)

# Extensions that OpenImageIO may lack, with the name of the OpenImageIO format.
_OPTIONAL = {".jxl": "jpegxl"}

_EXTENSION_ALIASES = (".jpeg", ".tiff", ".heif")
_NO_PROFILE_EXTENSIONS = (".hdr", ".pfm")


@dataclass(frozen=True, kw_only=True)
class OutputFormat:
    """Colour space, bits and quality of an output file.

    Attributes:
        color_space: ``"keep"`` for the colour space of the input file, or one of ``COLOR_SPACE_NAMES``.
        bits: Bits per channel, or the type of floating-point values; None keeps those of the input file if
            the format supports them.
        quality: Quality of JPEG, WebP, JPEG XL, AVIF and HEIC, 1 to 100; WebP at 100 is lossless.
        subsampling: Chroma subsampling of JPEG, AVIF and HEIC.
        dither: True dithers the rounding to 8 bits, so that gradients show no bands.
        shoulder: True compresses light above white to its square root, with its colour, before each channel
            is clipped, so that lamps keep colour; files of whole numbers only. Light up to white is the same.

    Raises:
        ParameterError: A value is not one of these.
    """

    color_space: str = "keep"
    bits: Bits | None = None
    quality: int = 97
    subsampling: Subsampling = "4:4:4"
    dither: bool = True
    shoulder: bool = False

    def __post_init__(self) -> None:
        check_choice("color_space", self.color_space, COLOR_SPACE_NAMES)
        check_range("quality", self.quality, 1, 100)
        check_choice("subsampling", self.subsampling, SUBSAMPLINGS)
        check_flag("dither", self.dither)
        check_flag("shoulder", self.shoulder)


def check_format(path: Path, output_format: OutputFormat) -> None:
    """Raise unless the format of ``path`` supports ``output_format``; changes nothing.

    Raises:
        ImageFileError: The extension is unknown, or the installation cannot write it.
        MissingExtraError: The encoder needs an optional dependency.
        ParameterError: The format does not support the bits, or cannot store the colour space.
    """
    extension = check_extension(path, IMAGE_EXTENSIONS)
    allowed = _BITS[extension]
    if output_format.bits is not None and output_format.bits not in allowed:
        expected = " or ".join(map(str, allowed)) or "none, since the format has its own,"
        remedy = _formats_hint(output_format.bits)
        raise ParameterError(
            "bits",
            f"{expected} for {extension}",
            output_format.bits,
            remedy,
            shown=f"{output_format.bits}",
        )
    if extension in _NO_PROFILE_EXTENSIONS and output_format.color_space not in ("keep", "srgb"):
        raise ParameterError(
            "color_space",
            f"keep or srgb for {extension}, which cannot store another one",
            output_format.color_space,
            "write .exr, or leave it out",
        )


def check_extension(path: Path, extensions: tuple[str, ...]) -> str:
    """Return the extension in lower case, or raise unless it can be written.

    Raises:
        ImageFileError: The extension is unknown, or the installed libraries cannot write it.
        MissingExtraError: The encoder needs an optional dependency.
    """
    extension = path.suffix.lower()
    if extension not in extensions:
        known = ", ".join(extensions)
        raise ImageFileError(f"{path}: unknown extension {path.suffix!r}, expected one of {known}")
    if extension in WHOLE_EXTENSIONS:
        check_encoder(path)
    elif _OPTIONAL.get(extension, "png") not in _oiio_formats():
        raise ImageFileError(
            f"{path}: JPEG XL is not written by the installed OpenImageIO {oiio.__version__}; "
            "write .png, .jpg or .webp"
        )
    return extension


def choose_bits(extension: str, requested: Bits | None, stored: Bits | None) -> Bits:
    """Return the bits to write: the requested ones, otherwise the closest to those of the input file.

    Args:
        extension: Extension of the file to write.
        requested: Requested bits; None for no preference.
        stored: Bits of the input file; None if they do not matter.
    """
    allowed = _BITS[extension] or ("float",)
    if requested is not None:
        return requested
    if stored in allowed:
        return stored
    return 16 if stored not in (None, 8) and 16 in allowed else allowed[0]


def target_space(path: Path, source: ColorSpace, name: str, bits: Bits) -> ColorSpace:
    """Return the colour space of the stored values of a file.

    Args:
        path: File to write.
        source: Colour space of the picture.
        name: ``"keep"``, or one of ``COLOR_SPACE_NAMES``.
        bits: Bits to write.

    Raises:
        ImageFileError: The format cannot store the colour space of the picture.
    """
    extension = path.suffix.lower()
    space = source if name == "keep" else COLOR_SPACES[name]
    if extension in _NO_PROFILE_EXTENSIONS:
        return LINEAR_REC709
    if isinstance(bits, str):
        same = space.shares_primaries(LINEAR_REC709)
        return LINEAR_REC709 if same else _linear_space(space)
    if space == LINEAR_REC709 or (space.is_linear and space.icc is None and space.cicp is None):
        return SRGB
    if space.curves[0].kind == "log":
        if bits == 16:
            return space
        raise ImageFileError(
            f"{path}: {space.name} needs 16 bits; write .exr, or .png or .tif with `output.bits` 16, or "
            "choose `output.color_space` srgb"
        )
    if space.icc is None and make_profile(space) is None and extension != ".png":
        raise ImageFileError(
            f"{path}: {extension} files cannot store colours of {space.name}; write .png or .exr, or choose "
            "another colour space, such as display-p3"
        )
    return space


def _linear_space(space: ColorSpace) -> ColorSpace:
    """Return the colour space with the same primaries and a linear curve."""
    return ColorSpace(name=f"{space.name}, linear", to_pcs=space.to_pcs, curves=(LINEAR,) * 3)


def profile_to_embed(target: ColorSpace, source: ColorSpace) -> bytes | None:
    """Return the profile to embed; None for sRGB from sRGB or linear light, which needs none."""
    if target.icc is not None:
        return target.icc
    if target in (SRGB, LINEAR_REC709) and source in (SRGB, LINEAR_REC709):
        return None
    return make_profile(target)


def _oiio_formats() -> tuple[str, ...]:
    return tuple(oiio.get_string_attribute("format_list").split(","))


def _formats_hint(bits: Any) -> str:
    formats = [name for name, allowed in _BITS.items() if bits in allowed and name not in _EXTENSION_ALIASES]
    return f"write {' or '.join(formats)}" if formats else "no format that is written here has them"


def dtype_of(bits: Bits) -> Any:
    """Return the type of the stored values."""
    return {8: np.uint8, 10: np.uint16, 16: np.uint16, "half": np.float16, "float": np.float32}[bits]
