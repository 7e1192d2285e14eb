"""HEIF pictures (HEIC of iPhones) and their depth maps, through the extra ``heif``."""

import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bokehnet.checks import require_extra
from bokehnet.errors import ImageFileError
from bokehnet.io.apple_depth import PIXEL_DATA, apple_coding
from bokehnet.io.color import srgb_to_linear
from bokehnet.io.depth_coding import DepthCoding
from bokehnet.io.intact import check_pixel_count
from bokehnet.io.xmp import parse_xmp

if TYPE_CHECKING:
    from pillow_heif import HeifDepthImage, HeifFile

__all__ = ["HEIF_EXTENSIONS", "is_heif", "read_heif_depth", "read_heif_image"]

HEIF_EXTENSIONS = (".heic", ".heif")

_BRANDS = (b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1")
_HDR_TRANSFERS = {16: "PQ", 18: "HLG"}  # ITU-T H.273, table 3

# What the decoder raises.
_DAMAGE = (OSError, ValueError, RuntimeError, SyntaxError, EOFError)

# Packets of further pictures are not handed out by the decoder: found as Adobe's XMP specification,
# part 3, "packet scanning", tells.
_PACKET = re.compile(rb"<x:xmpmeta.*?</x:xmpmeta>", re.DOTALL)


def is_heif(path: Path | str) -> bool:
    """Whether a file begins as a HEIF picture coded by HEVC; False for one that cannot be read."""
    try:
        with Path(path).open("rb") as file:
            head = file.read(12)
    except OSError:
        return False
    return head[4:8] == b"ftyp" and head[8:] in _BRANDS


def read_heif_image(path: Path | str) -> NDArray[np.float32]:
    """Read the primary picture as scene-linear light, upright; 1 is white.

    Decoded from sRGB, as every picture is: embedded colour profiles are not applied. Alpha is dropped by
    laying the picture over black.

    Args:
        path: HEIC or HEIF file.

    Returns:
        Image of shape (H, W, 3).

    Raises:
        ImageFileError: The file is damaged, too large, or coded for HDR screens.
        MissingExtraError: pillow-heif is not installed.
    """
    file = _open(path)
    transfer = (file.info.get("nclx_profile") or {}).get("transfer_characteristics")
    if transfer in _HDR_TRANSFERS:
        raise ImageFileError(
            f"{path}: expected an sRGB picture, found HDR values ({_HDR_TRANSFERS[transfer]}); save it as EXR"
        )
    values = _pixels(path, file)
    colours = min(3, values.shape[2] - (1 if file.has_alpha else 0))
    image = srgb_to_linear(np.broadcast_to(values[..., :colours], (*values.shape[:2], 3)))
    if file.has_alpha:
        image = image * values[..., -1:]
    return np.ascontiguousarray(image, np.float32)


def read_heif_depth(path: Path | str) -> tuple[NDArray[np.float32], DepthCoding] | None:
    """Read the depth map of the primary picture, upright as that; None if there is none.

    Args:
        path: HEIC or HEIF file.

    Returns:
        Stored values (H, W) in [0, 1], and what they mean. Without Apple's metadata they are taken for
        relative disparity, near is bright.

    Raises:
        ImageFileError: The file or the map is damaged, or the map holds evenly spaced depths.
        MissingExtraError: pillow-heif is not installed.

    Source:
        ISO/IEC 23008-12, "Image File Format", 2022: auxiliary pictures ``urn:mpeg:hevc:2015:auxid:2``.
        ITU-T H.265, 2023, annex G: depth representation information.
    """
    maps = _open(path).info["depth_images"]
    if not maps:
        return None
    coding = _apple_coding(path)
    if coding is None:
        kind = str((maps[0].info.get("metadata") or {}).get("representation_type", ""))
        if kind.endswith("uniform_Z") or kind == "2":
            raise ImageFileError(f"{path}: expected a map of disparity, found evenly spaced depths")
        coding = DepthCoding(ends=(0.0, 1.0))
    return _pixels(path, maps[0])[..., 0], coding


def _apple_coding(path: Path | str) -> DepthCoding | None:
    for packet in _PACKET.findall(Path(path).read_bytes()):
        if PIXEL_DATA.encode() in packet:
            coding = apple_coding(path, [parse_xmp(path, packet)])
            if coding is not None:
                return coding
    return None


def _open(path: Path | str) -> "HeifFile":
    require_extra("pillow_heif", "heif")
    import pillow_heif

    try:
        file = pillow_heif.open_heif(Path(path), convert_hdr_to_8bit=False)
    except _DAMAGE as error:
        raise ImageFileError(f"{path}: the HEIF file is truncated or damaged ({_one_line(error)})") from error
    if not len(file):
        raise ImageFileError(f"{path}: the HEIF file is damaged, it holds no picture")
    return file


def _pixels(path: Path | str, image: "HeifFile | HeifDepthImage") -> NDArray[np.float32]:
    """Decode to (H, W, C) in [0, 1]."""
    width, height = image.size
    check_pixel_count(path, width, height)
    try:
        values = np.asarray(image)
    except _DAMAGE as error:
        raise ImageFileError(f"{path}: the pixels are truncated or damaged ({_one_line(error)})") from error
    values = values if values.ndim == 3 else values[..., None]
    return values.astype(np.float32) / np.float32(np.iinfo(values.dtype).max)


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())
