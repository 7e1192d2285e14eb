"""Potmesil and Chakravarty's focus processor: every pixel spreads a disc with diffraction.

Faults: rings of a single wavelength per channel; foreground and background mix without order.
"""

import math
from functools import lru_cache

import numpy as np

from bokehnet.baselines.apertures import check_baseline, ladder_positions, radius_ladder
from bokehnet.baselines.spread.lommel_functions import lommel_intensity
from bokehnet.baselines.spread.psf_spreading import normalised, packed, spread_tables
from bokehnet.checks import check_above, check_numbers
from bokehnet.optics.aperture import Aperture

__all__ = ["WAVELENGTHS", "lommel", "lommel_table"]

# Wavelengths of red, green and blue, micrometres.
WAVELENGTHS = (0.61, 0.55, 0.465)


@lru_cache(maxsize=512)
def lommel_table(radius: float, unit: float) -> np.ndarray:
    """Return the light of a point on each pixel around it, float64, sum 1.

    Args:
        radius: Radius of the geometrical disc, pixels.
        unit: Wavelength times f-number, pixels; the first dark ring of a point in focus is at 1.22 units.
    """
    half = math.ceil(radius + 3 * unit + 0.5)
    distances = np.arange(0.0, math.sqrt(2) * (half + 1), min(0.05, unit / 8))
    profile = lommel_intensity(math.pi * radius / unit, math.pi * distances / unit)
    parts = max(5, min(25, math.ceil(2 / unit)))
    position = (np.arange((2 * half + 1) * parts) + 0.5) / parts - half - 0.5
    light = np.interp(np.hypot(position[None, :], position[:, None]), distances, profile)
    image = light.reshape(2 * half + 1, parts, 2 * half + 1, parts).sum(axis=(1, 3))
    return np.asarray(image / image.sum())


def lommel(
    image: np.ndarray,
    defocus: np.ndarray,
    aperture: Aperture | None = None,
    *,
    f_number: float = 2.8,
    pixel_pitch: float = 5.0,
    wavelengths: tuple[float, float, float] = WAVELENGTHS,
) -> np.ndarray:
    """Render by the focus processor, with a wavelength for each channel.

    Args:
        image: Scene-linear, (H, W, 3).
        defocus: Signed blur radius in pixels, (H, W), + in front of focus.
        aperture: Plain disc or None.
        f_number: F-number of the lens, for the diffraction.
        pixel_pitch: Distance between pixels, micrometres.
        wavelengths: Wavelengths of red, green and blue, micrometres.

    Returns:
        Picture (H, W, 3), float32.

    Source:
        Potmesil and Chakravarty, "A lens and aperture camera model for synthetic image generation", SIGGRAPH
        1981; thesis 000, eq. 3.14 to 3.17. Their eq. 3.16 also divides each sample's light by its squared
        depth; the light of a surface on a pixel does not depend on its distance, so the division is omitted
        here.
    """
    check_above("f_number", f_number, 0)
    check_above("pixel_pitch", pixel_pitch, 0, "micrometres")
    check_numbers("wavelengths", wavelengths, 3)
    for wavelength in wavelengths:
        check_above("wavelengths", wavelength, 0, "micrometres")
    image, defocus, _ = check_baseline("lommel", "disc", image, defocus, aperture)
    radii = radius_ladder(float(np.abs(defocus).max()))
    low, upper = ladder_positions(-np.abs(defocus), radii, -1)
    bokeh = np.empty_like(image)
    for channel, wavelength in enumerate(wavelengths):
        unit = wavelength * f_number / pixel_pitch
        tables = [lommel_table(float(radius) if index else 0.0, unit) for index, radius in enumerate(radii)]
        light = np.ascontiguousarray(image[..., channel : channel + 1])
        sums, weights = np.zeros(light.shape), np.zeros(defocus.shape)
        spread_tables(light, low, upper, *packed(tables), sums, weights)
        bokeh[..., channel : channel + 1] = normalised(sums, weights, light)
    return bokeh
