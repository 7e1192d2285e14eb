"""How much light a surface of glass reflects, bare or with a layer a quarter of a wavelength thick."""

import math
from typing import Literal, get_args

import numpy as np

from bokehnet.checks import check_choice

__all__ = ["COATINGS", "Coating", "reflectance"]

Coating = Literal["none", "single", "ideal"]
COATINGS = get_args(Coating)

# Magnesium fluoride, and the wavelength, nm, that layers are a quarter of.
_FLUORIDE, _MIDDLE = 1.38, 550.0


def reflectance(
    before: float, behind: float, cosine: np.ndarray, wavelength: float, coating: Coating
) -> np.ndarray:
    """Return the share of unpolarised light that is reflected.

    Args:
        before: Index on the side that light comes from.
        behind: Index on the other one.
        cosine: Of the angle of incidence, 0 to 1.
        wavelength: Nanometres.
        coating: "none"; "single", magnesium fluoride; "ideal", a layer whose index is the geometric mean of
            both. Between two glasses there is none.

    Source:
        Born and Wolf, "Principles of optics", 1959, 1.5.2 (Fresnel) and 1.6.4 (a homogeneous film).
    """
    check_choice("coating", coating, COATINGS)
    square = 1 - cosine * cosine

    def along(index: float) -> np.ndarray:
        """Cosine in a medium; nearly 0 where all light is reflected, as it is then."""
        return np.sqrt(np.maximum(1 - (before / index) ** 2 * square, 1e-24))

    def step(first: float, second: float) -> tuple[np.ndarray, np.ndarray]:
        """Amplitudes of both polarisations from one medium to the next."""
        a, b = along(first), along(second)
        across = (first * a - second * b) / (first * a + second * b)
        return across, (second * a - first * b) / (second * a + first * b)

    if coating == "none" or min(before, behind) > 1.2:
        return np.asarray(sum(r * r for r in step(before, behind)) / 2)
    film = _FLUORIDE if coating == "single" else math.sqrt(before * behind)
    # |(r + s e) / (1 + r s e)|^2 with |e| = 1, of which only the real part c counts.
    c = np.cos(math.pi * _MIDDLE / wavelength * along(film))
    total = 0.0 * c
    for r, s in zip(step(before, film), step(film, behind), strict=True):
        total = total + (r * r + s * s + 2 * r * s * c) / (1 + r * r * s * s + 2 * r * s * c)
    return np.asarray(total / 2)
