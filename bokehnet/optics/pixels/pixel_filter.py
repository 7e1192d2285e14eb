"""Pixel filters: weights of the light around each pixel of a rendered picture.

A pixel at an edge shows both sides, weighted by its filter. All filters here are separable and have an
integral of 1. A name and a width, in the convention of its renderer, identify a filter:

- ``box``: constant over ``width`` pixels; 1 is the pixel itself.
- ``blackman-harris``: the four-term window over twice ``width``; Blender and Cycles, 1.5 by default.
- ``gaussian``: ``exp(-2 (2 x / width)^2)``, cut off at half of ``width``; Arnold and RenderMan, 2 by default.
- ``mitchell``: the cubic with B = C = 1/3 over ``width``, which is 4 as published; its outer parts are
  negative.

Source: Harris, "On the use of windows for harmonic analysis with the discrete Fourier transform", 1978.
Cycles, ``scene/film.cpp`` (``filter_table``: the window is twice as wide as the setting), and Blender's
manual, "Film", for 1.5 pixels. Pixar, "The RenderMan Interface", version 3.2, ``RiGaussianFilter``, and the
RenderMan documentation, "Filtering", for 2x2 pixels. Arnold's SDK, filter nodes, for the same Gaussian, and
its user guide, "Filter", for a width of 2. Mitchell and Netravali, "Reconstruction filters in computer
graphics", SIGGRAPH 1988.
"""

import math
import re
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from bokehnet.errors import ParameterError

__all__ = ["DEFAULT_FILTER", "FILTER_NAMES", "FilterChoice", "PixelFilter", "parse_pixel_filter"]

# Default width of each filter, pixels, and its extent to one side for a width of 1.
_WIDTHS = {"box": 1.0, "blackman-harris": 1.5, "gaussian": 2.0, "mitchell": 4.0}
_EXTENT = {"box": 0.5, "blackman-harris": 1.0, "gaussian": 0.5, "mitchell": 0.5}

# Default filters of renderers.
_RENDERERS = {
    "arnold": "gaussian",
    "blender": "blackman-harris",
    "cycles": "blackman-harris",
    "renderman": "gaussian",
}

FILTER_NAMES = (*_WIDTHS, *_RENDERERS)

# Upper bound of the extent, pixels: five weights describe such a filter completely.
_MAX_EXTENT = 2.5

# Outer weights below this are dropped; they are below the precision of edge positions.
_MIN_WEIGHT = 0.01

_PATTERN = re.compile(r"([a-z-]+)(?::(\d+(?:\.\d+)?))?")

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class PixelFilter:
    """Separable pixel filter, identified by name and width.

    Attributes:
        name: ``box``, ``blackman-harris``, ``gaussian`` or ``mitchell``.
        width: Width in the convention of its renderer, pixels.

    Raises:
        ParameterError: Unknown name, or a width that is not above 0 or extends beyond five pixels.

    Examples:
        >>> str(PixelFilter("gaussian", 2)), PixelFilter("box", 1).weights()
        ('gaussian:2', array([0., 1., 0.]))
    """

    name: str
    width: float

    def __post_init__(self) -> None:
        if self.name not in _WIDTHS:
            raise ParameterError("pixel_filter", expected=f"one of {', '.join(_WIDTHS)}", got=self.name)
        if not 0 < self.extent <= _MAX_EXTENT:
            largest = _MAX_EXTENT / _EXTENT[self.name]
            expected = f"a width above 0 and up to {largest:g} pixels for {self.name}"
            raise ParameterError("pixel_filter", expected=expected, got=self.width)

    def __str__(self) -> str:
        return f"{self.name}:{self.width:.3g}"

    @property
    def extent(self) -> float:
        """Distance from the centre of the pixel to the end of the filter, pixels."""
        return _EXTENT[self.name] * self.width

    def cumulative(self, x: npt.ArrayLike) -> Array:
        """Return the integral up to ``x`` pixels right of the pixel centre, of the shape of ``x``.

        It is the coverage of a pixel by an edge at ``x``: 0 if the edge lies left of the filter, 1 if right
        of it.
        """
        t = np.clip(np.asarray(x, np.float64) / self.extent, -1.0, 1.0)
        half: Array = _HALF_INTEGRALS[self.name](np.abs(t)) / _HALF_INTEGRALS[self.name](np.ones(1))[0]
        return 0.5 + 0.5 * np.sign(t) * half

    def fine_weights(self, factor: int) -> Array:
        """Return the weights of finer pixels, (n,), centred on a pixel; the sum is 1.

        Finer pixels are themselves means. Therefore point values at their centres reproduce the edges of the
        filter, while integrals over them would widen edges. A filter narrower than two finer pixels is
        widened to two.

        Args:
            factor: Number of fine pixels along the side of a pixel.

        Examples:
            >>> PixelFilter("box", 1).fine_weights(2), PixelFilter("box", 1.5).fine_weights(2).round(3)
            (array([0.5, 0.5]), array([0.167, 0.333, 0.333, 0.167]))
        """
        beyond = max(0, math.floor((self.extent - 0.5) * factor + 0.5 + 1e-9))
        middles = (np.arange(-beyond, factor + beyond) + 0.5) / factor - 0.5
        values = _SHAPES[self.name](np.abs(middles) / max(self.extent, 1 / factor))
        weights: Array = values / values.sum()
        return weights

    def weights(self) -> Array:
        """Return the integrals over a pixel and its neighbours, (3,) or (5,); the sum is 1.

        There are five weights if the outermost are at least 0.01.
        """
        integrals = np.diff(self.cumulative(np.arange(-_MAX_EXTENT, _MAX_EXTENT + 1)))
        if abs(integrals[0]) < _MIN_WEIGHT:
            integrals = integrals[1:-1]
        weights: Array = integrals / integrals.sum()
        return weights


# Mean of the Blackman-Harris window, and weight and order of its cosine terms.
_MEAN, _TERMS = 0.35875, ((0.48829, 1), (0.14128, 2), (0.01168, 3))


def _window(t: Array) -> Array:
    """Return the Blackman-Harris window, which ends at t = 1."""
    total = np.full_like(t, _MEAN)
    for weight, k in _TERMS:
        total += weight * np.cos(np.pi * k * t)
    return total


def _half_window(t: Array) -> Array:
    """Return the integral of the Blackman-Harris window from 0 to t."""
    total = _MEAN * t
    for weight, k in _TERMS:
        total = total + weight * np.sin(np.pi * k * t) / (np.pi * k)
    return total


def _half_gaussian(t: Array) -> Array:
    """Return the integral of exp(-2 t^2) from 0 to t, up to a constant factor."""
    flat = [math.erf(math.sqrt(2.0) * value) for value in t.ravel()]
    return np.array(flat, np.float64).reshape(t.shape)


def _cubic(t: Array) -> Array:
    """Return Mitchell's cubic, which ends at t = 1."""
    x = 2.0 * t
    return np.where(x < 1, (7 * x - 12) * x**2 + 16 / 3, ((-7 / 3 * x + 12) * x - 20) * x + 32 / 3)


def _half_cubic(t: Array) -> Array:
    """Return the integral of Mitchell's cubic from 0 to 2 t, which ends at 2."""
    x = 2.0 * t
    inner, outer = np.minimum(x, 1.0), np.maximum(x, 1.0)

    def outside(v: Array) -> Array:
        return ((-7 / 12 * v + 4) * v - 10) * v**2 + 32 / 3 * v

    return (7 / 4 * inner**4 - 4 * inner**3 + 16 / 3 * inner + outside(outer) - outside(np.ones(1))) / 6


_HALF_INTEGRALS = {
    "box": lambda t: t,
    "blackman-harris": _half_window,
    "gaussian": _half_gaussian,
    "mitchell": _half_cubic,
}

# Filters up to a constant factor, as functions of the distance over the extent, 0 to 1.
_SHAPES = {
    "box": lambda t: np.where(t < 1 - 1e-9, 1.0, 0.5),
    "blackman-harris": _window,
    "gaussian": lambda t: np.exp(-2 * t * t),
    "mitchell": _cubic,
}

# Filter of pictures whose filter is unknown.
DEFAULT_FILTER = PixelFilter("blackman-harris", 1.5)


@dataclass(frozen=True, kw_only=True, slots=True)
class FilterChoice:
    """Pixel filter of a picture, and the origin of this information.

    Attributes:
        pixel_filter: The filter.
        reason: Origin of the information, in a few words.
        confidence: Confidence of an estimate, 0 to 1; None if the filter was specified.

    Examples:
        >>> str(FilterChoice(pixel_filter=DEFAULT_FILTER, reason="by default"))
        'blackman-harris:1.5 (by default)'
    """

    pixel_filter: PixelFilter
    reason: str
    confidence: float | None = None

    @property
    def specified_or_default(self) -> PixelFilter:
        """The filter if it was specified, else the default: an estimate is valid for one pixel size only."""
        return self.pixel_filter if self.confidence is None else DEFAULT_FILTER

    def __str__(self) -> str:
        return f"{self.pixel_filter} ({self.reason})"


@lru_cache(maxsize=64)
def parse_pixel_filter(text: str) -> PixelFilter:
    """Return the filter for a name of a filter or a renderer, optionally with a width.

    Args:
        text: For example ``gaussian``, ``renderman`` or ``gaussian:1.6``.

    Raises:
        ParameterError: Unknown name, or width out of range.

    Examples:
        >>> parse_pixel_filter("cycles")
        PixelFilter(name='blackman-harris', width=1.5)
    """
    match = _PATTERN.fullmatch(text)
    name = match[1] if match else ""
    name = _RENDERERS.get(name, name)
    if match is None or name not in _WIDTHS:
        expected = f"one of {', '.join(FILTER_NAMES)}, with a width in pixels as in gaussian:2 if need be"
        raise ParameterError("pixel_filter", expected=expected, got=text)
    return PixelFilter(name, float(match[2]) if match[2] else _WIDTHS[name])
