"""Colour space of the picture in a file."""

import struct
from dataclasses import replace
from pathlib import Path

import numpy as np

from bokehnet.errors import ImageFileError
from bokehnet.io.color.camera_spaces import CINEON
from bokehnet.io.color.color_space import (
    COLOR_SPACES,
    LINEAR_REC709,
    SRGB,
    ColorSpace,
    cicp_space,
    space_of_chromaticities,
)
from bokehnet.io.color.icc import read_profile
from bokehnet.io.color.transfer import LINEAR, SRGB_CURVE, Curve, power
from bokehnet.io.containers.png import png_chunks
from bokehnet.io.metadata.exif import is_adobe_rgb
from bokehnet.io.pixels import ImageFile, Part

__all__ = ["FILM_FORMATS", "coded_space", "file_color_space"]

# Formats of film scans, and the spaces of the transfer curves that DPX headers name; others are undefined.
# Source: SMPTE ST 268-1, "File format for digital moving-picture exchange (DPX)", 2014, table 5A.
FILM_FORMATS = ("dpx", "cineon")
_DPX_SPACES = {
    "Printing density": CINEON,
    "Logarithmic": CINEON,
    "Linear": LINEAR_REC709,
    "SMPTE 274M": SRGB,
    "ITU-R 709-4": SRGB,
}

_NO_PROFILE_FORMATS = ("openexr", "hdr", "pfm")

# Exponent that viewers display as sRGB, with its tolerance.
_DEFAULT_GAMMA = 1 / 2.2
_GAMMA_TOLERANCE = 0.01


def file_color_space(file: ImageFile, part: Part, exif: bytes | None = None) -> ColorSpace:
    """Return the colour space of the stored values of a picture.

    In order of precedence: code points (cICP), the profile, in PNG the chunks ``sRGB``, ``gAMA`` and
    ``cHRM``, the EXIF of a camera; in EXR the attribute ``chromaticities``; in DPX the transfer curve.
    Without any, integers are sRGB and other values linear light.

    Args:
        file: Open file.
        part: Part of that file.
        exif: EXIF of that file.

    Raises:
        ImageFileError: The profile is damaged or its kind is unsupported, or a DPX file names no curve.

    Source: W3C, "Portable Network Graphics (PNG) Specification (Third Edition)", 2025, 4.3: precedence.
    """
    if file.headers is not None:
        return _exr_space(file, part)
    if file.file_format in _NO_PROFILE_FORMATS:
        return LINEAR_REC709
    if file.file_format in FILM_FORMATS:
        return _film_space(file, part)
    png = dict(png_chunks(file.path, (b"cICP", b"sRGB", b"gAMA", b"cHRM"))) if _is_png(file) else {}
    if len(code := png.get(b"cICP", b"")) == 4:
        coded = coded_space(file.path, code[0], code[1])
        if coded is not None:
            return coded
    profile = file.spec(part).getattribute("ICCProfile")
    if profile is not None:
        return read_profile(np.asarray(profile, np.uint8).tobytes(), str(file.path))
    if part.linear:
        return LINEAR_REC709
    if b"sRGB" not in png and (b"gAMA" in png or b"cHRM" in png):
        return _space_of_chunks(file.path, png.get(b"gAMA", b""), png.get(b"cHRM", b""))
    if exif is not None and is_adobe_rgb(exif):
        return COLOR_SPACES["adobe-rgb"]
    return SRGB


def coded_space(path: Path | str, primaries: int, transfer: int) -> ColorSpace | None:
    """Return the colour space of code points; None if they are unspecified.

    Raises:
        ImageFileError: The code points are unsupported.
    """
    if primaries == 2 or transfer == 2:  # unspecified
        return None
    space = cicp_space(primaries, transfer)
    if space is None:
        raise ImageFileError(
            f"{path}: expected the colours of Rec. 709, P3 or Rec. 2020, found the code points "
            f"{primaries} and {transfer} of ITU-T H.273; convert the picture first"
        )
    return space


def _film_space(file: ImageFile, part: Part) -> ColorSpace:
    """Return the space of a film scan: Cineon files are film log, DPX headers name a transfer curve."""
    if file.file_format == "cineon":
        return CINEON
    transfer = file.spec(part).get_string_attribute("dpx:Transfer")
    if transfer not in _DPX_SPACES:
        raise ImageFileError(
            f"{file.path}: the header does not name the transfer curve (found {transfer!r}); set "
            "`input.color_space`, such as cineon"
        )
    return _DPX_SPACES[transfer]


def _is_png(file: ImageFile) -> bool:
    return file.file_format == "png"


def _exr_space(file: ImageFile, part: Part) -> ColorSpace:
    """Return the linear space with the primaries of an EXR part; Rec.709 if it has none.

    Source: OpenEXR, "Standard Attributes", chromaticities: red, green, blue and white, CIE xy, eight floats.
    """
    assert file.headers is not None
    stored = file.headers.parts[part.index].get("chromaticities")
    if stored is None or stored.kind != "chromaticities" or len(stored.data) != 32:
        return LINEAR_REC709
    numbers = struct.unpack("<8f", stored.data)
    primaries = [numbers[start : start + 2] for start in (0, 2, 4, 6)]
    try:
        space = space_of_chromaticities("the chromaticities of its header", primaries, LINEAR)
    except ValueError as problem:
        raise ImageFileError(
            f"{file.path}: the chromaticities in its header are invalid ({problem}); remove the attribute"
        ) from problem
    return LINEAR_REC709 if space.shares_primaries(LINEAR_REC709) else space


def _space_of_chunks(path: Path, gamma: bytes, chromaticities: bytes) -> ColorSpace:
    curve, primaries = SRGB_CURVE, None
    if len(gamma) == 4:
        exponent = struct.unpack(">I", gamma)[0] / 100000
        if exponent > 0 and abs(exponent - _DEFAULT_GAMMA) > _GAMMA_TOLERANCE:
            curve = power(1 / exponent)
    if len(chromaticities) == 32:
        numbers = [value / 100000 for value in struct.unpack(">8I", chromaticities)]
        primaries = [numbers[start : start + 2] for start in (2, 4, 6, 0)]
    if primaries is None:
        return SRGB if curve == SRGB_CURVE else _srgb_with_curve(curve)
    try:
        space = space_of_chromaticities("the primaries of its header", primaries, curve)
    except ValueError as problem:
        raise ImageFileError(
            f"{path}: the primaries in its header are invalid ({problem}); remove the chunk cHRM"
        ) from problem
    if space.shares_primaries(SRGB):
        return SRGB if curve == SRGB_CURVE else _srgb_with_curve(curve)
    return space


def _srgb_with_curve(curve: Curve) -> ColorSpace:
    return replace(SRGB, name="sRGB with another gamma", curves=(curve, curve, curve))
