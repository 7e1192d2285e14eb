"""Comparison of profile texture and aberration map of a lens: size, time, error."""

import time
from dataclasses import dataclass

import numpy as np

from bokehnet.lenses.aberrations.aberration_fit import fit_aberration_map
from bokehnet.lenses.aberrations.point_spread import PsfGrid, aberration_psf, correlation
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
    """Representation of the blur of a lens, with its cost and errors.

    Attributes:
        name: Name of the representation.
        bytes: Size in bytes.
        build_seconds: Processor time to compute it, seconds.
        blur_seconds: Time for the blur of one point, 64 x 64 cells in 24 wavelengths, seconds.
        errors: One minus the correlation with traced blurs, mean over three depths, for points on the
            axis, half way to the corner and near it.
    """

    name: str
    bytes: int
    build_seconds: float
    blur_seconds: float
    errors: tuple[float, ...]


def compare_profiles(
    lens: PrescriptionLens, *, rows: int = 64, columns: int = 64, rays: int = 6000
) -> tuple[ProfileTexture, tuple[BlurKind, BlurKind]]:
    """Trace the profile texture of a lens and compare it with its aberration map.

    Args:
        lens: Lens to trace.
        rows: Number of image distances of the texture.
        columns: Number of radii of the texture.
        rays: Number of rays per wavelength of traced blurs and of the map.

    Returns:
        The texture, and the figures of the map and of the texture.

    Raises:
        LensError: No ray passes.
        ParameterError: As :func:`trace_profile_texture`.
    """
    wavelengths, colors = WavelengthSampling().sample(_WAVELENGTHS)
    half = lens.prescription.image_radius
    begin = time.process_time()
    texture = trace_profile_texture(lens, rows=rows, columns=columns)
    between = time.process_time()
    aberration_map = fit_aberration_map(lens)
    build_seconds = (time.process_time() - between, between - begin)
    seconds: tuple[list[float], list[float]] = ([], [])
    errors: dict[float, list[tuple[float, float]]] = {field: [] for field in FIELDS}
    for pair in psf_pairs(lens, aberration_map, rays):
        pitch = pair.width * half / _SIZE
        begin = time.process_time()
        used = np.array([profile_row(texture, lens, pair.depth, float(nm)) for nm in wavelengths])
        blurred = profile_psf(texture, used, colors, pitch, _SIZE)
        seconds[1].append(time.process_time() - begin)
        if pair.field == 0:
            begin = time.process_time()
            aberration_psf(
                aberration_map,
                PsfGrid(wavelengths=wavelengths, colors=colors, pitch=pitch / half, size=_SIZE, rays=rays),
                defocus=pair.blur_radius,
                field=(0.0, 0.0),
            )
            seconds[0].append(time.process_time() - begin)
        errors[pair.field].append((1 - pair.correlation, 1 - correlation(pair.traced, blurred)))
    arrays = (
        aberration_map.wavelengths,
        aberration_map.transverse_aberration,
        aberration_map.pupil_aberration,
    )
    sizes = (
        sum(array.nbytes for array in arrays) + 16 * len(aberration_map.vignetting_apertures),
        texture.size,
    )
    first, second = (
        BlurKind(
            name=name,
            bytes=sizes[number],
            build_seconds=build_seconds[number],
            blur_seconds=float(np.median(seconds[number])),
            errors=tuple(float(np.mean([row[number] for row in errors[field]])) for field in FIELDS),
        )
        for number, name in enumerate(("aberration map", "profile texture"))
    )
    return texture, (first, second)
