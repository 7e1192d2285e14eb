"""Scatter through a lens with chromatic aberration only: a few wavelengths, each with discs of its own.

Axial color gives each wavelength another blur radius, lateral color another image scale; discs stay discs.
A surface that is not occluded is therefore a sum of scattered pictures and needs no rays.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numba import prange

from bokehnet.arrays.viewport import Frame
from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit
from bokehnet.optics.aberrations.lens_response import LensResponse

__all__ = ["Fringes", "chromatic_fringes", "fringed_scatter"]

# Upper bounds: difference between adjacent wavelengths in pixels, and number of wavelengths. Lenses that need
# more wavelengths are left to the rays.
_MAX_STEP_PX, _MAX_WAVELENGTHS = 1.5, 10

# Number of samples of the spectrum that are distributed to the wavelengths.
_SPECTRUM_SAMPLES = 3000


class Fringes(NamedTuple):
    """Chromatic aberration of a lens that has no other aberration.

    Attributes:
        axial: Change of the blur radius per wavelength, before its map, pixels, (K,).
        lateral: Shift per wavelength in the corner, before its map, pixels, (K,).
        colors: Contribution of each wavelength to red, green and blue, (K, 3); each channel sums to 1.
    """

    axial: np.ndarray
    lateral: np.ndarray
    colors: np.ndarray


def chromatic_fringes(lens_response: LensResponse, half_diagonal: float) -> Fringes | None:
    """Return the wavelengths that represent the spectrum, or ``None``.

    ``None`` means that the lens has other aberrations or needs too many wavelengths. The strengths of all
    wavelengths are on one curve. Nodes are distributed over it, and each wavelength is divided between its
    two neighbours, so that the mean strength of each color is exact.

    Args:
        lens_response: Response of the lens.
        half_diagonal: Half-diagonal of the picture, pixels.
    """
    aberration = lens_response.chromatic_aberration
    if aberration is None or aberration.is_none or not lens_response.aberration_map.is_perfect:
        return None
    chances = (np.arange(_SPECTRUM_SAMPLES) + 0.5) / _SPECTRUM_SAMPLES
    wavelengths, weights = lens_response.wavelengths_at(chances)
    strengths = half_diagonal * aberration.strengths(wavelengths)
    if lens_response.wavelength_sampling.dispersion == "rgb":
        strengths = np.array([strengths[weights[:, c] > 0].mean(0) for c in range(3)])
        return Fringes(strengths[:, 0], strengths[:, 1], np.eye(3))
    curve = aberration.curve(wavelengths)
    low, high = float(curve.min()), float(curve.max())
    steps = math.ceil(float(np.hypot(*np.ptp(strengths, axis=0))) / _MAX_STEP_PX)
    if steps >= _MAX_WAVELENGTHS:
        return None
    nodes = max(steps, 2) + 1
    position = (curve - low) / (high - low) * (nodes - 1)
    node_weights = np.maximum(1.0 - np.abs(position[:, None] - np.arange(nodes)), 0.0)
    colors = node_weights.T @ weights / weights.sum(0)
    node_values = low + (high - low) * np.arange(nodes) / (nodes - 1)
    axial, lateral = half_diagonal / 100 * np.array([-aberration.axial, aberration.lateral])
    return Fringes(axial * node_values, lateral * node_values, colors)


@njit(cache=True, parallel=True)
def _add_shifted(picture, lateral, color, maps, frame, above, total):
    """Add the picture of one wavelength, displaced by its lateral color, to ``total``, both (H, W, 3)."""
    height, width = picture.shape[:2]
    column, row, scale = frame
    for y in prange(height):
        for x in range(width):
            far_x, far_y = (x - column) * scale, (y + above - row) * scale
            # The lens data end at the corner: overscan beyond it repeats the corner's.
            away = lateral * maps[y, x, 1] / max(math.sqrt(far_x * far_x + far_y * far_y), 1.0)
            at_x = min(max(x - away * far_x, 0.0), width - 1.0)
            at_y = min(max(y - away * far_y, 0.0), height - 1.0)
            left, top = min(int(at_x), width - 2), min(int(at_y), height - 2)
            u, v = np.float32(at_x - left), np.float32(at_y - top)
            for c in range(3):
                upper = picture[top, left, c] + u * (picture[top, left + 1, c] - picture[top, left, c])
                lower = picture[top + 1, left, c] + u * (
                    picture[top + 1, left + 1, c] - picture[top + 1, left, c]
                )
                total[y, x, c] += color[c] * (upper + v * (lower - upper))


def fringed_scatter(
    scattered: Callable[[np.ndarray], np.ndarray],
    defocus: np.ndarray,
    fringes: Fringes,
    maps: np.ndarray,
    frame: Frame,
    above: int = 0,
) -> np.ndarray:
    """Scatter wavelength by wavelength.

    Args:
        scattered: Function that scatters the picture with a defocus, (H, W), pixels.
        defocus: Defocus of the design wavelength, (H, W).
        fringes: Wavelengths, from :func:`chromatic_fringes`.
        maps: Factors of axial and lateral color at each pixel, (H, W, 2).
        frame: Centre of the picture, and reciprocal of its half-diagonal.
        above: Rows of the picture above these.

    Returns:
        Picture, (H, W, 3) float32.
    """
    total = np.zeros((*defocus.shape, 3), np.float32)
    for axial, lateral, color in zip(*fringes, strict=True):
        picture = scattered(defocus + np.float32(axial) * maps[..., 0])
        with parallel_region:
            _add_shifted(picture, float(lateral), color.astype(np.float32), maps, tuple(frame), above, total)
    return total
