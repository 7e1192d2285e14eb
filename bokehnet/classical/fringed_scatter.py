"""The scatter through a lens that does nothing but part colours: a few wavelengths, each with its own discs.

Axial colour gives each wavelength another blur radius, lateral colour another size of its picture; discs
stay discs. So a surface that nothing hides is a sum of scattered pictures, and needs no rays.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numba import prange

from bokehnet.classical.base import Frame
from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit
from bokehnet.optics.aberrations.lens_response import LensResponse

__all__ = ["Fringes", "fringed_scatter", "fringes_alone"]

# Wavelengths differ by so many pixels at most, and are so many at most; more are left to the rays.
_STEP, _MOST = 1.5, 10

# Wavelengths that stand for the spectrum when it is shared out.
_SPECTRUM = 3000


class Fringes(NamedTuple):
    """What a lens does to colours, where it does nothing else.

    Attributes:
        axial: Change of the blur radius of each wavelength, before its map, pixels, (K,).
        lateral: Shift of each in the corner, before its map, pixels, (K,).
        colors: What each gives of red, green and blue, (K, 3), of sum 1 each.
    """

    axial: np.ndarray
    lateral: np.ndarray
    colors: np.ndarray


def fringes_alone(lens_response: LensResponse, half_diagonal: float) -> Fringes | None:
    """The wavelengths that stand for all, or ``None``: the lens does more than that, or they are too many.

    Strengths of all wavelengths lie along one curve. Nodes are spread over it, and each wavelength is shared
    between its two neighbours, so that the mean strength of each colour is right.

    Args:
        lens_response: Of the lens.
        half_diagonal: Of the picture, pixels.
    """
    aberration = lens_response.chromatic_aberration
    if aberration is None or aberration.is_none or not lens_response.aberration_map.is_perfect:
        return None
    chances = (np.arange(_SPECTRUM) + 0.5) / _SPECTRUM
    wavelengths, weights = lens_response.wavelengths_at(chances)
    strengths = half_diagonal * aberration.strengths(wavelengths)
    if lens_response.wavelength_sampling.dispersion == "rgb":
        strengths = np.array([strengths[weights[:, c] > 0].mean(0) for c in range(3)])
        return Fringes(strengths[:, 0], strengths[:, 1], np.eye(3))
    curve = aberration.curve(wavelengths)
    low, high = float(curve.min()), float(curve.max())
    steps = math.ceil(float(np.hypot(*np.ptp(strengths, axis=0))) / _STEP)
    if steps >= _MOST:
        return None
    nodes = max(steps, 2) + 1
    place = (curve - low) / (high - low) * (nodes - 1)
    shares = np.maximum(1.0 - np.abs(place[:, None] - np.arange(nodes)), 0.0)
    colors = shares.T @ weights / weights.sum(0)
    at = low + (high - low) * np.arange(nodes) / (nodes - 1)
    axial, lateral = half_diagonal / 100 * np.array([-aberration.axial, aberration.lateral])
    return Fringes(axial * at, lateral * at, colors)


@njit(cache=True, parallel=True)
def _add_shifted(picture, lateral, color, maps, frame, above, total):  # type: ignore[no-untyped-def]
    """Add a picture of one wavelength, seen along its lateral shift, to ``total``, both (H, W, 3)."""
    height, width = picture.shape[:2]
    column, row, scale = frame
    for y in prange(height):
        for x in range(width):
            far_x, far_y = (x - column) * scale, (y + above - row) * scale
            # Overscan is seen as the corner is, up to which a lens is known.
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
        scattered: Scatters the picture with a defocus, (H, W), pixels.
        defocus: Of the design wavelength, (H, W).
        fringes: From :func:`fringes_alone`.
        maps: Factors of axial and lateral colour at each pixel, (H, W, 2).
        frame: Where the middle of the picture lies, and one over its half-diagonal.
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
