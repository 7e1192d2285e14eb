"""Pixel filters: how a picture weighs the light around each of its pixels.

A pixel at an edge shows both sides; its filter says how much of each. Filters are separable here and have an
integral of 1. Each is told by a name and by its width as its renderer counts it:

- ``box``: even over ``width`` pixels; 1 is the pixel itself.
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

# Names, the default width of each, and half its extent for a width of 1.
_WIDTHS = {"box": 1.0, "blackman-harris": 1.5, "gaussian": 2.0, "mitchell": 4.0}
_EXTENT = {"box": 0.5, "blackman-harris": 1.0, "gaussian": 0.5, "mitchell": 0.5}

# Filters that renderers use unless they are told otherwise.
_RENDERERS = {
    "arnold": "gaussian",
    "blender": "blackman-harris",
    "cycles": "blackman-harris",
    "renderman": "gaussian",
}

FILTER_NAMES = (*_WIDTHS, *_RENDERERS)

# Farthest that a filter reaches, pixels: weights over five of them tell it all.
_FARTHEST = 2.5

# Weights smaller than this tell no more than the place of an edge is known.
_LEAST_WEIGHT = 0.01

_TOLD = re.compile(r"([a-z-]+)(?::(\d+(?:\.\d+)?))?")

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class PixelFilter:
    """A filter by name and width.

    Attributes:
        name: ``box``, ``blackman-harris``, ``gaussian`` or ``mitchell``.
        width: Pixels, as its renderer counts them.

    Raises:
        ParameterError: Another name, or a width that is not above 0 or reaches beyond five pixels.

    Examples:
        >>> str(PixelFilter("gaussian", 2)), PixelFilter("box", 1).weights()
        ('gaussian:2', array([0., 1., 0.]))
    """

    name: str
    width: float

    def __post_init__(self) -> None:
        if self.name not in _WIDTHS:
            raise ParameterError("pixel_filter", expected=f"one of {', '.join(_WIDTHS)}", got=self.name)
        if not 0 < self.extent <= _FARTHEST:
            largest = _FARTHEST / _EXTENT[self.name]
            expected = f"a width above 0 and up to {largest:g} pixels for {self.name}"
            raise ParameterError("pixel_filter", expected=expected, got=self.width)

    def __str__(self) -> str:
        return f"{self.name}:{self.width:.3g}"

    @property
    def extent(self) -> float:
        """Farthest that it reaches from the middle of its pixel, pixels."""
        return _EXTENT[self.name] * self.width

    def cumulative(self, x: npt.ArrayLike) -> Array:
        """Its integral up to ``x`` pixels right of the middle of its pixel, of the shape of ``x``.

        It is what the pixel shows of an edge there: 0 or less where all is beyond, 1 where nothing is.
        """
        t = np.clip(np.asarray(x, np.float64) / self.extent, -1.0, 1.0)
        half: Array = _HALVES[self.name](np.abs(t)) / _HALVES[self.name](np.ones(1))[0]
        return 0.5 + 0.5 * np.sign(t) * half

    def fine_weights(self, factor: int) -> Array:
        """What it weighs at the middles of finer pixels, (n,), centred on a pixel; the sum is 1.

        Finer pixels are means themselves. So these draw edges as the filter does where integrals over them
        would draw them wider. A filter that is narrower than two finer pixels is taken to be that wide.

        Args:
            factor: Fine pixels along the side of a pixel.

        Examples:
            >>> PixelFilter("box", 1).fine_weights(2), PixelFilter("box", 1.5).fine_weights(2).round(3)
            (array([0.5, 0.5]), array([0.167, 0.333, 0.333, 0.167]))
        """
        beyond = max(0, math.floor((self.extent - 0.5) * factor + 0.5 + 1e-9))
        middles = (np.arange(-beyond, factor + beyond) + 0.5) / factor - 0.5
        found = _SHAPES[self.name](np.abs(middles) / max(self.extent, 1 / factor))
        weights: Array = found / found.sum()
        return weights

    def weights(self) -> Array:
        """Integrals over the pixel in the middle and its neighbours; their sum is 1.

        They are three, or five where the outermost are 0.01 or more.
        """
        found = np.diff(self.cumulative(np.arange(-_FARTHEST, _FARTHEST + 1)))
        if abs(found[0]) < _LEAST_WEIGHT:
            found = found[1:-1]
        weights: Array = found / found.sum()
        return weights


# The mean of the Blackman-Harris window and its terms.
_MEAN, _TERMS = 0.35875, ((0.48829, 1), (0.14128, 2), (0.01168, 3))


def _window(t: Array) -> Array:
    """The Blackman-Harris window, its end at 1."""
    total = np.full_like(t, _MEAN)
    for weight, k in _TERMS:
        total += weight * np.cos(np.pi * k * t)
    return total


def _half_window(t: Array) -> Array:
    """Its integral from 0 to t."""
    total = _MEAN * t
    for weight, k in _TERMS:
        total = total + weight * np.sin(np.pi * k * t) / (np.pi * k)
    return total


def _half_gaussian(t: Array) -> Array:
    """Integral of exp(-2 t^2) from 0 to t but for its factor."""
    flat = [math.erf(math.sqrt(2.0) * value) for value in t.ravel()]
    return np.array(flat, np.float64).reshape(t.shape)


def _cubic(t: Array) -> Array:
    """Mitchell's cubic, its end at 1."""
    x = 2.0 * t
    return np.where(x < 1, (7 * x - 12) * x**2 + 16 / 3, ((-7 / 3 * x + 12) * x - 20) * x + 32 / 3)


def _half_cubic(t: Array) -> Array:
    """Integral of Mitchell's cubic from 0 to 2 t, its end at 2."""
    x = 2.0 * t
    inner, outer = np.minimum(x, 1.0), np.maximum(x, 1.0)

    def outside(v: Array) -> Array:
        return ((-7 / 12 * v + 4) * v - 10) * v**2 + 32 / 3 * v

    return (7 / 4 * inner**4 - 4 * inner**3 + 16 / 3 * inner + outside(outer) - outside(np.ones(1))) / 6


_HALVES = {
    "box": lambda t: t,
    "blackman-harris": _half_window,
    "gaussian": _half_gaussian,
    "mitchell": _half_cubic,
}

# The filters themselves but for a factor, by the distance as a share of their extent, in arrays that go no
# farther than 1.
_SHAPES = {
    "box": lambda t: np.where(t < 1 - 1e-9, 1.0, 0.5),
    "blackman-harris": _window,
    "gaussian": lambda t: np.exp(-2 * t * t),
    "mitchell": _cubic,
}

# Where nothing tells another one.
DEFAULT_FILTER = PixelFilter("blackman-harris", 1.5)


@dataclass(frozen=True, kw_only=True, slots=True)
class FilterChoice:
    """A picture's filter, and how it is known.

    Attributes:
        pixel_filter: The filter.
        reason: Who told it, in a few words.
        confidence: Of an estimate, 0 to 1; None where it was told.

    Examples:
        >>> str(FilterChoice(pixel_filter=DEFAULT_FILTER, reason="by default"))
        'blackman-harris:1.5 (by default)'
    """

    pixel_filter: PixelFilter
    reason: str
    confidence: float | None = None

    @property
    def specified_or_default(self) -> PixelFilter:
        """The filter where it was told, else the default: an estimate holds for no other size of pixels."""
        return self.pixel_filter if self.confidence is None else DEFAULT_FILTER

    def __str__(self) -> str:
        return f"{self.pixel_filter} ({self.reason})"


@lru_cache(maxsize=64)
def parse_pixel_filter(text: str) -> PixelFilter:
    """Return the filter that a text names: a filter or a renderer, and if need be its width.

    Args:
        text: Such as ``gaussian``, ``renderman`` or ``gaussian:1.6``.

    Raises:
        ParameterError: It names none, or its width is out of range.

    Examples:
        >>> parse_pixel_filter("cycles")
        PixelFilter(name='blackman-harris', width=1.5)
    """
    found = _TOLD.fullmatch(text)
    name = found[1] if found else ""
    name = _RENDERERS.get(name, name)
    if found is None or name not in _WIDTHS:
        expected = f"one of {', '.join(FILTER_NAMES)}, with a width in pixels as in gaussian:2 if need be"
        raise ParameterError("pixel_filter", expected=expected, got=text)
    return PixelFilter(name, float(found[2]) if found[2] else _WIDTHS[name])
