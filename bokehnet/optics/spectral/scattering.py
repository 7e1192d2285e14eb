"""Light that surfaces of a lens scatter: the veil around lamps."""

import math

import numpy as np

__all__ = ["scatter_kernel"]


def scatter_kernel(half_diagonal: float, core: float, slope: float) -> np.ndarray:
    """Return where scattered light of a point falls, (n, n) pixels with n odd, 1 in all.

    Polished glass scatters by ``(1 + (r / core)^2)^(-slope / 2)``. What goes farther than one half-diagonal
    is left out.

    Args:
        half_diagonal: Of the picture, pixels.
        core: Radius within which it is flat, half-diagonals, above 0.
        slope: Power by which it falls farther out; 1.5 to 3 of real lenses.

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
