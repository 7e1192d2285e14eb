"""Light scattered by lens surfaces: veiling glare around lamps."""

import math

import numpy as np

__all__ = ["scatter_kernel"]


def scatter_kernel(half_diagonal: float, core: float, slope: float) -> np.ndarray:
    """Return the distribution of the scattered light of a point, (n, n) pixels with n odd, sum 1.

    Polished glass scatters by ``(1 + (r / core)^2)^(-slope / 2)``. The kernel is cut off at one
    half-diagonal.

    Args:
        half_diagonal: Half-diagonal of the picture, pixels.
        core: Radius of the flat core, half-diagonals, above 0.
        slope: Exponent of the falloff outside the core; 1.5 to 3 for real lenses.

    Source:
        Harvey, "Light-scattering characteristics of optical surfaces", thesis, 1976; the constants of a lens
        are measured, as by Talvala, Adams, Horowitz and Levoy, "Veiling glare in high dynamic range imaging",
        SIGGRAPH 2007.
    """
    reach = math.ceil(half_diagonal)
    axis = np.arange(-reach, reach + 1) / half_diagonal
    square = axis[:, None] ** 2 + axis**2
    light = np.where(square <= 1, (1 + square / core**2) ** (-slope / 2), 0.0)
    return np.asarray(light / light.sum())
