"""Emphasis of bright pixels, as ONNX operators: :func:`bokehnet.optics.tone.gamma_curve`.

A gamma out of range is clipped because a file cannot reject it.
"""

from dataclasses import dataclass

import numpy as np

from bokehnet.onnx_file.builder import END, Graph, Value
from bokehnet.optics import tone

__all__ = ["GammaCurve", "gamma_curve"]


@dataclass(frozen=True, kw_only=True, slots=True)
class GammaCurve:
    """Attributes of :class:`bokehnet.optics.tone.GammaCurve`, float64, shape (1,)."""

    graph: Graph
    gamma: Value
    white: Value
    toe: Value
    shoulder: Value

    def encode(self, light: Value) -> Value:
        """Return the curve's values for scene-linear light from 0 up, float32, any shape."""
        g = self.graph
        u = light.astype(np.float64) / self.white
        value = g.op("Clip", u, *map(g.scalar, (self.toe, self.shoulder))) ** self.gamma
        value = g.where(u < self.toe, self._toe_slope * u, value)
        beyond = value + self._shoulder_slope * (u - self.shoulder)
        return g.where(u > self.shoulder, beyond, value).astype(np.float32)

    def decode(self, values: Value) -> Value:
        """Return the light that :meth:`encode` maps to ``values``."""
        g = self.graph
        precise = values.astype(np.float64)
        low, high = self.toe**self.gamma, self.shoulder**self.gamma
        u = g.op("Clip", precise, g.scalar(low), g.scalar(high)) ** (1 / self.gamma)
        u = g.where(precise < low, precise / g.where(self.toe > 0, self._toe_slope, 1), u)
        u = g.where(precise > high, u + (precise - high) / self._shoulder_slope, u)
        return (u * self.white).astype(np.float32)

    @property
    def _toe_slope(self) -> Value:
        return self.graph.where(self.toe > 0, self.toe ** (self.gamma - 1), 0)

    @property
    def _shoulder_slope(self) -> Value:
        return self.gamma * self.shoulder ** (self.gamma - 1)


def _bright_quantile(g: Graph, brightness: Value) -> Value:
    """Return the value that ``FRACTION_ABOVE_WHITE`` of the pixels exceed, interpolated; shape (1,)."""
    flat = brightness.reshape(-1)
    position = (flat.size(0) - 1).astype(np.float64) * (1 - tone.FRACTION_ABOVE_WHITE)
    below = g.op("Floor", position)
    count = flat.size(0) - below.astype(np.int64)
    brightest, _ = g.sorted(flat, count)
    lower = brightest.cut(0, -1, END).astype(np.float64)
    upper = brightest.take(g.maximum(count - 2, 0)).astype(np.float64)
    return lower + (position - below) * (upper - lower)


def gamma_curve(g: Graph, image: Value, gamma: Value) -> GammaCurve:
    """Return the power law for a picture (3, H, W) and a gamma of shape ()."""
    exponent = g.op(
        "Clip",
        gamma.reshape(1),
        *(g.constant(x, np.float32) for x in (tone.MIN_GAMMA, tone.MAX_GAMMA)),
    )
    exponent = exponent.astype(np.float64)
    brightness = image.max(0)
    largest = brightness.max().astype(np.float64)
    white = g.maximum(_bright_quantile(g, brightness), largest / tone.MAX_RANGE)
    white = g.where(largest > 0, white, 1)
    max_value = g.where(largest > 0, largest / white, 1)
    above = g.where(exponent > 1, exponent - 1, 1)  # any number where no line is needed
    allowed = tone.INVISIBLE_ERROR * g.constant(tone.MAX_TOE, np.float64) ** above / tone.ROUNDING_ERROR
    shoulder = g.where(
        (exponent > 1) & (max_value**exponent > allowed),
        (allowed / (exponent * max_value)) ** (1 / above),
        max_value,
    )
    highest = shoulder**exponent + exponent * shoulder ** (exponent - 1) * (max_value - shoulder)
    toe = g.where(exponent > 1, (highest * tone.ROUNDING_ERROR / tone.INVISIBLE_ERROR) ** (1 / above), 0)
    return GammaCurve(graph=g, gamma=exponent, white=white, toe=toe, shoulder=shoulder)
