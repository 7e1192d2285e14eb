"""Depth maps in photos of Android phones: GDepth and Dynamic Depth, both described by XMP.

Source:
    Google, "Depth Map Metadata", developers.google.com/depthmap-metadata, 2023: properties and encoding.
    Google, "Dynamic Depth", version 1.0, 2019: Container, Item, Camera and Depth Map elements.
"""

import base64
import binascii
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

from bokehnet.errors import ImageFileError
from bokehnet.io.depth.depth_coding import DepthCoding, StoredDepth
from bokehnet.io.metadata.xmp import xmp_properties

__all__ = ["google_depth"]

_PHOTOS = "http://ns.google.com/photos/1.0/"
_GDEPTH, _GFOCUS, _GIMAGE = _PHOTOS + "depthmap/", _PHOTOS + "focus/", _PHOTOS + "image/"
_DYNAMIC = "http://ns.google.com/photos/dd/1.0/"
_CAMERA, _DEPTH_MAP, _IMAGE = _DYNAMIC + "camera/", _DYNAMIC + "depthmap/", _DYNAMIC + "image/"

# Namespaces of a container and of its items: those of the specification, and those of later phones.
_CONTAINERS = (
    (_DYNAMIC + "container/", _DYNAMIC + "item/"),
    (_PHOTOS + "container/", _PHOTOS + "container/item/"),
)

# mm. A missing unit should mean metres, but the phones that omit it store an unknown scale.
_LENGTHS = {"m": 1000.0, "meters": 1000.0, "mm": 1.0, "millimeters": 1.0}
_DIOPTRES = ("d", "diopters")
_MM_PER_M = 1000.0


@dataclass(frozen=True, kw_only=True, slots=True)
class _Item:
    """A file appended to the photo."""

    names: tuple[str | None, str | None]  # URI and semantic
    start: int
    length: int


def google_depth(path: Path | str, data: bytes, end: int, roots: Sequence[Element]) -> StoredDepth | None:
    """Return the depth map of an Android photo; None if there is none.

    Depth along the ray (``MeasureType`` OpticRay) is treated as depth along the axis.

    Args:
        path: File, for messages.
        data: Content of the file.
        end: End of its first picture.
        roots: Its XMP packets, the standard one first.

    Raises:
        ImageFileError: Announced data are damaged, missing or not as specified.
    """
    fields = xmp_properties(roots, _GDEPTH)
    if "Data" in fields:
        image = xmp_properties(roots, _GIMAGE)
        original = _base64(path, "GImage:Data", image["Data"]) if image.get("Data") else None
        return _stored(path, _base64(path, "GDepth:Data", fields["Data"]), fields, roots, original)
    items = _items(path, roots, end)
    fields = _depth_map_fields(roots)
    item = _find(items, fields.get("DepthURI"), ("Depth", "DepthMap"))
    if item is None:
        return None
    original_item = _find(items, _original_uri(roots), ("Original",))
    original = None if original_item is None else _cut(path, data, original_item)
    return _stored(path, _cut(path, data, item), fields, roots, original)


def _stored(
    path: Path | str,
    picture: bytes,
    fields: Mapping[str, str],
    roots: Sequence[Element],
    original: bytes | None,
) -> StoredDepth:
    focal = _number(path, "GFocus:FocalDistance", xmp_properties(roots, _GFOCUS).get("FocalDistance"))
    dioptres = fields.get("Units", "").lower() in _DIOPTRES
    focus = None
    if focal is not None and focal > 0 and _has_valid_range(fields, path):
        focus = focal if dioptres else 1 / focal
    return StoredDepth(picture=picture, coding=_coding(path, fields), focus=focus, original=original)


def _coding(path: Path | str, fields: Mapping[str, str]) -> DepthCoding:
    """Return the coding of the stored values; Near is stored as 0 and Far as 1."""
    kind = fields.get("Format", "RangeInverse").lower()
    if kind not in ("rangeinverse", "rangelinear"):
        raise ImageFileError(
            f"{path}: expected a depth map in RangeInverse or RangeLinear, found {fields['Format']!r}"
        )
    unit = fields.get("Units", "").lower()
    dioptres = unit in _DIOPTRES
    # RangeInverse is linear in the inverse of Near..Far, which is depth if they are dioptres.
    linear_in = "disparity" if (kind == "rangeinverse") != dioptres else "depth"
    length = _MM_PER_M if dioptres else _LENGTHS.get(unit)
    if _has_valid_range(fields, path):
        near, far = (float(fields[name]) for name in ("Near", "Far"))
        ends = (near, far) if dioptres else (1 / near, 1 / far)
        if linear_in == "disparity" or min(ends) > 0:
            return DepthCoding(ends=ends, linear_in=linear_in, unit=length)
    elif length is None and linear_in == "disparity":  # without a unit the range is not needed
        return DepthCoding(ends=(1.0, 0.0))
    raise ImageFileError(
        f"{path}: expected a depth map with 0 < Near < Far, "
        f"found Near {fields.get('Near')} and Far {fields.get('Far')}"
    )


def _has_valid_range(fields: Mapping[str, str], path: Path | str) -> bool:
    """Return whether Near and Far form a valid range."""
    near, far = (_number(path, name, fields.get(name)) for name in ("Near", "Far"))
    if near is None or far is None:
        return False
    if fields.get("Units", "").lower() in _DIOPTRES:
        return min(near, far) >= 0 and near != far and math.isfinite(near + far)
    return 0 < near < far


def _depth_map_fields(roots: Sequence[Element]) -> dict[str, str]:
    """Return the properties of the first depth map of any camera; without one, those of all packets."""
    maps = [element for root in roots for element in root.iter(f"{{{_CAMERA}}}DepthMap")]
    for element in maps:
        fields = xmp_properties([element], _DEPTH_MAP)
        if fields.get("ItemSemantic", "Depth").lower() == "depth":
            return fields
    return {} if maps else xmp_properties(roots, _DEPTH_MAP)


def _original_uri(roots: Sequence[Element]) -> str | None:
    for root in roots:
        for element in root.iter(f"{{{_CAMERA}}}Image"):
            fields = xmp_properties([element], _IMAGE)
            if fields.get("ItemSemantic", "").lower() == "original":
                return fields.get("ItemURI")
    return None


def _items(path: Path | str, roots: Sequence[Element], end: int) -> list[_Item]:
    """Return the files after the first picture, which is the first item of the directory."""
    for container, namespace in _CONTAINERS:
        elements = [element for root in roots for element in root.iter(f"{{{container}}}Item")]
        items: list[_Item] = []
        position = end
        for index, element in enumerate(elements):
            fields = xmp_properties([element], namespace)
            length, padding = (_byte_count(path, name, fields.get(name)) for name in ("Length", "Padding"))
            if index:
                names = fields.get("DataURI"), fields.get("Semantic")
                items.append(_Item(names=names, start=position, length=length))
                position += length
            position += padding
        if items:
            return items
    return []


def _find(items: Sequence[_Item], uri: str | None, semantics: Sequence[str]) -> _Item | None:
    """Return the item with this URI, otherwise with one of these semantics."""
    by_uri = (item for item in items if uri is not None and item.names[0] == uri)
    by_semantic = (item for item in items if item.names[1] in semantics)
    return next(by_uri, None) or next(by_semantic, None)


def _cut(path: Path | str, data: bytes, item: _Item) -> bytes:
    if item.start + item.length > len(data):
        raise ImageFileError(
            f"{path}: expected {item.length} bytes of {item.names[1] or item.names[0]} at byte {item.start}, "
            f"found the end of the file at byte {len(data)}; copy the whole photo again"
        )
    return data[item.start : item.start + item.length]


def _base64(path: Path | str, name: str, text: str) -> bytes:
    packed = "".join(text.split()).rstrip("=")  # some phones omit the padding
    try:
        return base64.b64decode(packed + "=" * (-len(packed) % 4), validate=True)
    except (binascii.Error, ValueError) as error:
        raise ImageFileError(f"{path}: {name} is not base64 ({error}); the photo is damaged") from error


def _number(path: Path | str, name: str, text: str | None) -> float | None:
    if text is None:
        return None
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if math.isnan(value):
        raise ImageFileError(f"{path}: {name}: expected a number, found {text[:40]!r}")
    return value


def _byte_count(path: Path | str, name: str, text: str | None) -> int:
    """Return a number of bytes in the container's directory; absent is 0."""
    digits = "0" if text is None else text
    if not (digits.isascii() and digits.isdigit() and len(digits) < 16):
        raise ImageFileError(f"{path}: Item:{name}: expected a number of bytes, found {digits[:40]!r}")
    return int(digits)
