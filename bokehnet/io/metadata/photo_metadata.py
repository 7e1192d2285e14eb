"""Read EXIF and XMP of a photograph and write them into the file of its blurred version."""

import mmap
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from bokehnet.errors import ImageFileError
from bokehnet.io.containers.jpeg import APP1, APP2, icc_segments, insert_segments, jpeg_segments
from bokehnet.io.containers.jxl import jxl_boxes, jxl_with
from bokehnet.io.containers.png import png_chunks, png_text
from bokehnet.io.containers.webp import webp_chunks, webp_with
from bokehnet.io.metadata.exif import (
    XMP_PACKET,
    Entry,
    append_tags,
    describing_tags,
    exif_of_tiff,
    read_directory,
    refreshed_exif,
)
from bokehnet.io.metadata.xmp import STANDARD_XMP, refreshed_xmp

__all__ = ["Metadata", "add_metadata", "read_metadata"]

_EXIF_SEGMENT = b"Exif\0\0"
_EXTENDED_XMP = b"http://ns.adobe.com/xmp/extension/\0"
_MULTI_PICTURE = b"MPF\0"
_XMP_TEXT = "XML:com.adobe.xmp"
_TIFF_STARTS = (b"II*\0", b"MM\0*")

_MAPS = "its depth maps, gain maps and additional pictures do not match the result and are omitted"
_DAMAGED = "its {} is damaged and omitted"


@dataclass(frozen=True, kw_only=True)
class Metadata:
    """EXIF and XMP of a photograph.

    Attributes:
        exif: EXIF that begins with its TIFF header, or None.
        xmp: XMP packet, or None.
        omitted: One line for each content of the file that the result does not contain.
    """

    exif: bytes | None = None
    xmp: bytes | None = None
    omitted: tuple[str, ...] = ()

    def refreshed(self, path: Path | str, width: int, height: int, *, is_srgb: bool | None) -> "Metadata":
        """Return the metadata for an upright picture of this size: no thumbnail, orientation 1.

        Args:
            path: File of the metadata, for messages.
            width: Width of the picture, pixels.
            height: Height of the picture, pixels.
            is_srgb: True for sRGB, False for another colour space, None for the original one.
        """
        exif, xmp = self.exif, self.xmp
        if exif is not None:
            exif = refreshed_exif(exif, width, height, is_srgb=is_srgb)
        if xmp is not None:
            xmp = refreshed_xmp(path, xmp)[0]
        return replace(self, exif=exif, xmp=xmp)


def read_metadata(path: Path, file_format: str) -> Metadata:
    """Read EXIF and XMP of a JPEG, PNG, TIFF, WebP or JPEG XL file; other formats return none.

    Damaged metadata are omitted with a note: they do not prevent the use of the picture.

    Args:
        path: Image file.
        file_format: ``"jpeg"``, ``"png"``, ``"tiff"``, ``"webp"``, ``"jpegxl"`` or another one.
    """
    readers: dict[str, Callable[[Path], Metadata]] = {
        "jpeg": _jpeg_metadata,
        "png": _png_metadata,
        "tiff": _tiff_metadata,
        "webp": _webp_metadata,
        "jpegxl": _jxl_metadata,
    }
    return validated(path, readers[file_format](path)) if file_format in readers else Metadata()


def validated(path: Path | str, metadata: Metadata) -> Metadata:
    """Return the intact parts of the metadata, with notes on damage and on announced maps."""
    exif, xmp, omitted = metadata.exif, metadata.xmp, list(metadata.omitted)
    if exif is not None:
        exif = exif.removeprefix(_EXIF_SEGMENT)
        try:
            refreshed_exif(exif, 1, 1, is_srgb=True)
        except (ValueError, struct.error):
            exif = None
            omitted.append(_DAMAGED.format("EXIF"))
    if xmp is not None:
        try:
            if refreshed_xmp(path, xmp)[1]:
                omitted.append(_MAPS)
        except ImageFileError:
            xmp = None
            omitted.append(_DAMAGED.format("XMP"))
    return Metadata(exif=exif, xmp=xmp, omitted=tuple(dict.fromkeys(omitted)))


def _jpeg_metadata(path: Path) -> Metadata:
    exif, xmp = None, None
    omitted: tuple[str, ...] = ()
    for marker, payload in jpeg_segments(path):
        if marker == APP1 and payload.startswith(_EXIF_SEGMENT):
            exif = exif or payload
        elif marker == APP1 and payload.startswith(STANDARD_XMP):
            xmp = xmp or payload[len(STANDARD_XMP) :]
        elif (marker == APP1 and payload.startswith(_EXTENDED_XMP)) or (
            marker == APP2 and payload.startswith(_MULTI_PICTURE)
        ):
            omitted = (_MAPS,)
    return Metadata(exif=exif, xmp=xmp, omitted=omitted)


def _png_metadata(path: Path) -> Metadata:
    chunks = png_chunks(path, (b"eXIf", b"iTXt"))
    exif = next((data for kind, data in chunks if kind == b"eXIf"), None)
    keyword = _XMP_TEXT.encode() + b"\0"
    packed = next((data for kind, data in chunks if kind == b"iTXt" and data.startswith(keyword)), None)
    xmp = None if packed is None else png_text(packed, _XMP_TEXT)
    omitted = (_DAMAGED.format("XMP"),) if packed is not None and xmp is None else ()
    return Metadata(exif=exif, xmp=xmp, omitted=omitted)


def _webp_metadata(path: Path) -> Metadata:
    chunks = webp_chunks(path)
    return Metadata(exif=chunks.get(b"EXIF"), xmp=chunks.get(b"XMP "))


def _jxl_metadata(path: Path) -> Metadata:
    boxes = jxl_boxes(path)
    return Metadata(exif=boxes.get(b"Exif"), xmp=boxes.get(b"xml "))


def _tiff_metadata(path: Path) -> Metadata:
    with _mapped(path) as data:
        if bytes(data[:4]) not in _TIFF_STARTS:  # BigTIFF, above 4 GB, has other directories
            return Metadata()
        try:
            directory, _ = read_directory(data)
        except ValueError:
            return Metadata(omitted=(_DAMAGED.format("EXIF"),))
        packet = directory.get(XMP_PACKET)
        values = () if packet is None else packet.values
        xmp = values if isinstance(values, bytes) else bytes(int(value) & 255 for value in values)
        return Metadata(exif=exif_of_tiff(directory), xmp=xmp or None)


def add_metadata(path: Path, width: int, height: int, metadata: Metadata, icc: bytes | None) -> None:
    """Insert profile and metadata into a file that holds only pixels; the extension selects the format.

    PNG files receive theirs while they are written.

    Args:
        path: JPEG, WebP, JPEG XL or TIFF file.
        width: Width of the picture, pixels.
        height: Height of the picture, pixels.
        metadata: Metadata refreshed for this picture.
        icc: Colour profile; TIFF and JPEG XL files contain it already.
    """
    exif, xmp = metadata.exif, metadata.xmp
    extension = path.suffix.lower()
    if extension in (".jpg", ".jpeg"):
        segments = [(APP1, _EXIF_SEGMENT + exif)] if exif else []
        segments += [(APP1, STANDARD_XMP + xmp)] if xmp else []
        path.write_bytes(insert_segments(path.read_bytes(), segments + (icc_segments(icc) if icc else [])))
    elif extension in (".tif", ".tiff"):
        _add_to_tiff(path, exif, xmp)
    elif extension == ".jxl" and (exif or xmp):
        path.write_bytes(jxl_with(path.read_bytes(), exif=exif, xmp=xmp))
    elif extension == ".webp" and (exif or xmp or icc):
        path.write_bytes(webp_with(path.read_bytes(), width, height, icc=icc, exif=exif, xmp=xmp))


def _add_to_tiff(path: Path, exif: bytes | None, xmp: bytes | None) -> None:
    tags = {} if exif is None else describing_tags(read_directory(exif)[0])
    if xmp is not None:
        tags[XMP_PACKET] = Entry(1, tuple(xmp))
    length = path.stat().st_size
    length += length % 2
    with _mapped(path) as data:
        if bytes(data[:4]) != b"II*\0":
            return
        added, start = append_tags(data, length, tags)
    with path.open("r+b") as file:
        file.seek(length)
        file.write(added)
        file.seek(4)
        file.write(struct.pack("<I", start))


@contextmanager
def _mapped(path: Path) -> Iterator[mmap.mmap]:
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        yield data
