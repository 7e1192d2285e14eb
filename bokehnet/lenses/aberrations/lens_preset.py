"""A prescription as a look: a table of its aberrations, a vignette, and how near both are."""

from dataclasses import dataclass

import numpy as np

from bokehnet.lenses.aberrations.aberration_fit import fit_aberration_map
from bokehnet.lenses.aberrations.psf_pairs import psf_pairs
from bokehnet.lenses.aberrations.relative_illumination import relative_illumination
from bokehnet.lenses.prescription import PrescriptionLens
from bokehnet.optics.aberrations.aberration_map import AberrationMap
from bokehnet.optics.vignette import Vignette

__all__ = ["LensPreset", "lens_preset"]

_FIELDS = 41
# Narrower points, in half-diagonals, are less than four pixels of a picture of 1600 x 1200: a sharp image.
_BLURRED = 4e-3
_RADII, _SOFTNESS = np.linspace(0.0, 0.6, 13), np.linspace(0.2, 1.6, 29)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class LensPreset:
    """What stands for a lens.

    Attributes:
        aberrations: Its map.
        vignette: What darkens as the lens does.
        light_error: Largest error of that, of the light in the middle.
        correlation: Of the blur of points with the traced one, in the mean over three fields and depths;
            those that are as good as sharp are left out.
        worst: The smallest of these.
    """

    aberrations: AberrationMap
    vignette: Vignette
    light_error: float
    correlation: float
    worst: float


def lens_preset(lens: PrescriptionLens, rays: int = 12_000) -> LensPreset:
    """Reduce a lens, as it is focused and stopped down, to a look.

    Args:
        lens: The lens.
        rays: Of each wavelength, for the comparison with traced points.

    Raises:
        LensError: No light reaches the picture.
    """
    found = fit_aberration_map(lens)
    place = np.linspace(0, 1, _FIELDS)
    light = relative_illumination(lens, lens.prescription.image_radius, _FIELDS)
    vignette, error = _fit_vignette(place, np.maximum(light, 1e-3))
    matches = [pair.correlation for pair in psf_pairs(lens, found, rays) if pair.width > _BLURRED]
    return LensPreset(
        aberrations=found,
        vignette=vignette,
        light_error=error,
        correlation=float(np.mean(matches)),
        worst=float(min(matches)),
    )


def _fit_vignette(place: np.ndarray, light: np.ndarray) -> tuple[Vignette, float]:
    """The vignette with the least largest error; stops of each shape by least squares of logarithms."""
    field = np.stack([place, 0 * place], -1)
    best: tuple[float, Vignette] | None = None
    for radius in _RADII:
        for softness in _SOFTNESS:
            rise = -np.log2(Vignette(stops=1.0, radius=radius, softness=softness).factor(field, 1.0))
            # Weighed by the light, as errors of light are what counts.
            stops = float(
                np.clip((light**2 * rise * -np.log2(light)).sum() / (light**2 * rise**2).sum(), -10, 10)
            )
            error = float(np.abs(2 ** (-stops * rise) - light).max())
            if best is None or error < best[0]:
                best = error, Vignette(stops=stops, radius=float(radius), softness=float(softness))
    assert best is not None
    return best[1], best[0]
