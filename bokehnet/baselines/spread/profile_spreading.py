"""Spreading with the radial profiles of a lens: every blur is that of a point on the axis.

:func:`profile_spreading` takes the profiles from the response of the lens, so that every engine's interface
serves; :func:`texture_spreading` takes them from a traced texture, by our mapping of depth and wavelength or
by the printed one. Either way a profile becomes a radially symmetric image of the point, one for each step of
a ladder of defocus.

Faults: no change over the field, so neither cat's-eye, coma nor lateral colour; foreground and background mix
    without order.

Source: Jeong, "Efficient and expressive rendering for real-time defocus blur and bokeh", dissertation,
5.2 and 5.3, where highlights alone are drawn with the texture.
"""

import numpy as np

from bokehnet.baselines.apertures import check_baseline
from bokehnet.baselines.spread.lens_tables import defocus_ladder, spread_positions, traced_tables
from bokehnet.baselines.spread.psf_spreading import normalised
from bokehnet.checks import check_above, check_choice
from bokehnet.errors import ParameterError
from bokehnet.lenses.lookup.printed_mappings import printed_row
from bokehnet.lenses.lookup.profile_texture import ProfileTexture, profile_psf
from bokehnet.lenses.prescription import PrescriptionLens
from bokehnet.lenses.pupils.focus_shift import focus_shift
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.aperture import Aperture
from bokehnet.optics.spectral.wavelength_sampling import WavelengthSampling

__all__ = ["MAPPINGS", "plane_of_blur", "profile_spreading", "texture_spreading"]

MAPPINGS = ("pupils", "printed")
"""Mappings of depth and wavelength to a texture: ours, by principal planes and pupils, and (5.6) to (5.9)."""

# Number of wavelengths of a table.
_WAVELENGTHS = 12

# Margin of a table around its disc, pixels.
_MARGIN_PX = 3

# Number of rings of a profile per pixel.
_RINGS_PER_PX = 2


def profile_spreading(
    image: np.ndarray,
    defocus: np.ndarray,
    aperture: Aperture | None = None,
    *,
    lens_response: LensResponse | None = None,
) -> np.ndarray:
    """Spread every pixel with the radial profile of its defocus on the axis.

    Args:
        image: Scene-linear, (H, W, 3).
        defocus: Signed blur radius in pixels, (H, W), + in front of focus.
        aperture: A disc.
        lens_response: Aberrations and colours; default: an ideal lens.

    Returns:
        Picture (H, W, 3), float32.

    Raises:
        ParameterError: The blur exceeds 64 pixels.

    Source:
        Jeong, dissertation, 5.2.
    """
    image, defocus, aperture = check_baseline("profile_spreading", "disc", image, defocus, aperture)
    height, width = defocus.shape
    ladder = defocus_ladder(float(defocus.min()), float(defocus.max()))
    lights = np.ones((len(ladder), 8))
    # The axis passes the middle of the picture; a table is centred on a pixel.
    lights[:, 0], lights[:, 1], lights[:, 2] = width // 2, height // 2, ladder
    shape = (2 * (height // 2) + 1, 2 * (width // 2) + 1)
    tables, starts, halves = traced_tables(aperture, lens_response or LensResponse(), lights, shape)
    for start, half in zip(starts, halves, strict=True):
        block = slice(start, start + (2 * half + 1) ** 2)
        tables[block] = _radial_mean(tables[block], int(half))
    return _spread(image, defocus, ladder, tables, starts, halves)


def _radial_mean(table: np.ndarray, half: int) -> np.ndarray:
    """Return a square table (pixels, 3) with the mean of each ring about its middle."""
    axis = np.arange(-half, half + 1)
    ring = np.rint(_RINGS_PER_PX * np.hypot(axis, axis[:, None])).astype(np.int64).ravel()
    count = np.maximum(np.bincount(ring), 1)
    means = np.stack([np.bincount(ring, channel) / count for channel in table.T], -1)
    return np.asarray(means[ring])


def _spread(
    image: np.ndarray,
    defocus: np.ndarray,
    ladder: np.ndarray,
    tables: np.ndarray,
    starts: np.ndarray,
    halves: np.ndarray,
) -> np.ndarray:
    """Return the picture of tables that are the same at all positions."""
    sums, weights = np.zeros(image.shape), np.zeros(image.shape)
    middle = np.zeros(1)
    spread_positions(image, defocus, middle, middle, ladder, tables, starts, halves, sums, weights)
    return normalised(sums, weights, image)


def plane_of_blur(
    texture: ProfileTexture,
    lens: PrescriptionLens,
    radius: float,
    wavelength: float,
    mapping: str = "pupils",
) -> float:
    """Return the plane of the texture, mm, with a signed blur radius on the sensor, mm, at a wavelength, nm.

    A point in front of focus has its image behind the sensor: the plane is below 0. The printed mapping needs
    the depth of the point, which is that of the radius by the lens.
    """
    sharpest = lens.sensor_position - lens.gaussian_focus
    if mapping == "printed":
        far, focus = float(lens.coc_radius(0.0)), 1 / lens.focus_distance
        return printed_row(lens, 1 / (focus * (1 - radius / far)), wavelength, sharpest)
    exit_radius = abs(float(lens.paraxial.exit.radius))
    focus_of = lens.paraxial.entrance, lens.focus_distance, lens.gaussian_focus
    shift = focus_shift(lens.surfaces_at(wavelength), *focus_of) - focus_shift(lens.surfaces, *focus_of)
    return sharpest - radius * texture.image_gap / exit_radius - shift


def texture_spreading(
    image: np.ndarray,
    defocus: np.ndarray,
    texture: ProfileTexture,
    lens: PrescriptionLens,
    pixel_pitch: float,
    *,
    mapping: str = "pupils",
) -> np.ndarray:
    """Spread every pixel with the row of a texture for its defocus.

    Args:
        image: Scene-linear, (H, W, 3).
        defocus: Signed blur radius in pixels, (H, W), + in front of focus.
        texture: Texture of the lens, from
            :func:`bokehnet.lenses.lookup.profile_texture.trace_profile_texture`.
        lens: The same lens, with focus and iris as traced.
        pixel_pitch: Pixel pitch, mm.
        mapping: One of ``MAPPINGS``.

    Returns:
        Picture (H, W, 3), float32.

    Raises:
        ParameterError: The pixel pitch is not above 0, the mapping is unknown, or a lens focused at infinity
            has the printed mapping.

    Source:
        Jeong, dissertation, 5.2 and (5.5) to (5.9).
    """
    check_above("pixel_pitch", pixel_pitch, 0, "mm")
    check_choice("mapping", mapping, MAPPINGS)
    if mapping == "printed" and not np.isfinite(lens.focus_distance):
        expected = "a lens with a finite focus distance for the printed mapping"
        raise ParameterError("lens", expected, lens.focus_distance, "set `focus_distance`", shown="infinity")
    image, defocus, _ = check_baseline("texture_spreading", "disc", image, defocus, None)
    ladder = defocus_ladder(float(defocus.min()), float(defocus.max()))
    wavelengths, colors = WavelengthSampling().sample(_WAVELENGTHS)
    tables, halves = [], []
    for step in ladder:
        radius = float(step) * pixel_pitch
        planes = np.array([plane_of_blur(texture, lens, radius, float(nm), mapping) for nm in wavelengths])
        reach = float(np.interp(planes, texture.planes, texture.reach).max()) / pixel_pitch
        half = int(np.ceil(max(reach, abs(float(step))))) + _MARGIN_PX
        table = profile_psf(texture, planes, colors, pixel_pitch, 2 * half + 1).reshape(-1, 3)
        tables.append(table / np.maximum(table.sum(0), 1e-12))
        halves.append(half)
    starts = np.concatenate([[0], np.cumsum([len(table) for table in tables])])[:-1]
    return _spread(image, defocus, ladder, np.concatenate(tables), starts, np.array(halves))
