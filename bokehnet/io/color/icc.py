"""Read and write ICC colour profiles of matrix and curves, and of grey.

Source: ICC.1:2022, "Image technology colour management - Architecture, profile format and data structure".
"""

import struct
from collections.abc import Mapping
from functools import lru_cache

import numpy as np

from bokehnet.errors import ImageFileError
from bokehnet.io.color.color_space import D50, SRGB, ColorSpace, cicp_space
from bokehnet.io.color.transfer import LINEAR, Curve, power

__all__ = ["make_profile", "read_profile"]

_HEADER = 128
_COLORANTS = (b"rXYZ", b"gXYZ", b"bXYZ")
_CURVES = (b"rTRC", b"gTRC", b"bTRC")
_TABLES = (b"A2B0", b"A2B1", b"A2B2", b"D2B0", b"D2B1")
_MAX_CURVE_SAMPLES = 2**16
_FIXED = 65536.0  # s15Fixed16Number

# Parameters among g, a, b, c, d, e, f that the kinds 0 to 4 of parametric curves store, 10.18.
_STORED_PARAMETERS = ("g", "gab", "gabc", "gabcd", "gabcdef")

_IDENTITY = (1.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0)

# IEC 61966-2-1 as a parametric curve.
_SRGB_VALUES = (2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045, 0.0, 0.0)

_WAY_OUT = "convert the picture to sRGB or Display P3 first, in any photo editor"


@lru_cache(maxsize=8)
def read_profile(data: bytes, source: str) -> ColorSpace:
    """Return the colour space of a profile.

    Args:
        data: Bytes of the profile.
        source: File that holds it, for messages.

    Raises:
        ImageFileError: The profile is damaged, or neither grey nor of matrix and curves.
    """
    try:
        tags = _tags(data)
        name = _description(tags) or "a profile without a name"
    except (ValueError, struct.error) as problem:
        raise ImageFileError(
            f"{source}: its colour profile is damaged ({problem}); remove it, or {_WAY_OUT}"
        ) from problem
    model = data[16:20]
    try:
        if model == b"GRAY" and b"kTRC" in tags:
            curve = _curve(tags[b"kTRC"])
            return ColorSpace(name=name, to_pcs=SRGB.to_pcs, curves=(curve,) * 3, icc=data, grey=True)
        if model == b"RGB " and all(tag in tags for tag in _COLORANTS + _CURVES):
            return _matrix_profile(data, tags, name)
    except (ValueError, struct.error) as problem:
        raise ImageFileError(
            f"{source}: its colour profile {name!r} is damaged ({problem}); remove it, or {_WAY_OUT}"
        ) from problem
    kind = model.decode("latin-1").strip()
    description = f"{kind} by a table" if _has_table(tags) else f"{kind} without curves"
    raise ImageFileError(
        f"{source}: expected a colour profile of matrix and curves, found {name!r}, {description}; {_WAY_OUT}"
    )


def _matrix_profile(data: bytes, tags: Mapping[bytes, bytes], name: str) -> ColorSpace:
    if b"cicp" in tags:
        primaries, transfer = struct.unpack_from(">2B", tags[b"cicp"], 8)
        coded = cicp_space(primaries, transfer)
        if coded is not None and transfer in (16, 18):
            return ColorSpace(name=name, to_pcs=coded.to_pcs, curves=coded.curves, icc=data, cicp=coded.cicp)
    columns = np.array([_xyz(tags[tag]) for tag in _COLORANTS])
    if abs(np.linalg.det(columns)) < 1e-6:
        raise ValueError("its primaries lie on one line")
    red, green, blue = (_curve(tags[tag]) for tag in _CURVES)
    note = f"the table of its colour profile {name!r}, beside matrix and curves," if _has_table(tags) else ""
    to_pcs = tuple(map(tuple, columns.T.tolist()))
    return ColorSpace(name=name, to_pcs=to_pcs, curves=(red, green, blue), icc=data, note=note)


def _has_table(tags: Mapping[bytes, bytes]) -> bool:
    return any(tag in tags for tag in _TABLES)


def _tags(data: bytes) -> dict[bytes, bytes]:
    """Split a profile into its tags."""
    if len(data) < _HEADER + 4 or data[36:40] != b"acsp":
        raise ValueError("the data do not begin with a profile")
    (count,) = struct.unpack_from(">I", data, _HEADER)
    if count > 1000:
        raise ValueError(f"{count} tags")
    tags = {}
    for index in range(count):
        tag, start, length = struct.unpack_from(">4s2I", data, _HEADER + 4 + 12 * index)
        if start + length > len(data):
            raise ValueError(f"tag {tag.decode('latin-1')!r} lies beyond its end")
        tags[tag] = data[start : start + length]
    return tags


def _description(tags: Mapping[bytes, bytes]) -> str:
    """Return the name of a profile of version 2 or 4; empty if there is none."""
    tag = tags.get(b"desc", b"")
    text = ""
    if tag[:4] == b"desc" and len(tag) > 12:
        (length,) = struct.unpack_from(">I", tag, 8)
        text = tag[12 : 12 + length].decode("latin-1")
    elif tag[:4] == b"mluc" and len(tag) >= 28:
        length, start = struct.unpack_from(">2I", tag, 20)
        text = tag[start : start + length].decode("utf-16-be", "replace")
    return " ".join(text.replace("\0", " ").split())[:80]


def _xyz(tag: bytes) -> tuple[float, ...]:
    if tag[:4] != b"XYZ ":
        raise ValueError("a colorant is not an XYZ value")
    return tuple(value / _FIXED for value in struct.unpack_from(">3i", tag, 8))


def _curve(tag: bytes) -> Curve:
    """Read a curve that rises from black to white."""
    curve = _stored_curve(tag)
    with np.errstate(all="ignore"):
        light = curve.decode(np.linspace(0, 1, 33))
        back = curve.encode(np.linspace(0, 1, 33))
    if not (np.isfinite(light).all() and np.isfinite(back).all() and 0.5 < light[-1] < 2 and light[0] < 0.5):
        raise ValueError("a curve does not rise from black to white")
    return curve


def _stored_curve(tag: bytes) -> Curve:
    if tag[:4] == b"curv":
        (count,) = struct.unpack_from(">I", tag, 8)
        if count > _MAX_CURVE_SAMPLES:
            raise ValueError(f"a curve of {count} samples")
        samples = struct.unpack_from(f">{count}H", tag, 12)
        if count < 2:
            return power(samples[0] / 256) if count else LINEAR
        if samples[-1] <= samples[0]:
            raise ValueError("a curve falls")
        return Curve("table", tuple(sample / 65535 for sample in samples))
    if tag[:4] == b"para":
        (kind,) = struct.unpack_from(">H", tag, 8)
        if kind >= len(_STORED_PARAMETERS):
            raise ValueError(f"a curve of the unknown kind {kind}")
        numbers = struct.unpack_from(f">{len(_STORED_PARAMETERS[kind])}i", tag, 12)
        return _parametric(kind, [number / _FIXED for number in numbers])
    raise ValueError(f"a curve of the unknown type {tag[:4].decode('latin-1')!r}")


def _parametric(kind: int, numbers: list[float]) -> Curve:
    """Return a parametric curve of any kind as the most general kind."""
    if kind == 0:
        curve = power(numbers[0])
    elif kind in (1, 2):
        g, a, b, *offset = numbers
        c = offset[0] if offset else 0.0
        curve = Curve("parametric", (g, a, b, 0.0, -b / a if a else 0.0, c, c))
    else:
        g, a, b, c, d, *offsets = numbers
        e, f = offsets or (0.0, 0.0)
        curve = Curve("parametric", (g, a, b, c, d, e, f))
    if curve.values in (_IDENTITY, (*_IDENTITY[:3], 0.0, *_IDENTITY[4:])):
        return LINEAR
    if curve.kind == "parametric" and not (curve.values[0] > 0 and curve.values[1] > 0):
        raise ValueError("a curve does not rise")
    return curve


@lru_cache(maxsize=16)
def make_profile(space: ColorSpace) -> bytes | None:
    """Return a profile (version 4.3) for ``space``; None if its curves cannot be stored in a profile.

    Equal spaces give equal bytes.
    """
    curves = [_curve_tag(curve) for curve in space.curves]
    columns = np.asarray(space.to_pcs).T
    tags = {
        b"desc": _text_tag(space.name),
        b"cprt": _text_tag("No copyright, use freely"),
        b"wtpt": _xyz_tag(D50),
    }
    for tag, column, name, curve in zip(_COLORANTS, columns, _CURVES, curves, strict=True):
        if curve is None:
            return None
        tags[tag], tags[name] = _xyz_tag(column), curve
    offsets: dict[bytes, int] = {}
    start = _HEADER + 4 + 12 * len(tags)
    table, body = b"", b""
    for tag, content in tags.items():  # equal tags share their data
        if content not in offsets:
            offsets[content] = start + len(body)
            body += content + bytes(-len(content) % 4)
        table += struct.pack(">4s2I", tag, offsets[content], len(content))
    head = struct.pack(
        ">I4sI4s4s4s6H4s4sI4s4sQI3I",
        start + len(body),
        bytes(4),
        0x04300000,
        b"mntr",
        b"RGB ",
        b"XYZ ",
        *(2024, 1, 1, 0, 0, 0),
        b"acsp",
        bytes(4),
        0,
        bytes(4),
        bytes(4),
        0,
        1,  # media-relative colorimetric
        *(round(value * _FIXED) for value in D50),
    )
    return head.ljust(_HEADER, b"\0") + struct.pack(">I", len(tags)) + table + body


def _curve_tag(curve: Curve) -> bytes | None:
    if curve.kind == "linear":
        return b"curv" + bytes(8)
    if curve.kind == "table":
        samples = [round(65535 * value) for value in curve.values]
        return b"curv" + struct.pack(f">2I{len(samples)}H", 0, len(samples), *samples)
    if curve.kind not in ("srgb", "parametric"):
        return None
    values = _SRGB_VALUES if curve.kind == "srgb" else curve.values
    fixed = [round(value * _FIXED) for value in values]
    if curve.kind == "parametric" and values[1:] == (1.0, 0.0, 0.0, 0.0, 0.0, 0.0):
        return b"para" + struct.pack(">I2Hi", 0, 0, 0, fixed[0])
    if values[5:] == (0.0, 0.0):
        return b"para" + struct.pack(">I2H5i", 0, 3, 0, *fixed[:5])
    return b"para" + struct.pack(">I2H7i", 0, 4, 0, *fixed)


def _text_tag(text: str) -> bytes:
    encoded = text.encode("utf-16-be")
    return b"mluc" + struct.pack(">3I2s2s2I", 0, 1, 12, b"en", b"US", len(encoded), 28) + encoded


def _xyz_tag(values: "tuple[float, ...] | np.ndarray") -> bytes:
    return b"XYZ " + struct.pack(">4x3i", *(round(float(value) * _FIXED) for value in values))
