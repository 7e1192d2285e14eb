"""Pairs of traced and approximated point spread functions of a lens, over depth and field."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from bokehnet.lenses.aberrations.aberration_fit import fit_aberration_map
from bokehnet.lenses.aberrations.point_spread import (
    PsfGrid,
    aberration_psf,
    correlation,
    psf_radius,
    traced_psf,
)
from bokehnet.lenses.prescription import PrescriptionLens
from bokehnet.optics.aberrations.aberration_map import AberrationMap
from bokehnet.optics.spectral.wavelength_sampling import WavelengthSampling

__all__ = ["FIELDS", "PsfPair", "psf_depths", "psf_pairs"]

# Field positions: the centre, half way, and nearly the corner.
FIELDS = (0.0, 0.5, 0.9)

# Blur radius at the nearest and farthest depth, half-diagonals, and minimum disparity, times the focal
# length: 10,000 focal lengths stand for infinity.
_BLUR_RADIUS, _MIN_DISPARITY = 1 / 50, 1e-4
# Number of cells along each side, fraction of them that the light fills, and number of wavelengths.
_SIZE, _FILL, _WAVELENGTHS = 64, 0.8, 24


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class PsfPair:
    """Traced and approximated image of one point of the scene.

    Attributes:
        depth: Depth, mm from the entrance pupil.
        field: Distance from the centre of the picture, to the right, corner at 1.
        blur_radius: Paraxial signed blur radius, in half-diagonals of the picture.
        width: Width of the images, in half-diagonals.
        traced: Image traced through the glass, (64, 64, 3), linear light.
        reduced: Image by the aberration map, (64, 64, 3), linear light.
    """

    depth: float
    field: float
    blur_radius: float
    width: float
    traced: np.ndarray
    reduced: np.ndarray

    @property
    def correlation(self) -> float:
        """Normalized cross-correlation of both images, over all colours."""
        return correlation(self.traced, self.reduced)


def psf_depths(lens: PrescriptionLens) -> tuple[float, float, float]:
    """Return depths in front of, at and behind focus, mm; none is behind focus at infinity.

    The blur radius in front and behind is a fiftieth of the half-diagonal, if such depths exist.
    """
    infinity = _MIN_DISPARITY / lens.focal_length
    per_disparity = lens.thick.pupil_radius * lens.sensor_distance
    focus = max(1 / lens.focus_distance, infinity)
    step = _BLUR_RADIUS * lens.prescription.image_radius / per_disparity
    # Keep a distance from the glass.
    nearest = 1 / (max(lens.front_vertex, 0) + 2 * lens.focal_length)
    near = min(focus + step, max(nearest, 1.2 * focus))
    if math.isinf(lens.focus_distance):
        return 1 / near, 2 / (near + focus), 1 / focus
    return 1 / near, 1 / focus, 1 / max(focus - step, infinity)


def psf_pairs(
    lens: PrescriptionLens,
    aberration_map: AberrationMap | None = None,
    rays: int = 12_000,
    wavelength_sampling: WavelengthSampling | None = None,
) -> Iterator[PsfPair]:
    """Yield the pairs of three depths (:func:`psf_depths`) at three fields each.

    The cell size of each adapts to its width, so that points in focus show their
    aberrations as well.

    Args:
        lens: Lens; the picture is its image circle.
        aberration_map: Map of the lens without distortion; None fits it.
        rays: Number of rays for each of 24 wavelengths.
        wavelength_sampling: Spectral weights; default: uniform light.
    """
    aberration_map = fit_aberration_map(lens) if aberration_map is None else aberration_map
    half_diagonal = lens.prescription.image_radius
    wavelengths, colors = (wavelength_sampling or WavelengthSampling()).sample(_WAVELENGTHS)
    for depth in psf_depths(lens):
        blur_radius = float(lens.coc_radius(1 / depth)) / half_diagonal
        for distance in FIELDS:
            field = (distance, 0.0)
            width = 2 / _FILL * psf_radius(lens, depth, field)
            traced = traced_psf(
                lens,
                PsfGrid(wavelengths=wavelengths, colors=colors, pitch=width / _SIZE, size=_SIZE, rays=rays),
                depth=depth,
                field=field,
            )
            reduced = aberration_psf(
                aberration_map,
                PsfGrid(
                    wavelengths=wavelengths,
                    colors=colors,
                    pitch=width / _SIZE / half_diagonal,
                    size=_SIZE,
                    rays=rays,
                ),
                defocus=blur_radius,
                field=field,
            )
            yield PsfPair(
                depth=depth,
                field=distance,
                blur_radius=blur_radius,
                width=width / half_diagonal,
                traced=traced,
                reduced=reduced,
            )
