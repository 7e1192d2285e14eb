"""Read HEIF pictures (HEIC of iPhones) and their depth maps, extra ``heif``, and AVIF, extra ``avif``."""

from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from itertools import islice
from pathlib import Path
from struct import unpack_from
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bokehnet.arrays.row_blocks import in_row_blocks
from bokehnet.checks import require_extra
from bokehnet.errors import ImageFileError, MissingExtraError
from bokehnet.io.color.color_space import SRGB, ColorSpace
from bokehnet.io.color.file_color import coded_space
from bokehnet.io.color.icc import read_profile
from bokehnet.io.containers.heif_items import has_tone_map, tone_map_item
from bokehnet.io.containers.input_checks import check_pixel_count
from bokehnet.io.depth.apple_depth import PIXEL_DATA, apple_coding
from bokehnet.io.depth.depth_coding import DepthCoding
from bokehnet.io.metadata.gain_map import APPLE_ITEM, ISO_KIND, AppleCoding, GainCoding, iso_coding
from bokehnet.io.metadata.gain_map import apple_coding as gain_coding
from bokehnet.io.metadata.photo_metadata import Metadata, validated
from bokehnet.io.metadata.xmp import parse_xmp
from bokehnet.io.pixels import apply_orientation

if TYPE_CHECKING:
    from pillow_heif import HeifAuxImage, HeifDepthImage, HeifFile

__all__ = [
    "HEIF_EXTENSIONS",
    "HeifPicture",
    "heif_size",
    "is_avif",
    "is_heif",
    "read_heif",
    "read_heif_depth",
    "read_heif_gain_map",
]

HEIF_EXTENSIONS = (".heic", ".heif", ".avif")

_BRANDS = (b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1")
_AVIF_BRAND = b"avif"
_COLOR_BOX = b"colrnclx"  # ISO/IEC 14496-12, 12.1.5: primaries and transfer follow, 16 bits each
_HDR_TRANSFERS = (16, 18)  # PQ and HLG: ITU-T H.273, table 3
_MAPS_OMITTED = "its depth maps, gain maps and additional pictures do not match the result and are omitted"

# Exceptions of the decoder.
_DECODER_ERRORS = (OSError, ValueError, RuntimeError, SyntaxError, EOFError)

# The decoder does not return packets of auxiliary pictures: they are located by "packet scanning" of
# Adobe's XMP specification, part 3.
_PACKET_START, _PACKET_END = b"<x:xmpmeta", b"</x:xmpmeta>"
_MAX_PACKETS = 16


def is_heif(path: Path | str) -> bool:
    """Return whether a file begins like a HEIF picture coded with HEVC or AV1; False if it cannot be read."""
    return _brand(path) in (*_BRANDS, _AVIF_BRAND)


def is_avif(path: Path | str) -> bool:
    """Return whether a file begins like an AVIF picture; False if it cannot be read."""
    return _brand(path) == _AVIF_BRAND


def _brand(path: Path | str) -> bytes:
    try:
        with Path(path).open("rb") as file:
            head = file.read(12)
    except OSError:
        return b""
    return head[8:] if head[4:8] == b"ftyp" else b""


@dataclass(frozen=True, kw_only=True, eq=False)
class HeifPicture:
    """Primary picture of a file.

    Attributes:
        image: Linear light in the primaries of ``space``, upright, (H, W, 3), over black.
        space: Colour space of the stored values.
        bits: Bits per channel, 8 or more.
        metadata: EXIF and XMP.
    """

    image: NDArray[np.float32]
    space: ColorSpace
    bits: int
    metadata: Metadata


def heif_size(path: Path | str) -> tuple[int, int]:
    """Return height and width of the primary picture; reads only its header.

    Raises:
        ImageFileError: The file is damaged.
        MissingExtraError: pillow-heif is not installed, or Pillow for AVIF.
    """
    width, height = _open(path).size
    return int(height), int(width)


def read_heif(path: Path | str) -> HeifPicture:
    """Read the primary picture as upright light; 1 is white.

    The values are decoded through the colour profile or the code points (PQ and HLG among them), otherwise
    from sRGB. Alpha is dropped by compositing over black.

    Args:
        path: HEIC, HEIF or AVIF file. AVIF of more than 8 bits is decoded to 8.

    Raises:
        ImageFileError: The file is damaged or too large, or the kind of its profile is unsupported.
        MissingExtraError: pillow-heif is not installed, or Pillow for AVIF.
    """
    file = _open(path)
    space = _space(path, file)
    values = _pixels(path, file)
    colours = min(3, values.shape[2] - (1 if file.has_alpha else 0))
    image = in_row_blocks(space.decode, np.broadcast_to(values[..., :colours], (*values.shape[:2], 3)))
    if file.has_alpha:
        image = image * values[..., -1:]
    metadata = validated(path, Metadata(exif=file.info.get("exif"), xmp=file.info.get("xmp")))
    maps = file.info.get("depth_images") or file.info.get("aux")
    omitted = (*metadata.omitted, _MAPS_OMITTED) if maps else metadata.omitted
    return HeifPicture(
        image=np.ascontiguousarray(image, np.float32),
        space=space,
        bits=int(file.info.get("bit_depth", 8)),
        metadata=Metadata(exif=metadata.exif, xmp=metadata.xmp, omitted=tuple(dict.fromkeys(omitted))),
    )


def _space(path: Path | str, file: "HeifFile | _AvifFile") -> ColorSpace:
    """Return the colour space; code points of HDR come first, then the profile, then other code points."""
    code = file.info.get("nclx_profile") or {}
    primaries, transfer = (
        int(code.get(f"{name}", 2)) for name in ("color_primaries", "transfer_characteristics")
    )
    profile = file.info.get("icc_profile")
    if profile and transfer not in _HDR_TRANSFERS:
        return read_profile(bytes(profile), str(path))
    return coded_space(path, primaries, transfer) or SRGB


def read_heif_depth(path: Path | str) -> tuple[NDArray[np.float32], DepthCoding] | None:
    """Read the depth map of the primary picture, upright; None if there is none.

    Args:
        path: HEIC or HEIF file.

    Returns:
        Stored values (H, W) in [0, 1], and their coding. Without Apple's metadata they are treated as
        relative disparity, bright is near.

    Raises:
        ImageFileError: The file or the map is damaged, or the map holds evenly spaced depths.
        MissingExtraError: pillow-heif is not installed.

    Source:
        ISO/IEC 23008-12, "Image File Format", 2022: auxiliary pictures ``urn:mpeg:hevc:2015:auxid:2``.
        ITU-T H.265, 2023, annex G: depth representation information.
    """
    maps = _open(path).info.get("depth_images")
    if not maps:
        return None
    coding = _apple_coding(path)
    if coding is None:
        kind = str((maps[0].info.get("metadata") or {}).get("representation_type", ""))
        if kind.endswith("uniform_Z") or kind == "2":
            raise ImageFileError(f"{path}: expected a map of disparity, found evenly spaced depths")
        coding = DepthCoding(ends=(0.0, 1.0))
    return _pixels(path, maps[0])[..., 0], coding


def read_heif_gain_map(
    path: Path | str, exif: bytes | None
) -> tuple[str, NDArray[np.float32], AppleCoding | GainCoding] | None:
    """Read the gain map of the primary picture of a HEIC file, upright; None if there is none.

    A map of ISO 21496-1 has precedence over Apple's.

    Args:
        path: HEIC or HEIF file.
        exif: EXIF of the primary picture, or None.

    Returns:
        Kind, stored values of 0 to 1, (h, w, C), and their coding.

    Raises:
        ImageFileError: The map or its metadata are damaged.
    """
    if is_avif(path):
        return None
    data = Path(path).read_bytes()
    try:
        item = tone_map_item(data) if has_tone_map(data) else None
    except ValueError as error:
        raise ImageFileError(f"{path}: the gain map is damaged ({error})") from error
    if item is not None:
        if item.metadata[:1] != b"\0":
            raise ImageFileError(f"{path}: the gain map has an unknown version, expected 0")
        coding = iso_coding(path, item.metadata[1:])
        return ISO_KIND, _pixels(path, _open_heic(path, item.picture))[..., :3], coding
    file = _open_heic(path)
    maps = (file.info.get("aux") or {}).get(APPLE_ITEM)
    if not maps:
        return None
    packets = list(islice(_packets(data), _MAX_PACKETS))
    roots = [parse_xmp(path, packet) for packet in packets if b"HDRGainMapHeadroom" in packet]
    try:
        auxiliary = file[file.primary_index].get_aux_image(maps[0])
    except _DECODER_ERRORS as error:
        raise ImageFileError(f"{path}: the gain map is damaged ({_one_line(error)})") from error
    return "Apple HDR", _pixels(path, auxiliary)[..., :3], gain_coding(path, roots, exif)


def _apple_coding(path: Path | str) -> DepthCoding | None:
    for packet in islice(_packets(Path(path).read_bytes()), _MAX_PACKETS):
        if PIXEL_DATA.encode() in packet:
            coding = apple_coding(path, [parse_xmp(path, packet)])
            if coding is not None:
                return coding
    return None


def _packets(data: bytes) -> Iterator[bytes]:
    """Yield the XMP packets of a file, in a single pass."""
    end = 0
    while (start := data.find(_PACKET_START, end)) >= 0 and (end := data.find(_PACKET_END, start)) >= 0:
        end += len(_PACKET_END)
        yield data[start:end]


class _AvifFile:
    """AVIF picture with the interface of ``HeifFile``, decoded by Pillow to 8 bits.

    Attributes:
        size: Width and height of the upright picture.
        info: Profile, code points, EXIF of the upright picture, and XMP.
        has_alpha: Whether the last channel is alpha.
    """

    def __init__(self, path: Path | str) -> None:
        from PIL import ExifTags, Image

        self._file = Image.open(path, formats=["AVIF"])
        self.has_alpha = self._file.mode.endswith("A")
        exif = self._file.getexif()
        self._orientation = int(exif.get(ExifTags.Base.Orientation, 1))
        width, height = self._file.size
        self.size = (height, width) if self._orientation >= 5 else (width, height)
        self.info = dict(self._file.info)
        if self._orientation != 1:
            del exif[ExifTags.Base.Orientation]
            self.info["exif"] = exif.tobytes()
        data = Path(path).read_bytes()
        if (start := data.find(_COLOR_BOX)) >= 0:
            names = ("color_primaries", "transfer_characteristics")
            self.info["nclx_profile"] = dict(
                zip(names, unpack_from(">HH", data, start + len(_COLOR_BOX)), strict=True)
            )

    def __array__(self, dtype: object = None, copy: bool | None = None) -> NDArray[np.uint8]:
        values = np.asarray(self._file)
        return apply_orientation(values if values.ndim == 3 else values[..., None], self._orientation)


def _open(path: Path | str, data: bytes | None = None) -> "HeifFile | _AvifFile":
    """Open a file, or its contents changed."""
    return _open_avif(path) if data is None and is_avif(path) else _open_heic(path, data)


def _open_heic(path: Path | str, data: bytes | None = None) -> "HeifFile":
    require_extra("pillow_heif", "heif")
    import pillow_heif

    try:
        source = Path(path) if data is None else BytesIO(data)
        file = pillow_heif.open_heif(source, convert_hdr_to_8bit=False)
    except _DECODER_ERRORS as error:
        raise ImageFileError(f"{path}: the HEIF file is truncated or damaged ({_one_line(error)})") from error
    if not len(file):
        raise ImageFileError(f"{path}: the HEIF file is damaged, it holds no picture")
    return file


def _open_avif(path: Path | str) -> _AvifFile:
    require_extra("PIL", "avif")
    from PIL import features

    if not ("avif" in features.modules and features.check("avif")):
        raise MissingExtraError("reading AVIF needs Pillow 11.3 or later: pip install 'bokehnet[avif]'")
    try:
        return _AvifFile(path)
    except _DECODER_ERRORS as error:
        raise ImageFileError(f"{path}: the AVIF file is truncated or damaged ({_one_line(error)})") from error


def _pixels(
    path: Path | str, image: "HeifFile | _AvifFile | HeifDepthImage | HeifAuxImage"
) -> NDArray[np.float32]:
    """Decode to (H, W, C) in [0, 1]."""
    width, height = image.size
    check_pixel_count(path, width, height)
    try:
        values = np.asarray(image)
    except _DECODER_ERRORS as error:
        raise ImageFileError(f"{path}: the pixels are truncated or damaged ({_one_line(error)})") from error
    values = values if values.ndim == 3 else values[..., None]
    top = np.iinfo(values.dtype).max
    bits = getattr(image, "info", {}).get("bit_depth")
    bits = bits if isinstance(bits, int) else 8
    if values.dtype == np.uint16 and 8 < bits < 16:  # left-aligned in 16 bits
        top = (2**bits - 1) << (16 - bits)
    return values.astype(np.float32) / np.float32(top)


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())
