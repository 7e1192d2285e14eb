"""Transfer curves between stored values and light, as formulas or as tables of colour profiles."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from bokehnet.io.color.srgb import linear_to_srgb, srgb_to_linear

__all__ = ["HLG", "LINEAR", "PQ", "REFERENCE_WHITE", "SRGB_CURVE", "Curve", "power"]

REFERENCE_WHITE = 203.0
"""Luminance of white in PQ, cd/m^2.

Source: ITU-R BT.2408-7, "Guidance for operational practices in HDR television production", 2023, table 1.
"""

# ITU-R BT.2100-2, "Image parameter values for high dynamic range television", 2018, tables 4 and 5.
_PQ_PEAK = 10000.0
_M1, _M2 = 2610 / 16384, 2523 / 4096 * 128
_C1, _C2, _C3 = 3424 / 4096, 2413 / 4096 * 32, 2392 / 4096 * 32
_A = 0.17883277
_B, _C = 1 - 4 * _A, 0.5 - _A * np.log(4 * _A)
_HLG_WHITE = (np.exp((0.75 - _C) / _A) + _B) / 12  # 75 % is reference white: BT.2408-7, table 1


@dataclass(frozen=True, slots=True)
class Curve:
    """Transfer curve of stored values from 0 to 1; odd for negative values.

    Attributes:
        kind: ``"parametric"`` has seven parameters g, a, b, c, d, e, f: ``(a x + b)^g + e`` for
            ``x >= d``, otherwise ``c x + f``. ``"table"`` interpolates linearly between equidistant samples.
            ``"log"`` has seven parameters k, a, b, c, d, e, f of the stored values of light L:
            ``c log10(a L + b) + d`` for ``L >= k``, otherwise ``e L + f``; it alone has negative light.
            The others are the formulas of their standards.
        values: Seven parameters, or samples.

    Source: ICC.1:2022, "Image technology colour management", 10.18; IEC 61966-2-1; ITU-R BT.2100-2.
    """

    kind: Literal["linear", "srgb", "parametric", "table", "log", "pq", "hlg"]
    values: tuple[float, ...] = ()

    def decode(self, stored: NDArray[Any]) -> NDArray[Any]:
        """Return the light of stored values, of the same shape and type; 1 is white."""
        if self.kind == "linear":
            return stored
        if self.kind == "srgb":
            return np.asarray(srgb_to_linear(stored), stored.dtype)
        if self.kind == "log":
            return np.asarray(self._log(stored.astype(np.float64)), stored.dtype)
        size = np.abs(stored).astype(np.float64)
        light = np.copysign(getattr(self, f"_{self.kind}")(size), stored)
        return np.asarray(light, stored.dtype)

    def encode(self, light: NDArray[Any]) -> NDArray[Any]:
        """Return the stored values of non-negative light; the inverse of :meth:`decode`.

        If several values decode to the same light, as at the ends of tables, black is the smallest of
        them, other light the largest.
        """
        if self.kind == "linear":
            return light
        if self.kind == "srgb":
            return np.asarray(linear_to_srgb(light), light.dtype)
        return np.asarray(getattr(self, f"_{self.kind}_back")(light), light.dtype)

    def _parametric(self, x: NDArray[Any]) -> NDArray[Any]:
        g, a, b, c, d, e, f = self.values
        return np.where(x >= d, np.maximum(a * x + b, 0) ** g + e, c * x + f)

    def _parametric_back(self, light: NDArray[Any]) -> NDArray[Any]:
        g, a, b, c, d, e, f = self.values
        above = (np.maximum(light - np.float32(e), 0) ** np.float32(1 / g) - np.float32(b)) / np.float32(a)
        if d <= 0:
            return np.maximum(above, 0)
        knee = max(a * d + b, 0) ** g + e
        below = (light - np.float32(f)) / np.float32(c) if c > 0 else np.zeros_like(light)
        return np.where(light >= np.float32(knee), above, np.clip(below, 0, d))

    def _table(self, x: NDArray[Any]) -> NDArray[Any]:
        return np.interp(x, np.linspace(0, 1, len(self.values)), self.values)

    def _table_back(self, light: NDArray[Any]) -> NDArray[Any]:
        rising = np.maximum.accumulate(self.values)
        stored = np.interp(light, rising, np.linspace(0, 1, len(rising)))
        return np.where(light <= rising[0], 0, stored)

    def _log(self, x: NDArray[Any]) -> NDArray[Any]:
        k, a, b, c, d, e, f = self.values
        return np.where(x >= e * k + f, (10 ** ((np.minimum(x, 4) - d) / c) - b) / a, (x - f) / e)

    def _log_back(self, light: NDArray[Any]) -> NDArray[Any]:
        k, a, b, c, d, e, f = self.values
        above = c * np.log10(a * np.maximum(light, k).astype(np.float64) + b) + d
        return np.where(light >= k, above, e * light + f)

    def _pq(self, x: NDArray[Any]) -> NDArray[Any]:
        root = np.minimum(x, 1) ** (1 / _M2)
        return (np.maximum(root - _C1, 0) / (_C2 - _C3 * root)) ** (1 / _M1) * (_PQ_PEAK / REFERENCE_WHITE)

    def _pq_back(self, light: NDArray[Any]) -> NDArray[Any]:
        y = np.clip(np.asarray(light, np.float64) * (REFERENCE_WHITE / _PQ_PEAK), 0, 1) ** _M1
        return ((_C1 + _C2 * y) / (1 + _C3 * y)) ** _M2

    def _hlg(self, x: NDArray[Any]) -> NDArray[Any]:
        x = np.minimum(x, 1)
        return np.where(x <= 0.5, x**2 / 3, (np.exp((x - _C) / _A) + _B) / 12) / _HLG_WHITE

    def _hlg_back(self, light: NDArray[Any]) -> NDArray[Any]:
        scene = np.clip(np.asarray(light, np.float64) * _HLG_WHITE, 0, 1)
        return np.where(scene <= 1 / 12, np.sqrt(3 * scene), _A * np.log(np.maximum(12 * scene, 1) - _B) + _C)


LINEAR, SRGB_CURVE, PQ, HLG = Curve("linear"), Curve("srgb"), Curve("pq"), Curve("hlg")


def power(exponent: float) -> Curve:
    """Return the curve ``light = stored^exponent``."""
    return LINEAR if exponent == 1 else Curve("parametric", (exponent, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0))
