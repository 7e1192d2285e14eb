"""Veiling glare: light that the lens scatters."""

from dataclasses import dataclass

import numpy as np

from bokehnet.checks import check_range
from bokehnet.effects.convolution import convolve
from bokehnet.optics.spectral.scattering import scatter_kernel

__all__ = ["Glare"]


@dataclass(frozen=True, kw_only=True, slots=True)
class Glare:
    """Scattered light; the rest of the light is unchanged.

    Attributes:
        share: Fraction of all light, 0 to 0.5.
        core: Radius within which a lamp's veil is flat, percent of the half-diagonal, 0.01 to 20.
        slope: Exponent of its falloff farther out, 1 to 4.

    Raises:
        ParameterError: A number is out of range.
    """

    share: float
    core: float = 0.2
    slope: float = 2.0

    def __post_init__(self) -> None:
        for name, low, high in (("share", 0, 0.5), ("core", 0.01, 20), ("slope", 1, 4)):
            check_range(name, getattr(self, name), low, high)

    def apply(self, image: np.ndarray, half_diagonal: float) -> np.ndarray:
        """Return the picture with veiling glare; light that is scattered beyond the border is lost.

        Args:
            image: Scene-linear picture, (H, W, 3).
            half_diagonal: Half-diagonal of the shown picture, pixels.
        """
        veil = convolve(image, scatter_kernel(half_diagonal, self.core / 100, self.slope))
        return np.asarray((1 - self.share) * image + self.share * veil, image.dtype)
