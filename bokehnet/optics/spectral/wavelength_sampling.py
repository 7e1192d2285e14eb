"""Sampling of wavelengths, with red, green and blue weights for each."""

from dataclasses import dataclass

import numpy as np

from bokehnet.checks import check_at_least, check_choice, check_kind
from bokehnet.errors import ParameterError
from bokehnet.optics.sampling import halton
from bokehnet.optics.spectral.spectrum import MAX_WAVELENGTH, MIN_WAVELENGTH, wavelength_color

__all__ = ["DISPERSIONS", "WavelengthSampling"]

DISPERSIONS = ("continuous", "rgb")

# Minimum number of sampled wavelengths, and maximum number of equaliser bands.
_MIN_COUNT, _MAX_BANDS = 8, 64

# Number of cells for integrals over the spectrum.
_CELLS = 3000

# Largest gain of an equaliser, and inverse of the least one of the brightest band: only ratios matter.
_MAX_GAIN = 1e6

# Minimum fraction of the light of a channel that an equaliser must preserve.
_MIN_LIGHT = 1e-3

_CHANNELS = ("red", "green", "blue")


@dataclass(frozen=True, kw_only=True, slots=True)
class WavelengthSampling:
    """Importance sampling of wavelengths, weighted by their colours.

    A picture stores three numbers per pixel, not a spectrum: each wavelength carries the fractions of red,
    green and blue that its own colour has, clipped at 0 outside the gamut. An
    equaliser weighs wavelengths within each channel, so that it changes the colours of fringes but
    not of areas without fringes.

    Evenly spread chances are mapped to wavelengths by the inverse of the cumulative importance, the sum of
    the contributions of a wavelength to red, green and blue. This keeps all weights below about 3.

    Attributes:
        dispersion: "continuous", or "rgb" for three wavelengths only, the mean of each channel.
        equaliser: Gains of equally wide bands of the visible spectrum, from violet to red, 0 or more;
            interpolated linearly between the centres of the bands. Only their ratios
            matter.

    Raises:
        ParameterError: Unknown dispersion; gains below 0 or not finite, too many of them, or gains
            that leave a channel without light.

    Source:
        Jeong, Lee, Kwon and Lee, "Expressive chromatic accumulation buffering for defocus blur", The Visual
        Computer 2016, for points over pupil and spectrum, the equaliser and its importance sampling. The
        normalization of each channel is our own.
    """

    dispersion: str = "continuous"
    equaliser: tuple[float, ...] = (1.0,)

    def __post_init__(self) -> None:
        check_choice("dispersion", self.dispersion, DISPERSIONS)
        check_kind("equaliser", self.equaliser, tuple, list)
        if not 1 <= len(self.equaliser) <= _MAX_BANDS:
            expected = f"1 to {_MAX_BANDS} gains"
            raise ParameterError("equaliser", expected, self.equaliser, shown=str(len(self.equaliser)))
        for gain in self.equaliser:
            check_at_least("equaliser", gain, 0)
            if not gain <= _MAX_GAIN:
                raise ParameterError("equaliser", f"gains of at most {_MAX_GAIN:g}", gain)
        if 0 < max(self.equaliser) < 1 / _MAX_GAIN:
            raise ParameterError("equaliser", f"a gain of at least {1 / _MAX_GAIN:g}", max(self.equaliser))
        middles = _cells()
        colors = _colors(middles)
        light = (colors * self._gain(middles)[:, None]).sum(0) / colors.sum(0) / (max(self.equaliser) or 1)
        for channel, remaining in zip(_CHANNELS, light, strict=True):
            if not remaining >= _MIN_LIGHT:
                raise ParameterError(
                    "equaliser",
                    "gains that leave light to all of red, green and blue",
                    self.equaliser,
                    shown=f"none for {channel}",
                )

    def _gain(self, wavelengths: np.ndarray) -> np.ndarray:
        bands = len(self.equaliser)
        middles = MIN_WAVELENGTH + (MAX_WAVELENGTH - MIN_WAVELENGTH) * (np.arange(bands) + 0.5) / bands
        return np.interp(wavelengths, middles, self.equaliser)

    def response(self, wavelengths: np.ndarray) -> np.ndarray:
        """Return the red, green and blue response, (..., 3), to white light of wavelengths (...,) in nm.

        The mean of each over the visible spectrum is 1.
        """
        middles = _cells()
        mean = (_colors(middles) * self._gain(middles)[:, None]).mean(0)
        return _colors(wavelengths) * self._gain(wavelengths)[..., None] / mean

    def sample(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Return wavelengths in nm, (count,), and red, green and blue weights, (count, 3), of mean 1 each.

        The chances are the Halton points in base 5, to go with points of the pupil in the bases 2 and 3.

        Raises:
            ParameterError: ``count`` is below 8.
        """
        check_at_least("count", count, _MIN_COUNT)
        return self.at(halton(count, 5) + 0.5 / count)  # the points are the lower ends of their cells

    def at(self, chances: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return wavelengths and weights as :meth:`sample` does, at ``chances``.

        Args:
            chances: Positions in the cumulative importance, evenly spread from 0 to 1, (count,).
        """
        if self.dispersion == "rgb":
            channel = (3 * chances).astype(int)
            middles = _cells()
            wavelengths = (self.response(middles) * middles[:, None]).mean(0)[channel]
            weights = np.eye(3)[channel]
        else:
            importance = self.response(_cells()).mean(-1)
            cumulative = np.concatenate([[0], np.cumsum(importance)])
            edges = np.linspace(MIN_WAVELENGTH, MAX_WAVELENGTH, _CELLS + 1)
            wavelengths = np.interp(chances, cumulative / cumulative[-1], edges)
            response = self.response(wavelengths)
            weights = response / np.maximum(response.mean(-1, keepdims=True), 1e-12)
        return wavelengths, weights / weights.mean(axis=0)

    def by_channel(self, chances: np.ndarray) -> np.ndarray:
        """Return a wavelength of red, of green and of blue for each chance, nm, (count, 3).

        The wavelengths of a channel are distributed as its light, so that all have the same weight.

        Args:
            chances: Positions in the cumulative light of each channel, evenly spread from 0 to 1, (count,).
        """
        response = self.response(_cells())
        if self.dispersion == "rgb":
            means = (response * _cells()[:, None]).mean(0)
            return np.broadcast_to(means, (len(chances), 3))
        cumulative = np.concatenate([np.zeros((1, 3)), np.cumsum(response, 0)])
        edges = np.linspace(MIN_WAVELENGTH, MAX_WAVELENGTH, _CELLS + 1)
        return np.stack([np.interp(chances, each / each[-1], edges) for each in cumulative.T], -1)


def _cells() -> np.ndarray:
    """Return the centres of the cells, nm."""
    return MIN_WAVELENGTH + (MAX_WAVELENGTH - MIN_WAVELENGTH) * (np.arange(_CELLS) + 0.5) / _CELLS


def _colors(wavelengths: np.ndarray) -> np.ndarray:
    """Return the colours clipped to the gamut, (..., 3)."""
    colors: np.ndarray = np.maximum(wavelength_color(wavelengths), 0)
    return colors
