"""Gain maps: brightness beyond white that phones store beside an 8-bit picture, and their coding."""

import math
import re
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from xml.etree.ElementTree import Element

from bokehnet.errors import ImageFileError
from bokehnet.io.containers.heif_items import has_tone_map
from bokehnet.io.containers.jpeg import APP1, APP2, JPEG_START, jpeg_layout, segments_of
from bokehnet.io.metadata.exif import maker_note, read_directory
from bokehnet.io.metadata.xmp import jpeg_xmp, xmp_properties

__all__ = [
    "APPLE_ITEM",
    "ISO_KIND",
    "AppleCoding",
    "GainCoding",
    "StoredGainMap",
    "apple_coding",
    "gain_map_kind",
    "iso_coding",
    "jpeg_gain_map",
]

ISO_KIND = "ISO 21496-1"
_ISO = b"urn:iso:std:iso:ts:21496:-1"
_ULTRA_HDR, _APPLE = "http://ns.adobe.com/hdr-gain-map/1.0/", "http://ns.apple.com/HDRGainMap/1.0/"
APPLE_ITEM = "urn:com:apple:photo:2020:aux:hdrgainmap"
_PIXEL_DATA = "http://ns.apple.com/pixeldatainfo/1.0/"
_RDF_ITEM = "{http://www.w3.org/1999/02/22-rdf-syntax-ns#}li"

# Names of gain maps in files, most specific first. Sources: ISO 21496-1, 2025, annex C; Adobe, "Gain map
# specification", 2023; Apple, "Applying Apple HDR effect to your photos", 2023.
_NAMES = {
    _ISO: ISO_KIND,
    _ULTRA_HDR.encode(): "Ultra HDR",
    APPLE_ITEM.encode(): "Apple HDR",
    _APPLE.encode(): "Apple HDR",
}

_MAX_STOPS = 16.0  # bound of every logarithm of a gain; real maps have 2 to 6
_MAX_PICTURES = 8  # pictures after the primary one that are searched
_APPLE_NOTE = b"Apple iOS\0"
_APPLE_NOTE_START = 14  # of the directory, after the name, a version and the byte order
_HEADROOM_TAGS = 33, 48
_MULTICHANNEL, _COMMON_DENOMINATOR = 0x80, 0x08  # flags of ISO 21496-1; the second as libultrahdr writes it


@dataclass(frozen=True, kw_only=True, slots=True)
class GainCoding:
    """Coding of a gain map of ISO 21496-1 or Ultra HDR, one value or one for each channel.

    Attributes:
        low: Binary logarithm of the gain stored as 0.
        high: Binary logarithm of the gain stored as 1.
        gamma: Exponent whose inverse is applied to stored values.
        base_offset: Light added to the picture before the gain.
        offset: Light subtracted after it.
    """

    low: tuple[float, ...]
    high: tuple[float, ...]
    gamma: tuple[float, ...]
    base_offset: tuple[float, ...]
    offset: tuple[float, ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class AppleCoding:
    """Coding of Apple's gain map.

    Attributes:
        headroom: Largest gain.
    """

    headroom: float


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class StoredGainMap:
    """Gain map as stored.

    Attributes:
        kind: Name of its specification.
        picture: Encoded map.
        coding: Conversion of its values to gains.
    """

    kind: str
    picture: bytes
    coding: GainCoding | AppleCoding


def gain_map_kind(path: Path | str) -> str:
    """Return the kind of the gain map in a JPEG or HEIF file; empty if there is none.

    The file is searched for the names of gain maps, which are stored uncompressed.

    Args:
        path: Readable file.

    Examples:
        >>> _ = Path("plain.jpg").write_bytes(bytes(100))
        >>> gain_map_kind("plain.jpg")
        ''
    """
    data = Path(path).read_bytes()
    if has_tone_map(data):
        return ISO_KIND
    return next((kind for name, kind in _NAMES.items() if name in data), "")


def jpeg_gain_map(path: Path | str, exif: bytes | None) -> StoredGainMap | None:
    """Return the gain map among the pictures after the primary one of a JPEG file; None without one.

    These are the pictures of CIPA DC-007, "Multi-picture format", 2009. They are located by their start,
    because editors move them without correcting the index. The map's own metadata decide.

    Args:
        path: JPEG file.
        exif: EXIF of the primary picture, for the headroom of Apple's maps.

    Raises:
        ImageFileError: The metadata of the map are damaged or out of range.
    """
    data = Path(path).read_bytes()
    if not any(name in data for name in _NAMES):
        return None
    for start, end in islice(_pictures_after_primary(data), _MAX_PICTURES):
        segments = segments_of(data, start)
        iso = next((s for marker, s in segments if marker == APP2 and s.startswith(_ISO + b"\0")), b"")
        roots = jpeg_xmp(path, [payload for marker, payload in segments if marker == APP1])
        picture = data[start:end]
        if len(iso) > len(_ISO) + 1 + 4:  # four bytes are a version alone
            return StoredGainMap(
                kind=ISO_KIND, picture=picture, coding=iso_coding(path, iso[len(_ISO) + 1 :])
            )
        if "Version" in xmp_properties(roots, _ULTRA_HDR):
            return StoredGainMap(kind="Ultra HDR", picture=picture, coding=_xmp_coding(path, roots))
        is_apple = xmp_properties(roots, _PIXEL_DATA).get("AuxiliaryImageType") == APPLE_ITEM
        if is_apple or xmp_properties(roots, _APPLE):
            return StoredGainMap(kind="Apple HDR", picture=picture, coding=apple_coding(path, roots, exif))
    return None


def _pictures_after_primary(data: bytes) -> list[tuple[int, int]]:
    pictures: list[tuple[int, int]] = []
    end = jpeg_layout(data).end
    while len(pictures) < _MAX_PICTURES and (start := data.find(JPEG_START, end)) >= 0:
        end = jpeg_layout(data, start).end
        pictures.append((start, end))
    return pictures


def iso_coding(path: Path | str, body: bytes) -> GainCoding:
    """Return the coding in metadata of ISO 21496-1, annex C.2: big-endian fractions.

    Args:
        path: File, for messages.
        body: Metadata, from the minimum version on.

    Raises:
        ImageFileError: The metadata are damaged or out of range.
    """
    try:
        minimum, _, flags = struct.unpack_from(">HHB", body)
        channels = 3 if flags & _MULTICHANNEL else 1
        count = 2 + 5 * channels
        if flags & _COMMON_DENOMINATOR:
            words = struct.unpack_from(f">II{'I' + 'iiIii' * channels}", body, 5)
            numerators, denominators = words[1:], (words[0],) * count
        else:
            words = struct.unpack_from(f">IIII{'iIiIIIiIiI' * channels}", body, 5)
            numerators, denominators = words[0::2], words[1::2]
        numbers = [n / d for n, d in zip(numerators, denominators, strict=True)]
    except (struct.error, ZeroDivisionError) as error:
        raise ImageFileError(f"{path}: the gain map's metadata are damaged ({error})") from error
    if minimum:
        raise ImageFileError(f"{path}: the gain map needs a reader of version {minimum}, expected 0")
    if numbers[0] >= numbers[1]:
        raise ImageFileError(f"{path}: the gain map darkens an HDR picture, expected one that brightens SDR")
    low, high, gamma, base, offset = (tuple(numbers[2 + i :: 5]) for i in range(5))
    coding = GainCoding(low=low, high=high, gamma=gamma, base_offset=base, offset=offset)
    return _checked(path, coding)


def _xmp_coding(path: Path | str, roots: Sequence[Element]) -> GainCoding:
    """Return the coding in the XMP of a map; defaults as in Adobe's specification."""
    fields = xmp_properties(roots, _ULTRA_HDR)
    if fields.get("BaseRenditionIsHDR", "False").lower() == "true":
        raise ImageFileError(f"{path}: the gain map darkens an HDR picture, expected one that brightens SDR")

    def numbers(name: str, default: float | None) -> tuple[float, ...]:
        texts = [fields[name]] if name in fields else []
        for root in roots if not texts else ():
            for element in root.iter(f"{{{_ULTRA_HDR}}}{name}"):
                texts = [item.text or "" for item in element.iter(_RDF_ITEM)]
        if not texts and default is not None:
            return (default,)
        try:
            values = tuple(float(text) for text in texts)
        except ValueError:
            values = ()
        if len(values) not in (1, 3):
            raise ImageFileError(f"{path}: hdrgm:{name}: expected 1 or 3 numbers, found {texts[:4]}")
        return values

    coding = GainCoding(
        low=numbers("GainMapMin", 0.0),
        high=numbers("GainMapMax", None),
        gamma=numbers("Gamma", 1.0),
        base_offset=numbers("OffsetSDR", 1 / 64),
        offset=numbers("OffsetHDR", 1 / 64),
    )
    return _checked(path, coding)


def _checked(path: Path | str, coding: GainCoding) -> GainCoding:
    """Return a coding whose numbers are in range; otherwise raise."""
    logs, gammas, offsets = (*coding.low, *coding.high), coding.gamma, (*coding.base_offset, *coding.offset)
    # Comparisons with NaN are false.
    valid = all(-_MAX_STOPS <= value <= _MAX_STOPS for value in logs)
    valid = valid and all(0.01 <= value <= 100 for value in gammas)
    valid = valid and all(-1 <= value <= 1 for value in offsets)
    if not valid or max(coding.high) <= min(coding.low):
        raise ImageFileError(
            f"{path}: expected a gain map of at most {_MAX_STOPS:.0f} stops with exponents above 0, "
            f"found stops {coding.low} to {coding.high}, exponents {gammas}, offsets {offsets}"
        )
    return coding


def apple_coding(path: Path | str, roots: Sequence[Element], exif: bytes | None) -> AppleCoding:
    """Return the coding of Apple's map, from its XMP or the maker note of its picture.

    Args:
        path: File, for messages.
        roots: Parsed XMP of the map.
        exif: EXIF of the picture, or None.

    Raises:
        ImageFileError: The headroom is missing or out of range.

    Source: Apple, "Applying Apple HDR effect to your photos", 2023: stops by tags 33 and 48.
    """
    text = xmp_properties(roots, _APPLE).get("HDRGainMapHeadroom")
    if text is not None:
        if not re.fullmatch(r"\d{1,4}(\.\d{1,16})?", text) or not 1 <= float(text) <= 2**_MAX_STOPS:
            raise ImageFileError(f"{path}: HDRGainMapHeadroom: expected 1 or more, found {text[:40]!r}")
        return AppleCoding(headroom=float(text))
    bright, dark = _apple_tags(exif)
    if not (math.isfinite(bright) and math.isfinite(dark)):
        raise ImageFileError(f"{path}: expected the headroom of Apple's gain map in tags 33 and 48")
    if bright < 1:
        stops = -20 * dark + 1.8 if dark <= 0.01 else -0.101 * dark + 1.601
    else:
        stops = -70 * dark + 3.0 if dark <= 0.01 else -0.303 * dark + 2.303
    return AppleCoding(headroom=float(2 ** min(max(stops, 0.0), _MAX_STOPS)))


def _apple_tags(exif: bytes | None) -> tuple[float, float]:
    """Return tags 33 and 48 of Apple's maker note; NaN if they are absent or damaged."""
    note = maker_note(exif) if exif is not None else b""
    if not note.startswith(_APPLE_NOTE):
        return math.nan, math.nan
    # Offsets count from the start of the note, which begins with a name in place of a TIFF header.
    header = b"MM\0*" + struct.pack(">I", _APPLE_NOTE_START)
    try:
        tags = read_directory(header + note[len(header) :], depth=0)[0]
        pairs = [tags[tag].values for tag in _HEADROOM_TAGS]
        first, second = (float(pair[0]) / float(pair[1]) for pair in pairs)
    except (ValueError, KeyError, IndexError, ZeroDivisionError):
        return math.nan, math.nan
    return first, second
