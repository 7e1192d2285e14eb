"""Which wavelengths stand for the light of a picture, and what each carries of red, green and blue."""

from dataclasses import dataclass

import numpy as np

from bokehnet.checks import check_at_least, check_choice, check_kind
from bokehnet.errors import ParameterError
from bokehnet.optics.sampling import halton
from bokehnet.optics.spectral.spectrum import MAX_WAVELENGTH, MIN_WAVELENGTH, wavelength_color

__all__ = ["DISPERSIONS", "WavelengthSampling"]

DISPERSIONS = ("continuous", "rgb")

# The fewest wavelengths of a draw, and bands of an equaliser.
_FEWEST, _MOST_BANDS = 8, 64

# Cells of the spectrum in which integrals are summed up.
_CELLS = 3000

# Share of a channel's light that an equaliser must leave.
_LEAST_LIGHT = 1e-3

_CHANNELS = ("red", "green", "blue")


@dataclass(frozen=True, kw_only=True, slots=True)
class WavelengthSampling:
    """Wavelengths, drawn where they count, with the colours that the eye sees.

    A picture holds three numbers for each pixel, not a spectrum: each wavelength carries the share of red,
    green and blue that its own colour has of them, cut off at 0 where it lies outside the gamut. An
    equaliser weighs wavelengths within each channel, so that it changes the colours of fringes but
    not of what shows none.

    Wavelengths are evenly spread chances through the inverse of the cumulated importance, which is what
    a wavelength gives to red, green and blue together. No weight is much above 3, then.

    Attributes:
        dispersion: "continuous", or "rgb" for three wavelengths alone, the mean one of each channel.
        equaliser: Gains of bands that share the visible spectrum evenly, from violet to red, 0 or more; in
            between, gains are linear from the middle of a band to that of the next. Only their ratios
            matter.

    Raises:
        ParameterError: An unknown dispersion; gains below 0 or not finite, too many of them, or such that
            a channel is left without light.

    Source:
        Jeong, Lee, Kwon and Lee, "Expressive chromatic accumulation buffering for defocus blur", The Visual
        Computer 2016, for points over pupil and spectrum, the equaliser and its importance sampling. That
        channels are normalised each for itself is ours.
    """

    dispersion: str = "continuous"
    equaliser: tuple[float, ...] = (1.0,)

    def __post_init__(self) -> None:
        check_choice("dispersion", self.dispersion, DISPERSIONS)
        check_kind("equaliser", self.equaliser, tuple, list)
        if not 1 <= len(self.equaliser) <= _MOST_BANDS:
            expected = f"1 to {_MOST_BANDS} gains"
            raise ParameterError("equaliser", expected, self.equaliser, shown=str(len(self.equaliser)))
        for gain in self.equaliser:
            check_at_least("equaliser", gain, 0)
        middles = _cells()
        colors = _colors(middles)
        light = (colors * self._gain(middles)[:, None]).sum(0) / colors.sum(0) / (max(self.equaliser) or 1)
        for channel, left in zip(_CHANNELS, light, strict=True):
            if not left >= _LEAST_LIGHT:
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
        """Red, green and blue, (..., 3), that wavelengths (...,) in nm give of white light.

        The mean of each over the visible spectrum is 1.
        """
        middles = _cells()
        mean = (_colors(middles) * self._gain(middles)[:, None]).mean(0)
        return _colors(wavelengths) * self._gain(wavelengths)[..., None] / mean

    def sample(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Wavelengths in nm, (count,), and weights for red, green and blue, (count, 3), of mean 1 each.

        They go with the Halton points of the pupil in the bases 2 and 3: chances are the points in base 5.

        Raises:
            ParameterError: Fewer than 8 are asked for.
        """
        check_at_least("count", count, _FEWEST)
        return self.at(halton(count, 5) + 0.5 / count)  # the points are the lower ends of their cells

    def at(self, chances: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same for given chances, (count,), evenly spread from 0 to 1."""
        if self.dispersion == "rgb":
            channel = (3 * chances).astype(int)
            middles = _cells()
            wavelengths = (self.response(middles) * middles[:, None]).mean(0)[channel]
            weights = np.eye(3)[channel]
        else:
            importance = self.response(_cells()).mean(-1)
            cumulated = np.concatenate([[0], np.cumsum(importance)])
            edges = np.linspace(MIN_WAVELENGTH, MAX_WAVELENGTH, _CELLS + 1)
            wavelengths = np.interp(chances, cumulated / cumulated[-1], edges)
            response = self.response(wavelengths)
            weights = response / np.maximum(response.mean(-1, keepdims=True), 1e-12)
        return wavelengths, weights / weights.mean(axis=0)

    def by_channel(self, chances: np.ndarray) -> np.ndarray:
        """A wavelength of red, of green and of blue for given chances, nm, (count, 3).

        Each channel's are spread as its light is, so that all of them weigh the same; at one chance they lie
        at the same share of their channels.

        Args:
            chances: Evenly spread from 0 to 1, (count,).
        """
        response = self.response(_cells())
        if self.dispersion == "rgb":
            means = (response * _cells()[:, None]).mean(0)
            return np.broadcast_to(means, (len(chances), 3))
        cumulated = np.concatenate([np.zeros((1, 3)), np.cumsum(response, 0)])
        edges = np.linspace(MIN_WAVELENGTH, MAX_WAVELENGTH, _CELLS + 1)
        return np.stack([np.interp(chances, each / each[-1], edges) for each in cumulated.T], -1)


def _cells() -> np.ndarray:
    """Middles of the cells, nm."""
    return MIN_WAVELENGTH + (MAX_WAVELENGTH - MIN_WAVELENGTH) * (np.arange(_CELLS) + 0.5) / _CELLS


def _colors(wavelengths: np.ndarray) -> np.ndarray:
    """Colours within the gamut, (..., 3)."""
    colors: np.ndarray = np.maximum(wavelength_color(wavelengths), 0)
    return colors
