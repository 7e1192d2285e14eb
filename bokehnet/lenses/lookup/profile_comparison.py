"""Profile texture and aberration map of a lens side by side: bytes, time, error."""

import time
from dataclasses import dataclass

import numpy as np

from bokehnet.lenses.aberrations.aberration_fit import fit_aberration_map
from bokehnet.lenses.aberrations.point_spread import aberration_psf, correlation
from bokehnet.lenses.aberrations.psf_pairs import FIELDS, psf_pairs
from bokehnet.lenses.lookup.profile_texture import (
    ProfileTexture,
    profile_psf,
    profile_row,
    trace_profile_texture,
)
from bokehnet.lenses.prescription import PrescriptionLens
from bokehnet.optics.spectral.wavelength_sampling import WavelengthSampling

__all__ = ["BlurKind", "compare_profiles"]

_SIZE, _WAVELENGTHS = 64, 24


@dataclass(frozen=True, kw_only=True, slots=True)
class BlurKind:
    """One way to hold the blur of a lens.

    Attributes:
        name: What it is.
        bytes: That it holds.
        made: Seconds of processor time to make it.
        blur: Seconds for the blur of one point, 64 x 64 cells in 24 wavelengths.
        errors: One less the correlation with traced blurs, in the mean over three depths, for points on the
            axis, half way to the corner and near it.
    """

    name: str
    bytes: int
    made: float
    blur: float
    errors: tuple[float, ...]


def compare_profiles(
    lens: PrescriptionLens, *, rows: int = 64, columns: int = 64, rays: int = 6000
) -> tuple[ProfileTexture, tuple[BlurKind, BlurKind]]:
    """Trace the texture of a lens, as it is focused and stopped down, and compare it with its aberration map.

    Args:
        lens: The lens.
        rows: Distances of the image in the texture.
        columns: Radii.
        rays: Of each wavelength, of traced blurs and those of the map.

    Returns:
        The texture, and what there is to say of the map and of the texture.

    Raises:
        LensError: No ray passes.
        ParameterError: As :func:`trace_profile_texture`.
    """
    wavelengths, colors = WavelengthSampling().sample(_WAVELENGTHS)
    half = lens.prescription.image_radius
    begin = time.process_time()
    texture = trace_profile_texture(lens, rows=rows, columns=columns)
    between = time.process_time()
    found = fit_aberration_map(lens)
    made = (time.process_time() - between, between - begin)
    taken: tuple[list[float], list[float]] = ([], [])
    errors: dict[float, list[tuple[float, float]]] = {field: [] for field in FIELDS}
    for pair in psf_pairs(lens, found, rays):
        pitch = pair.width * half / _SIZE
        begin = time.process_time()
        used = np.array([profile_row(texture, lens, pair.depth, float(nm)) for nm in wavelengths])
        shown = profile_psf(texture, used, colors, pitch, _SIZE)
        taken[1].append(time.process_time() - begin)
        if pair.field == 0:
            begin = time.process_time()
            aberration_psf(
                found,
                defocus=pair.blur_radius,
                field=(0.0, 0.0),
                wavelengths=wavelengths,
                colors=colors,
                pitch=pitch / half,
                size=_SIZE,
                rays=rays,
            )
            taken[0].append(time.process_time() - begin)
        errors[pair.field].append((1 - pair.correlation, 1 - correlation(pair.traced, shown)))
    arrays = (found.wavelengths, found.transverse_aberration, found.pupil_aberration)
    sizes = (sum(array.nbytes for array in arrays) + 16 * len(found.vignetting_apertures), texture.size)
    first, second = (
        BlurKind(
            name=name,
            bytes=sizes[number],
            made=made[number],
            blur=float(np.median(taken[number])),
            errors=tuple(float(np.mean([row[number] for row in errors[field]])) for field in FIELDS),
        )
        for number, name in enumerate(("aberration map", "profile texture"))
    )
    return texture, (first, second)
