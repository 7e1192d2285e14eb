"""What a picture's file is to be like: bits, colour space, quality; and which formats can be that."""

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

# Bits of each format, the usual ones first.
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

# Written only where the installed OpenImageIO has them, by the name of its part.
_OPTIONAL = {".jxl": "jpegxl"}

_SECOND_NAMES = (".jpeg", ".tiff", ".heif")
_WITHOUT_PROFILE = (".hdr", ".pfm")


@dataclass(frozen=True, kw_only=True)
class OutputFormat:
    """How a picture is written.

    Attributes:
        color_space: ``"keep"`` for that of the picture's file, or one of ``COLOR_SPACE_NAMES``.
        bits: Of each channel, or the type of floating-point values; None takes those of the picture's file
            where the format has them.
        quality: Of JPEG, WebP, JPEG XL, AVIF and HEIC, 1 to 100; WebP of 100 is without loss.
        subsampling: Of the colours of JPEG, AVIF and HEIC.
        dither: Whether rounding to 8 bits spreads its error, so that slopes show no bands.

    Raises:
        ParameterError: A value is none of these.
    """

    color_space: str = "keep"
    bits: Bits | None = None
    quality: int = 97
    subsampling: Subsampling = "4:4:4"
    dither: bool = True

    def __post_init__(self) -> None:
        check_choice("color_space", self.color_space, COLOR_SPACE_NAMES)
        check_range("quality", self.quality, 1, 100)
        check_choice("subsampling", self.subsampling, SUBSAMPLINGS)
        check_flag("dither", self.dither)


def check_format(path: Path, wanted: OutputFormat) -> None:
    """Raise unless the format of ``path`` can be as wanted; nothing is touched.

    Raises:
        ImageFileError: The extension is unknown, or not written here.
        MissingExtraError: An extra brings its encoder.
        ParameterError: The format has no such bits, or cannot tell the colour space.
    """
    extension = check_extension(path, IMAGE_EXTENSIONS)
    allowed = _BITS[extension]
    if wanted.bits is not None and wanted.bits not in allowed:
        expected = " or ".join(map(str, allowed)) or "none, since the format has its own,"
        remedy = _way_to(wanted.bits)
        raise ParameterError(
            "bits", f"{expected} for {extension}", wanted.bits, remedy, shown=f"{wanted.bits}"
        )
    if extension in _WITHOUT_PROFILE and wanted.color_space not in ("keep", "srgb"):
        raise ParameterError(
            "color_space",
            f"keep or srgb for {extension}, which cannot tell another one",
            wanted.color_space,
            "write .exr, or leave it out",
        )


def check_extension(path: Path, extensions: tuple[str, ...]) -> str:
    """Return the extension, lower case, or raise unless it can be written here.

    Raises:
        ImageFileError: The extension is unknown, or what is installed does not write it.
        MissingExtraError: An extra brings its encoder.
    """
    extension = path.suffix.lower()
    if extension not in extensions:
        known = ", ".join(extensions)
        raise ImageFileError(f"{path}: unknown extension {path.suffix!r}, expected one of {known}")
    if extension in WHOLE_EXTENSIONS:
        check_encoder(path)
    elif _OPTIONAL.get(extension, "png") not in _parts():
        raise ImageFileError(
            f"{path}: JPEG XL is not written by the installed OpenImageIO {oiio.__version__}; "
            "write .png, .jpg or .webp"
        )
    return extension


def choose_bits(extension: str, wanted: Bits | None, stored: Bits | None) -> Bits:
    """Return what is written: what is wanted, else what the picture's file has, as near as the format can.

    Args:
        extension: Of the file to be written.
        wanted: None for nothing in particular.
        stored: Of the file that was read; None if it does not matter.
    """
    allowed = _BITS[extension] or ("float",)
    if wanted is not None:
        return wanted
    if stored in allowed:
        return stored
    return 16 if stored not in (None, 8) and 16 in allowed else allowed[0]


def target_space(path: Path, source: ColorSpace, name: str, bits: Bits) -> ColorSpace:
    """Return the space in which the values of a file are stored.

    Args:
        path: Of the file to be written.
        source: Of the picture.
        name: ``"keep"``, or one of ``COLOR_SPACE_NAMES``.
        bits: That are written.

    Raises:
        ImageFileError: The format cannot tell the space of the picture.
    """
    extension = path.suffix.lower()
    space = source if name == "keep" else COLOR_SPACES[name]
    if extension in _WITHOUT_PROFILE:
        return LINEAR_REC709
    if isinstance(bits, str):
        same = space.shares_primaries(LINEAR_REC709)
        return LINEAR_REC709 if same else linear_twin(space)
    if space == LINEAR_REC709 or (space.is_linear and space.icc is None and space.cicp is None):
        return SRGB
    if space.icc is None and make_profile(space) is None and extension != ".png":
        raise ImageFileError(
            f"{path}: {extension} files cannot tell colours of {space.name}; write .png or .exr, or choose "
            "another colour space, such as display-p3"
        )
    return space


def linear_twin(space: ColorSpace) -> ColorSpace:
    """Return the space of the same primaries without a curve."""
    return ColorSpace(name=f"{space.name}, linear", to_pcs=space.to_pcs, curves=(LINEAR,) * 3)


def profile_to_embed(target: ColorSpace, source: ColorSpace) -> bytes | None:
    """Return the profile that a file gets; None for sRGB from sRGB or from light, which needs none."""
    if target.icc is not None:
        return target.icc
    if target in (SRGB, LINEAR_REC709) and source in (SRGB, LINEAR_REC709):
        return None
    return make_profile(target)


def _parts() -> tuple[str, ...]:
    return tuple(oiio.get_string_attribute("format_list").split(","))


def _way_to(bits: Any) -> str:
    having = [name for name, allowed in _BITS.items() if bits in allowed and name not in _SECOND_NAMES]
    return f"write {' or '.join(having)}" if having else "no format that is written here has them"


def dtype_of(bits: Bits) -> Any:
    """Return the type of stored values."""
    return {8: np.uint8, 10: np.uint16, 16: np.uint16, "half": np.float16, "float": np.float32}[bits]
