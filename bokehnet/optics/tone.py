"""Tone curves that weigh light before blurring: a power law, and an expansion of clipped highlights.

Blurring is a mean of light. The mean of scene-linear values is that of a lens; the mean of
``light ** gamma``, inverted afterwards, favours bright pixels (``gamma`` above 1). Expanded highlights
approximate the light that an 8-bit file has clipped. Both curves are monotone and invertible, and apply to
whole pictures.
"""

from dataclasses import dataclass

import numpy as np

from bokehnet.checks import Array, Values, array_namespace, check_at_least, check_number, number_of
from bokehnet.errors import ParameterError

__all__ = ["GammaCurve", "Highlights", "gamma_curve"]

MIN_GAMMA, MAX_GAMMA = 0.2, 5.0

# Fraction of pixels of a picture that are brighter than white, and the upper bound of brightest over white.
FRACTION_ABOVE_WHITE = 0.01
MAX_RANGE = 1e6

# Rounding error of float64 sums over a row, relative to its brightest value.
ROUNDING_ERROR = 2.0**-52

# Half a step of 8-bit sRGB at black, relative to white: smaller errors are invisible.
INVISIBLE_ERROR = 0.5 / 255 / 12.92

# Upper bound of the toe, relative to white: darker light may be averaged without the power.
MAX_TOE = 0.01


@dataclass(frozen=True, kw_only=True, slots=True)
class Highlights:
    """Expansion of clipped highlights: light above a threshold is expanded smoothly.

    The brightest channel m of a pixel becomes ``m + (gain - 1) s^2`` with ``s = (m - threshold) / (1 -
    threshold)``, and above 1 follows the tangent at 1; the other channels are scaled by the same factor, so
    that colours keep their hue. The curve and its slope are continuous; pixels not above the threshold are
    bit-identical, and 1 becomes ``gain``.

    Attributes:
        threshold: Scene-linear light above which pixels are expanded, 0 up to below 1.
        gain: Value that white becomes, at least 1.

    Raises:
        ParameterError: A number is out of range.
    """

    threshold: float = 0.9
    gain: float = 8.0

    def __post_init__(self) -> None:
        if not 0 <= number_of(self.threshold) < 1:
            raise ParameterError("threshold", "at least 0 and below 1", self.threshold)
        check_at_least("gain", self.gain, 1)

    def expand(self, image: Values) -> Values:
        """Return ``image`` (..., 3), scene-linear, NumPy array or tensor, with expanded highlights."""
        xp = array_namespace(image)
        width, rise = 1 - self.threshold, self.gain - 1
        brightest = _brightest(image)
        s = xp.clip((brightest - self.threshold) / width, 0, 1)
        beyond = (1 + 2 * rise / width) * (brightest - 1)
        expanded = xp.where(brightest > 1, self.gain + beyond, brightest + rise * s * s)
        result: Values = _scale(image, brightest, expanded, brightest > self.threshold)
        return result

    def compress(self, image: Values) -> Values:
        """Invert :meth:`expand`: return a rendered picture (..., 3) in the range of its photograph."""
        xp = array_namespace(image)
        width, rise = 1 - self.threshold, self.gain - 1
        brightest = _brightest(image)
        # The root of rise s^2 + width s = light above the threshold, in the form without a division by 0.
        above = xp.clip(brightest - self.threshold, 0, self.gain - self.threshold)
        s = 2 * above / (width + (width * width + 4 * rise * above) ** 0.5)
        beyond = (brightest - self.gain) / (1 + 2 * rise / width)
        compressed = xp.where(brightest > self.gain, 1 + beyond, self.threshold + width * s)
        result: Values = _scale(image, brightest, compressed, brightest > self.threshold)
        return result


def _brightest(image: Array) -> Array:
    xp = array_namespace(image)
    return xp.maximum(xp.maximum(image[..., 0:1], image[..., 1:2]), image[..., 2:3])


def _scale(image: Array, brightest: Array, target: Array, mask: Array) -> Array:
    """Multiply ``image`` inside ``mask`` so that its brightest channel becomes ``target``."""
    xp = array_namespace(image)
    factor = target / xp.where(mask, brightest, xp.ones_like(brightest))
    return xp.where(mask, image * factor, image)


@dataclass(frozen=True, kw_only=True, slots=True)
class GammaCurve:
    """Power law between two straight lines; :func:`gamma_curve` makes the one of a picture.

    With u = light / white, :meth:`encode` gives ``u ** gamma`` from ``toe`` to ``shoulder``, a line through 0
    below, and the tangent at the shoulder above. :meth:`decode` is its inverse.

    Attributes:
        gamma: Exponent.
        white: Scene-linear light that becomes 1.
        toe: Upper end of the line through 0, relative to white.
        shoulder: Lower end of the tangent, relative to white.
    """

    gamma: float
    white: float
    toe: float
    shoulder: float

    def encode(self, light: np.ndarray) -> np.ndarray:
        """Return the encoded values of scene-linear light >= 0, any shape."""
        u = light / self.white
        value = np.clip(u, self.toe, self.shoulder) ** self.gamma
        value = np.where(u < self.toe, self._toe_slope * u, value)
        return np.where(u > self.shoulder, value + self._shoulder_slope * (u - self.shoulder), value)

    def decode(self, values: np.ndarray) -> np.ndarray:
        """Return the light, at least 0, that :meth:`encode` maps to ``values``; clips values below 0."""
        low, high = self.toe**self.gamma, self.shoulder**self.gamma
        u = np.clip(values, low, high) ** (1 / self.gamma)
        if self.toe > 0:
            u = np.where(values < low, np.maximum(values, 0) / self._toe_slope, u)
        u = np.where(values > high, u + (values - high) / self._shoulder_slope, u)
        return u * self.white

    @property
    def _toe_slope(self) -> float:
        return self.toe ** (self.gamma - 1) if self.toe > 0 else 0.0

    @property
    def _shoulder_slope(self) -> float:
        return self.gamma * self.shoulder ** (self.gamma - 1)


def gamma_curve(image: np.ndarray, gamma: float) -> GammaCurve:
    """Return the power law for rendering ``image``, protected from underflow, overflow and rounding.

    White w is the 99th percentile of the brightest channels, so that the curve follows a change of
    exposure; M is the brightest value over w, at most 1e6. With a gamma g above 1 a pure power would fail
    at both ends. Sums over a row that contains the value F = f(M) are rounded by e F, e = 2^-52, and
    the inverse of the power turns this, next to a bright light, into a visible ``w (e F)^(1/g)``; far below,
    f underflows and leaves black holes. On a line of slope t^(g-1) the same rounding is ``w e F /
    t^(g-1)``, and nothing underflows. So the toe is the smallest t that keeps this at D w, half a
    step of 8-bit sRGB at black: ``t = (e F / D)^(1/(g-1))``. For t to stay below T = 1 % of white, F is
    limited to ``D T^(g-1) / e``: where M^g exceeds that, the tangent replaces the power above the shoulder k.
    Since f(M) = k^g + g k^(g-1) (M - k) <= g k^(g-1) M, ``k = (F / (g M))^(1/(g-1))`` is sufficient. Nothing
    is
    clipped: beyond the shoulder light is averaged linearly. A gamma below 1 shrinks errors of dark
    values and needs neither line.

    Pictures without extremes keep the pure power: for M = 1 the toe lies at 1e-10 of white with gamma 2.2
    and at 0.1 % with 5; lights keep it up to M = 2e4 with gamma 2.2, up to 400 with 3, up to 6 with 5.

    Args:
        image: Scene-linear, (H, W, 3), values >= 0.
        gamma: Exponent, 0.2 to 5. The gamma of BokehMe applies to encoded values, where 2.2 is nearly linear
            light: its values are 2.2 times these.

    Raises:
        ParameterError: ``gamma`` is out of range.

    Source:
        Peng et al., "BokehMe: When neural rendering meets classical rendering", CVPR 2022, for the power
        law; the two lines are our own.
    """
    check_number("gamma", gamma)
    if not MIN_GAMMA <= gamma <= MAX_GAMMA:
        expected = f"{MIN_GAMMA:g} to {MAX_GAMMA:g}, 1 being a real lens"
        raise ParameterError("gamma", expected, gamma)
    brightness = image.max(axis=-1)
    largest = float(brightness.max())
    if largest <= 0:
        return GammaCurve(gamma=gamma, white=1.0, toe=0.0, shoulder=1.0)
    white = max(float(np.quantile(brightness, 1 - FRACTION_ABOVE_WHITE)), largest / MAX_RANGE)
    shoulder = brightest = largest / white
    if gamma <= 1:
        return GammaCurve(gamma=gamma, white=white, toe=0.0, shoulder=shoulder)
    max_value = INVISIBLE_ERROR * MAX_TOE ** (gamma - 1) / ROUNDING_ERROR
    if brightest**gamma > max_value:
        shoulder = (max_value / (gamma * brightest)) ** (1 / (gamma - 1))
    highest = shoulder**gamma + gamma * shoulder ** (gamma - 1) * (brightest - shoulder)
    toe = (ROUNDING_ERROR * highest / INVISIBLE_ERROR) ** (1 / (gamma - 1))
    return GammaCurve(gamma=gamma, white=white, toe=toe, shoulder=shoulder)
