"""The response of a lens, as renderers take it: where its rays go, and what light they carry."""

from dataclasses import dataclass, field

import numpy as np

from bokehnet.checks import check_kind
from bokehnet.optics.aberrations.aberration_map import AberrationMap
from bokehnet.optics.aberrations.chromatic_aberration import ChromaticAberration
from bokehnet.optics.spectral.wavelength_sampling import WavelengthSampling

__all__ = ["LensResponse"]


@dataclass(frozen=True, kw_only=True, eq=False, slots=True)
class LensResponse:
    """What a lens does beyond focusing; the default is a perfect lens.

    Attributes:
        aberration_map: Where its rays go.
        chromatic_aberration: Chromatic aberration beyond that of the aberration map.
        wavelength_sampling: Which wavelengths stand for the light, and what each carries of red, green and
            blue.

    Raises:
        ParameterError: One of them is something else.
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
        """Whether a picture through this lens is one through a perfect lens."""
        return self.aberration_map.is_perfect and (
            self.chromatic_aberration is None or self.chromatic_aberration.is_none
        )

    @property
    def is_dispersive(self) -> bool:
        """Whether wavelengths go different ways."""
        return self.aberration_map.is_dispersive or not (
            self.chromatic_aberration is None or self.chromatic_aberration.is_none
        )

    def sample_wavelengths(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Wavelengths (count,) and their red, green, blue (count, 3), of mean 1 each.

        Where the lens does not part wavelengths, all are the design wavelength and white.
        """
        if self.is_dispersive:
            return self.wavelength_sampling.sample(count)
        return self._one_wavelength(count)

    def wavelengths_at(self, chances: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same for given chances, (count,), evenly spread from 0 to 1."""
        if self.is_dispersive:
            return self.wavelength_sampling.at(chances)
        return self._one_wavelength(len(chances))

    def _one_wavelength(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        return np.full(count, float(np.median(self.aberration_map.wavelengths))), np.ones((count, 3))
