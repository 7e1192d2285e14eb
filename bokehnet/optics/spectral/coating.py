"""Reflectance of glass surfaces, uncoated or with a quarter-wave layer."""

import math
from typing import Literal, get_args

import numpy as np

from bokehnet.checks import check_choice

__all__ = ["COATINGS", "Coating", "reflectance"]

Coating = Literal["none", "single", "ideal"]
COATINGS = get_args(Coating)

# Refractive index of magnesium fluoride, and the design wavelength of quarter-wave layers, nm.
_FLUORIDE_INDEX, _COATING_WAVELENGTH = 1.38, 550.0


def reflectance(
    before: float, behind: float, cosine: np.ndarray, wavelength: float, coating: Coating
) -> np.ndarray:
    """Return the reflected fraction of unpolarised light.

    Args:
        before: Refractive index on the side of the incident light.
        behind: Refractive index on the other side.
        cosine: Cosine of the angle of incidence, 0 to 1.
        wavelength: Wavelength, nm.
        coating: "none"; "single", magnesium fluoride; "ideal", a layer whose index is the geometric mean of
            both. Surfaces between two glasses have no coating.

    Source:
        Born and Wolf, "Principles of optics", 1959, 1.5.2 (Fresnel) and 1.6.4 (a homogeneous film).
    """
    check_choice("coating", coating, COATINGS)
    square = 1 - cosine * cosine

    def along(index: float) -> np.ndarray:
        """Return the cosine in a medium; nearly 0 for total reflection, which then reflects all light."""
        return np.sqrt(np.maximum(1 - (before / index) ** 2 * square, 1e-24))

    def step(first: float, second: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the amplitudes of both polarisations from one medium to the next."""
        a, b = along(first), along(second)
        across = (first * a - second * b) / (first * a + second * b)
        return across, (second * a - first * b) / (second * a + first * b)

    if coating == "none" or min(before, behind) > 1.2:
        return np.asarray(sum(r * r for r in step(before, behind)) / 2)
    film = _FLUORIDE_INDEX if coating == "single" else math.sqrt(before * behind)
    # |(r + s e) / (1 + r s e)|^2 with |e| = 1 depends on the real part c of e only.
    c = np.cos(math.pi * _COATING_WAVELENGTH / wavelength * along(film))
    total = 0.0 * c
    for r, s in zip(step(before, film), step(film, behind), strict=True):
        total = total + (r * r + s * s + 2 * r * s * c) / (1 + r * r * s * s + 2 * r * s * c)
    return np.asarray(total / 2)
