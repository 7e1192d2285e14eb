"""Lens preset: aberrations and vignette that approximate a prescription, and their errors."""

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
# Minimum width of compared point images, half-diagonals; smaller ones are sharp: below four pixels in a
# picture of 1600 x 1200.
_MIN_WIDTH = 4e-3
_RADII, _SOFTNESS = np.linspace(0.0, 0.6, 13), np.linspace(0.2, 1.6, 29)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class LensPreset:
    """Approximation of a lens by an aberration map and a vignette.

    Attributes:
        aberrations: Aberration map.
        vignette: Vignette that darkens like the lens.
        light_error: Largest error of the vignette, relative to the light at the centre.
        correlation: Mean correlation of rendered and traced point images over three fields and depths,
            except sharp ones.
        min_correlation: Smallest of these correlations.
    """

    aberrations: AberrationMap
    vignette: Vignette
    light_error: float
    correlation: float
    min_correlation: float


def lens_preset(lens: PrescriptionLens, rays: int = 12_000) -> LensPreset:
    """Return the preset of a lens, with focus and iris as set.

    Args:
        lens: Lens to approximate.
        rays: Number of rays per wavelength, for the comparison with traced points.

    Raises:
        LensError: No light reaches the picture.
    """
    aberrations = fit_aberration_map(lens)
    place = np.linspace(0, 1, _FIELDS)
    light = relative_illumination(lens, lens.prescription.image_radius, _FIELDS)
    vignette, error = _fit_vignette(place, np.maximum(light, 1e-3))
    correlations = [
        pair.correlation for pair in psf_pairs(lens, aberrations, rays) if pair.width > _MIN_WIDTH
    ]
    return LensPreset(
        aberrations=aberrations,
        vignette=vignette,
        light_error=error,
        correlation=float(np.mean(correlations)),
        min_correlation=float(min(correlations)),
    )


def _fit_vignette(place: np.ndarray, light: np.ndarray) -> tuple[Vignette, float]:
    """Return the vignette with the smallest maximum error, and that error; the stops are least squares."""
    field = np.stack([place, 0 * place], -1)
    best: tuple[float, Vignette] | None = None
    for radius in _RADII:
        for softness in _SOFTNESS:
            rise = -np.log2(Vignette(stops=1.0, radius=radius, softness=softness).factor(field, 1.0))
            # Weighted by the light, since the error is that of the light.
            stops = float(
                np.clip((light**2 * rise * -np.log2(light)).sum() / (light**2 * rise**2).sum(), -10, 10)
            )
            error = float(np.abs(2 ** (-stops * rise) - light).max())
            if best is None or error < best[0]:
                best = error, Vignette(stops=stops, radius=float(radius), softness=float(softness))
    assert best is not None
    return best[1], best[0]
