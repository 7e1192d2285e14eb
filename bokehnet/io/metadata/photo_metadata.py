"""EXIF and XMP of a photograph, carried to the file of its blurred twin."""

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
_FURTHER_PICTURES = b"MPF\0"
_XMP_TEXT = "XML:com.adobe.xmp"
_TIFF_STARTS = (b"II*\0", b"MM\0*")

_MAPS = "depth maps, gain maps and further pictures in it no longer fit to the result and are left out"
_DAMAGED = "its {} is damaged and left out"


@dataclass(frozen=True, kw_only=True)
class Metadata:
    """EXIF and XMP of a photograph.

    Attributes:
        exif: Beginning with its TIFF header; None without.
        xmp: A packet; None without.
        left_out: What of the file will not be in the result, a line each.
    """

    exif: bytes | None = None
    xmp: bytes | None = None
    left_out: tuple[str, ...] = ()

    def refreshed(self, path: Path | str, width: int, height: int, *, is_srgb: bool | None) -> "Metadata":
        """Return the same for an upright picture of this size: no thumbnail, orientation 1.

        Args:
            path: Of the file that they are from, for messages.
            width: Of the picture.
            height: Of the picture.
            is_srgb: Whether its colours are sRGB; None where they are what they were.
        """
        exif, xmp = self.exif, self.xmp
        if exif is not None:
            exif = refreshed_exif(exif, width, height, is_srgb=is_srgb)
        if xmp is not None:
            xmp = refreshed_xmp(path, xmp)[0]
        return replace(self, exif=exif, xmp=xmp)


def read_metadata(path: Path, file_format: str) -> Metadata:
    """Read what a JPEG, PNG, TIFF, WebP or JPEG XL file tells besides its pixels; nothing of other formats.

    Metadata that are damaged are left out, which is told: they do not spoil a picture.

    Args:
        path: The file.
        file_format: ``"jpeg"``, ``"png"``, ``"tiff"``, ``"webp"``, ``"jpegxl"`` or another one.
    """
    readers: dict[str, Callable[[Path], Metadata]] = {
        "jpeg": _of_jpeg,
        "png": _of_png,
        "tiff": _of_tiff,
        "webp": _of_webp,
        "jpegxl": _of_jxl,
    }
    return checked(path, readers[file_format](path)) if file_format in readers else Metadata()


def checked(path: Path | str, found: Metadata) -> Metadata:
    """Return what of EXIF and XMP is whole, and tell of maps that they announce."""
    exif, xmp, told = found.exif, found.xmp, list(found.left_out)
    if exif is not None:
        exif = exif.removeprefix(_EXIF_SEGMENT)
        try:
            refreshed_exif(exif, 1, 1, is_srgb=True)
        except (ValueError, struct.error):
            exif = None
            told.append(_DAMAGED.format("EXIF"))
    if xmp is not None:
        try:
            if refreshed_xmp(path, xmp)[1]:
                told.append(_MAPS)
        except ImageFileError:
            xmp = None
            told.append(_DAMAGED.format("XMP"))
    return Metadata(exif=exif, xmp=xmp, left_out=tuple(dict.fromkeys(told)))


def _of_jpeg(path: Path) -> Metadata:
    exif, xmp = None, None
    told: tuple[str, ...] = ()
    for marker, payload in jpeg_segments(path):
        if marker == APP1 and payload.startswith(_EXIF_SEGMENT):
            exif = exif or payload
        elif marker == APP1 and payload.startswith(STANDARD_XMP):
            xmp = xmp or payload[len(STANDARD_XMP) :]
        elif (marker == APP1 and payload.startswith(_EXTENDED_XMP)) or (
            marker == APP2 and payload.startswith(_FURTHER_PICTURES)
        ):
            told = (_MAPS,)
    return Metadata(exif=exif, xmp=xmp, left_out=told)


def _of_png(path: Path) -> Metadata:
    exif, xmp = None, None
    for kind, data in png_chunks(path, (b"eXIf", b"iTXt")):
        if kind == b"eXIf":
            exif = exif or data
        elif (text := png_text(data, _XMP_TEXT)) is not None:
            xmp = xmp or text
    return Metadata(exif=exif, xmp=xmp)


def _of_webp(path: Path) -> Metadata:
    chunks = webp_chunks(path)
    return Metadata(exif=chunks.get(b"EXIF"), xmp=chunks.get(b"XMP "))


def _of_jxl(path: Path) -> Metadata:
    boxes = jxl_boxes(path)
    return Metadata(exif=boxes.get(b"Exif"), xmp=boxes.get(b"xml "))


def _of_tiff(path: Path) -> Metadata:
    with _mapped(path) as data:
        if bytes(data[:4]) not in _TIFF_STARTS:  # more than 4 GB: directories of another kind
            return Metadata()
        try:
            directory, _ = read_directory(data)
        except ValueError:
            return Metadata(left_out=(_DAMAGED.format("EXIF"),))
        packet = directory.get(XMP_PACKET)
        values = () if packet is None else packet.values
        xmp = values if isinstance(values, bytes) else bytes(int(value) & 255 for value in values)
        return Metadata(exif=exif_of_tiff(directory), xmp=xmp or None)


def add_metadata(path: Path, width: int, height: int, metadata: Metadata, icc: bytes | None) -> None:
    """Put profile and metadata into a file that holds the pixels alone, and nothing else; by the extension.

    PNG files get theirs while they are written.

    Args:
        path: JPEG, WebP, JPEG XL or TIFF file.
        width: Of the picture.
        height: Of the picture.
        metadata: Refreshed for this picture.
        icc: Colour profile; that of a TIFF and of a JPEG XL is there already.
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
