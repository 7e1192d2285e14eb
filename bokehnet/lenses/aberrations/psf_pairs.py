"""Traced and reduced point-spread functions of a lens side by side, over depth and field."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from bokehnet.lenses.aberrations.aberration_fit import fit_aberration_map
from bokehnet.lenses.aberrations.point_spread import aberration_psf, correlation, psf_reach, traced_psf
from bokehnet.lenses.prescription import PrescriptionLens
from bokehnet.optics.aberrations.aberration_map import AberrationMap
from bokehnet.optics.spectral.wavelength_sampling import WavelengthSampling

__all__ = ["FIELDS", "PsfPair", "psf_depths", "psf_pairs"]

# Middle of the picture, half way, and nearly the corner.
FIELDS = (0.0, 0.5, 0.9)

# Blur radius at the nearest and farthest depth, and the least disparity, over 1 / focal length: 10,000 focal
# lengths stand for infinity.
_BLUR, _INFINITY = 1 / 50, 1e-4
# Cells along each side, how much of them the light fills, and wavelengths.
_SIZE, _FILLED, _WAVELENGTHS = 64, 0.8, 24


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class PsfPair:
    """One point of the scene.

    Attributes:
        depth: mm from the entrance pupil.
        field: Distance from the middle of the picture, to the right, corner at 1.
        blur_radius: By Gaussian optics, signed, in half-diagonals of the picture.
        width: Of the pictures, in half-diagonals.
        traced: Through the glass, (64, 64, 3), linear light.
        reduced: Of the aberration map, the same.
    """

    depth: float
    field: float
    blur_radius: float
    width: float
    traced: np.ndarray
    reduced: np.ndarray

    @property
    def correlation(self) -> float:
        """Normalised cross-correlation of both, over all colours."""
        return correlation(self.traced, self.reduced)


def psf_depths(lens: PrescriptionLens) -> tuple[float, float, float]:
    """Depths in front of, at and behind focus, mm; behind focus at infinity there is nothing.

    The blur radius in front and behind is a fiftieth of the half diagonal, where depths can give it.
    """
    infinity = _INFINITY / lens.focal_length
    per_disparity = lens.thick.pupil_radius * lens.sensor_distance
    focus = max(1 / lens.focus_distance, infinity)
    step = _BLUR * lens.prescription.image_radius / per_disparity
    # Room is kept before the glass.
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

    Each is drawn in cells as fine as it needs to fill the picture, so that points in focus show their
    aberrations, too.

    Args:
        lens: The lens; its picture is the one that it is made for.
        aberration_map: Its map without distortion; None is made.
        rays: Of each of 24 wavelengths.
        wavelength_sampling: How wavelengths are seen; default: evenly lit.
    """
    aberration_map = fit_aberration_map(lens) if aberration_map is None else aberration_map
    half_diagonal = lens.prescription.image_radius
    wavelengths, colors = (wavelength_sampling or WavelengthSampling()).sample(_WAVELENGTHS)
    for depth in psf_depths(lens):
        blur_radius = float(lens.coc_radius(1 / depth)) / half_diagonal
        for distance in FIELDS:
            field = (distance, 0.0)
            width = 2 / _FILLED * psf_reach(lens, depth, field)
            traced = traced_psf(
                lens,
                depth=depth,
                field=field,
                wavelengths=wavelengths,
                colors=colors,
                pitch=width / _SIZE,
                size=_SIZE,
                rays=rays,
            )
            reduced = aberration_psf(
                aberration_map,
                defocus=blur_radius,
                field=field,
                wavelengths=wavelengths,
                colors=colors,
                pitch=width / _SIZE / half_diagonal,
                size=_SIZE,
                rays=rays,
            )
            yield PsfPair(
                depth=depth,
                field=distance,
                blur_radius=blur_radius,
                width=width / half_diagonal,
                traced=traced,
                reduced=reduced,
            )
