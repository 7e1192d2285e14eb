"""Colour spaces and conversion between them.

A picture is rendered in linear light of its own primaries: its values are only decoded by the curves of its
space, and encoded the same way. So no colour is clipped or becomes negative, and nothing is lost.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bokehnet.arrays.row_blocks import in_row_blocks
from bokehnet.io.color.transfer import HLG, LINEAR, PQ, SRGB_CURVE, Curve, power

__all__ = [
    "COLOR_SPACES",
    "D50",
    "LINEAR_REC709",
    "REC709",
    "SRGB",
    "ColorSpace",
    "adaptation",
    "chromaticities_of",
    "cicp_space",
    "convert",
    "space_of_chromaticities",
]

D50 = (0.9642, 1.0, 0.8249)
"""White of the profile connection space, XYZ.

Source: ICC.1:2022, "Image technology colour management", 7.2.16.
"""

_D65 = (0.3127, 0.3290)

# Lam, "Metamerism and colour constancy", 1985, as ICC.1:2022 gives it in annex E.
_BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])

# Matrices that differ by less are treated as equal, because profiles round their values.
_MATRIX_TOLERANCE = 1e-3

Chromaticities = tuple[tuple[float, float], ...]

# Red, green, blue and white, CIE xy.
REC709: Chromaticities = ((0.64, 0.33), (0.30, 0.60), (0.15, 0.06), _D65)
_P3: Chromaticities = ((0.680, 0.320), (0.265, 0.690), (0.150, 0.060), _D65)
_ADOBE: Chromaticities = ((0.64, 0.33), (0.21, 0.71), (0.15, 0.06), _D65)
_ROMM: Chromaticities = ((0.7347, 0.2653), (0.1596, 0.8404), (0.0366, 0.0001), (0.3457, 0.3585))
_REC2020: Chromaticities = ((0.708, 0.292), (0.170, 0.797), (0.131, 0.046), _D65)

# ITU-R BT.2020-2, table 4: V = alpha L^0.45 - (alpha - 1) for L >= beta, otherwise 4.5 L.
_ALPHA, _BETA = 1.09929682680944, 0.018053968510807


@dataclass(frozen=True, kw_only=True)
class ColorSpace:
    """Primaries and transfer curves of a picture.

    Attributes:
        name: Display name.
        to_pcs: Matrix from linear red, green and blue to XYZ relative to D50, by rows.
        curves: Curves from stored red, green and blue to light.
        icc: Profile as stored in the file, or None.
        cicp: Code points (primaries, transfer, matrix, range) if they define the space.
        grey: True for the profile of a grey picture, which has one curve.
        note: Unsupported content of the profile, in a few words.

    Source: ICC.1:2022, "Image technology colour management", annex F.3 (three-component matrix-based
        profiles).
    """

    name: str
    to_pcs: tuple[tuple[float, ...], ...]
    curves: tuple[Curve, Curve, Curve]
    icc: bytes | None = None
    cicp: tuple[int, int, int, int] | None = None
    grey: bool = False
    note: str = ""

    @property
    def is_linear(self) -> bool:
        """True if stored values are linear light."""
        return all(curve == LINEAR for curve in self.curves)

    def shares_primaries(self, other: "ColorSpace") -> bool:
        """Return whether both spaces have the same primaries, up to rounding."""
        difference = np.subtract(_between(self.to_pcs, other.to_pcs), np.eye(3))
        return bool(np.abs(difference).max() < _MATRIX_TOLERANCE)

    def decode(self, stored: NDArray[Any]) -> NDArray[Any]:
        """Return the light of stored values (..., 1 or 3), of the same type."""
        return self._apply("decode", stored)

    def encode(self, light: NDArray[Any]) -> NDArray[Any]:
        """Return the stored values of light (..., 1 or 3), at least 0."""
        return self._apply("encode", light)

    def _apply(self, direction: str, values: NDArray[Any]) -> NDArray[Any]:
        if len(set(self.curves)) == 1 or values.shape[-1] == 1:
            result: NDArray[Any] = getattr(self.curves[0], direction)(values)
            return result
        planes = [getattr(curve, direction)(values[..., i]) for i, curve in enumerate(self.curves)]
        return np.stack(planes, axis=-1)


def convert(
    light: NDArray[np.float32],
    source: ColorSpace,
    target: ColorSpace,
    out: NDArray[np.float32] | None = None,
) -> NDArray[np.float32]:
    """Return the same colours in the primaries of another space; out-of-gamut colours have negative values.

    Args:
        light: Linear in the primaries of ``source``, (H, W, 3).
        source: Colour space of ``light``.
        target: Colour space of the result.
        out: Array for the result; may be ``light``. None allocates one.
    """
    if source.shares_primaries(target):
        return light
    matrix = np.asarray(_between(source.to_pcs, target.to_pcs), np.float32).T
    return in_row_blocks(lambda rows: rows @ matrix, light, np.float32, out=out)


def adaptation(white: Sequence[float] | NDArray[Any]) -> NDArray[np.float64]:
    """Return the matrix that adapts XYZ under ``white`` (XYZ) to D50.

    Source: ICC.1:2022, annex E, "Chromatic adaptation tag".
    """
    scale = (_BRADFORD @ D50) / (_BRADFORD @ np.asarray(white))
    matrix: NDArray[np.float64] = np.linalg.inv(_BRADFORD) @ np.diag(scale) @ _BRADFORD
    return matrix


def space_of_chromaticities(
    name: str, chromaticities: Sequence[Sequence[float]], curve: Curve, **attributes: Any
) -> ColorSpace:
    """Return the colour space with these primaries.

    Args:
        name: Display name.
        chromaticities: Red, green, blue and white, CIE xy.
        curve: Curve from stored values to light.
        attributes: Other attributes of the space.

    Raises:
        ValueError: The primaries are collinear, or the white is invalid.

    Source: SMPTE RP 177, "Derivation of basic television color equations", 1993.
    """
    xy = np.asarray(chromaticities, np.float64)
    if xy.shape != (4, 2) or not np.isfinite(xy).all() or (xy[:, 1] == 0).any() or xy[3, 1] <= 0:
        raise ValueError("primaries are not four pairs of x and y")
    xyz = np.stack([xy[:, 0] / xy[:, 1], np.ones(4), (1 - xy.sum(axis=1)) / xy[:, 1]])
    if abs(np.linalg.det(xyz[:, :3])) < 1e-9:
        raise ValueError("primaries lie on one line")
    matrix = xyz[:, :3] * np.linalg.solve(xyz[:, :3], xyz[:, 3])
    to_pcs = tuple(map(tuple, (adaptation(xyz[:, 3]) @ matrix).tolist()))
    return ColorSpace(name=name, to_pcs=to_pcs, curves=(curve, curve, curve), **attributes)


def chromaticities_of(space: ColorSpace) -> tuple[float, ...]:
    """Return red, green, blue and white of a space, CIE xy one after the other, adapted to D65."""
    white = np.array([_D65[0] / _D65[1], 1, (1 - sum(_D65)) / _D65[1]])
    xyz = np.linalg.solve(adaptation(white), np.asarray(space.to_pcs, np.float64))
    xy = (xyz[:2] / xyz.sum(axis=0)).T
    return (*xy.ravel().tolist(), *_D65)


SRGB = space_of_chromaticities("sRGB", REC709, SRGB_CURVE)
LINEAR_REC709 = space_of_chromaticities("linear Rec.709", REC709, LINEAR)

COLOR_SPACES: dict[str, ColorSpace] = {
    "srgb": SRGB,
    # SMPTE EG 432-1, "Digital source processing - Color processing for D-cinema", 2010, with sRGB's curve.
    "display-p3": space_of_chromaticities("Display P3", _P3, SRGB_CURVE),
    # Adobe, "Adobe RGB (1998) color image encoding", 2005, 4.3.
    "adobe-rgb": space_of_chromaticities("Adobe RGB (1998)", _ADOBE, power(2 + 51 / 256)),
    # ISO 22028-2, "Reference output medium metric RGB colour image encoding (ROMM RGB)", 2013.
    "prophoto": space_of_chromaticities(
        "ProPhoto RGB", _ROMM, Curve("parametric", (1.8, 1.0, 0.0, 1 / 16, 1 / 32, 0.0, 0.0))
    ),
    "rec2020": space_of_chromaticities(
        "Rec. 2020",
        _REC2020,
        Curve("parametric", (1 / 0.45, 1 / _ALPHA, 1 - 1 / _ALPHA, 1 / 4.5, 4.5 * _BETA, 0.0, 0.0)),
    ),
}

# ITU-T H.273, "Coding-independent code points", 2021, tables 2 and 3. Transfer functions of television
# pictures (1, 6, 14, 15) are displayed as sRGB in still pictures, and are read as such.
_PRIMARIES = {1: REC709, 2: REC709, 9: _REC2020, 12: _P3}
_TRANSFERS = {1: SRGB_CURVE, 2: SRGB_CURVE, 4: power(2.2), 5: power(2.8), 6: SRGB_CURVE, 8: LINEAR}
_TRANSFERS |= {13: SRGB_CURVE, 14: SRGB_CURVE, 15: SRGB_CURVE, 16: PQ, 18: HLG}
_PRIMARY_NAMES = {1: "Rec. 709", 2: "Rec. 709", 9: "Rec. 2020", 12: "P3"}
_TRANSFER_NAMES = {4: "gamma 2.2", 5: "gamma 2.8", 8: "linear", 16: "PQ", 18: "HLG"}


@cache
def cicp_space(primaries: int, transfer: int) -> ColorSpace | None:
    """Return the colour space of code points; None if they are unsupported.

    Source: ITU-T H.273, "Coding-independent code points for video signal type identification", 2021.
    """
    if primaries not in _PRIMARIES or transfer not in _TRANSFERS:
        return None
    name = f"{_PRIMARY_NAMES[primaries]} {_TRANSFER_NAMES.get(transfer, 'sRGB')}"
    chromaticities, curve = _PRIMARIES[primaries], _TRANSFERS[transfer]
    if (chromaticities, curve) == (REC709, SRGB_CURVE):
        return SRGB
    cicp = (primaries, transfer, 0, 1)
    return space_of_chromaticities(name, chromaticities, curve, cicp=cicp)


@cache
def _between(
    source: tuple[tuple[float, ...], ...], target: tuple[tuple[float, ...], ...]
) -> tuple[tuple[float, ...], ...]:
    """Return the matrix between the linear values of two spaces, by rows."""
    return tuple(map(tuple, np.linalg.solve(np.asarray(target), np.asarray(source)).tolist()))
