"""Units of depth, with a scale before the unit."""

import re
from dataclasses import dataclass

from bokehnet.errors import ParameterError

__all__ = ["DEPTH_UNITS", "DepthUnit", "parse_depth_unit"]

_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4, "ft": 304.8}
_PER_METRE = "1/m"
DEPTH_UNITS = (*_MM, _PER_METRE)

_NUMBER = r"(\d+\.?\d*(?:e[+-]?\d+)?|\.\d+)"
_UNIT = re.compile(rf"(?:{_NUMBER}(?:/{_NUMBER})?\s*\*?\s*)?({'|'.join(re.escape(u) for u in DEPTH_UNITS)})")


@dataclass(frozen=True, kw_only=True, slots=True)
class DepthUnit:
    """Unit of stored depth.

    Attributes:
        factor: Depth in mm, or disparity in 1/m, of the stored number 1.
        is_disparity: True for metric disparity.
    """

    factor: float
    is_disparity: bool


def parse_depth_unit(text: str) -> DepthUnit:
    """Return the unit of a text: a unit, after an optional number or fraction that scales it.

    Raises:
        ParameterError: The text is no such unit, or the scale is 0.

    Examples:
        >>> parse_depth_unit("mm"), parse_depth_unit("1/256m")
        (DepthUnit(factor=1.0, is_disparity=False), DepthUnit(factor=3.90625, is_disparity=False))
    """
    match = _UNIT.fullmatch(text.strip()) if len(text) < 100 else None
    scale = 0.0
    if match is not None:
        divisor = float(match[2] or 1)
        scale = float(match[1] or 1) / divisor if divisor else 0.0
    if match is None or not 0 < scale < float("inf"):
        expected = f"one of {', '.join(DEPTH_UNITS)}, optionally scaled, such as 0.2mm or 1/256m"
        raise ParameterError("unit", expected, text)
    return DepthUnit(factor=scale * _MM.get(match[3], 1.0), is_disparity=match[3] == _PER_METRE)
