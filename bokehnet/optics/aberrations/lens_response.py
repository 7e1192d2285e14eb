"""Lens response for renderers: ray deviations and spectral weights of a lens."""

from dataclasses import dataclass, field

import numpy as np

from bokehnet.checks import check_kind
from bokehnet.deprecation import earlier_name
from bokehnet.optics.aberrations.aberration_map import AberrationMap
from bokehnet.optics.aberrations.chromatic_aberration import ChromaticAberration
from bokehnet.optics.spectral.wavelength_sampling import WavelengthSampling

__all__ = ["LensResponse"]


@dataclass(frozen=True, kw_only=True, eq=False, slots=True)
class LensResponse:
    """Aberrations and spectral weights of a lens; the default is a perfect lens.

    Attributes:
        aberration_map: Aberrations and vignetting.
        chromatic_aberration: Chromatic aberration in addition to that of the aberration map.
        wavelength_sampling: Sampling of wavelengths and their red, green and blue weights.

    Raises:
        ParameterError: A field has the wrong type.
    """

    aberration_map: AberrationMap = field(default_factory=AberrationMap.perfect)
    chromatic_aberration: ChromaticAberration | None = None
    wavelength_sampling: WavelengthSampling = field(default_factory=WavelengthSampling)

    def __post_init__(self) -> None:
        check_kind("aberration_map", self.aberration_map, AberrationMap)
        check_kind("chromatic_aberration", self.chromatic_aberration, ChromaticAberration, optional=True)
        check_kind("wavelength_sampling", self.wavelength_sampling, WavelengthSampling)

    @property
    def is_ideal(self) -> bool:
        """True if the lens renders like a perfect lens."""
        return self.aberration_map.is_perfect and (
            self.chromatic_aberration is None or self.chromatic_aberration.is_none
        )

    @property
    def is_dispersive(self) -> bool:
        """True if rays depend on the wavelength."""
        return self.aberration_map.is_dispersive or not (
            self.chromatic_aberration is None or self.chromatic_aberration.is_none
        )

    def sample_wavelengths(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Return wavelengths in nm (count,) and their red, green, blue weights (count, 3), of mean 1 each.

        Without dispersion, all are the design wavelength and white.
        """
        if self.is_dispersive:
            return self.wavelength_sampling.sample(count)
        return self._one_wavelength(count)

    def wavelengths_at(self, chances: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return wavelengths and weights as :meth:`sample_wavelengths` does, at ``chances``.

        Args:
            chances: Positions in the cumulative distribution, evenly spread from 0 to 1, (count,).
        """
        if self.is_dispersive:
            return self.wavelength_sampling.at(chances)
        return self._one_wavelength(len(chances))

    def _one_wavelength(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        return np.full(count, float(np.median(self.aberration_map.wavelengths))), np.ones((count, 3))

    is_plain = earlier_name("LensResponse", "is_plain")
