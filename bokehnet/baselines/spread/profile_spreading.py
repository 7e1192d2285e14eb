"""Spreading with the profile texture of a lens: every blur is that of a point on the axis.

A pixel's defocus selects the row of the texture, shifted for each wavelength; the profile becomes a radially
symmetric image of the point, one for each step of a ladder of defocus.

Faults: no change over the field, so neither cat's-eye, coma nor lateral colour; foreground and background mix
    without order.

Source: Jeong, "Efficient and expressive rendering for real-time defocus blur and bokeh", dissertation,
5.2 and 5.3, where highlights alone are drawn with the texture.
"""

import numpy as np

from bokehnet.baselines.apertures import check_baseline
from bokehnet.baselines.spread.lens_tables import defocus_ladder, spread_positions
from bokehnet.baselines.spread.psf_spreading import normalised
from bokehnet.checks import check_above
from bokehnet.lenses.lookup.profile_texture import ProfileTexture, profile_psf
from bokehnet.lenses.prescription import PrescriptionLens
from bokehnet.lenses.pupils.focus_shift import focus_shift
from bokehnet.optics.spectral.wavelength_sampling import WavelengthSampling

__all__ = ["plane_of_blur", "profile_spreading"]

# Number of wavelengths of a table.
_WAVELENGTHS = 12

# Margin of a table around its disc, pixels.
_MARGIN_PX = 3


def plane_of_blur(texture: ProfileTexture, lens: PrescriptionLens, radius: float, wavelength: float) -> float:
    """Return the plane of the texture, mm, with a signed blur radius on the sensor, mm, at a wavelength, nm.

    A point in front of focus has its image behind the sensor: the plane is below 0.
    """
    exit_radius = abs(float(lens.paraxial.exit.radius))
    focus = lens.paraxial.entrance, lens.focus_distance, lens.gaussian_focus
    shift = focus_shift(lens.surfaces_at(wavelength), *focus) - focus_shift(lens.surfaces, *focus)
    sharpest = lens.sensor_position - lens.gaussian_focus
    return sharpest - radius * texture.image_gap / exit_radius - shift


def profile_spreading(
    image: np.ndarray,
    defocus: np.ndarray,
    texture: ProfileTexture,
    lens: PrescriptionLens,
    pixel_pitch: float,
) -> np.ndarray:
    """Spread every pixel with the profile of its defocus.

    Args:
        image: Scene-linear, (H, W, 3).
        defocus: Signed blur radius in pixels, (H, W), + in front of focus.
        texture: Texture of the lens, from
            :func:`bokehnet.lenses.lookup.profile_texture.trace_profile_texture`.
        lens: The same lens, with focus and iris as traced.
        pixel_pitch: Pixel pitch, mm.

    Returns:
        Picture (H, W, 3), float32.

    Raises:
        ParameterError: The pixel pitch is not above 0.
    """
    check_above("pixel_pitch", pixel_pitch, 0, "mm")
    image, defocus, _ = check_baseline("profile_spreading", "disc", image, defocus, None)
    ladder = defocus_ladder(float(defocus.min()), float(defocus.max()))
    wavelengths, colors = WavelengthSampling().sample(_WAVELENGTHS)
    tables, halves = [], []
    for step in ladder:
        planes = np.array(
            [plane_of_blur(texture, lens, float(step) * pixel_pitch, float(nm)) for nm in wavelengths]
        )
        reach = float(np.interp(planes, texture.planes, texture.reach).max()) / pixel_pitch
        half = int(np.ceil(max(reach, abs(float(step))))) + _MARGIN_PX
        table = profile_psf(texture, planes, colors, pixel_pitch, 2 * half + 1).reshape(-1, 3)
        tables.append(table / np.maximum(table.sum(0), 1e-12))
        halves.append(half)
    starts = np.concatenate([[0], np.cumsum([len(table) for table in tables])])[:-1]
    sums, weights = np.zeros(image.shape), np.zeros(image.shape)
    middle = np.zeros(1)
    spread_positions(
        image,
        defocus,
        middle,
        middle,
        ladder,
        np.concatenate(tables),
        starts,
        np.array(halves),
        sums,
        weights,
    )
    return normalised(sums, weights, image)
