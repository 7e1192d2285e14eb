"""Heat diffusion: blur with a conductivity from the circle of confusion, solved implicitly row by row.

Faults: the blur is Gaussian, so lights do not become discs; a blurred foreground never extends over its
    outline, as diffusion stops at sharp surroundings.
"""

import numpy as np
from numba import prange

from bokehnet.baselines.apertures import check_baseline
from bokehnet.checks import check_whole
from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit
from bokehnet.optics.aperture import Aperture

__all__ = ["diffuse_rows", "diffusion"]


@njit(cache=True, parallel=True)
def diffuse_rows(values, conductivity):
    """Diffuse heat along the rows for one unit of time, in place, by one implicit step.

    Solves ``y[i] - b[i] (y[i + 1] - y[i]) + b[i - 1] (y[i] - y[i - 1]) = x[i]`` with ``b[i]`` the smaller
    conductivity of both neighbours, none beyond the ends: a tridiagonal system, by elimination.

    Args:
        values: Values, (H, W, C).
        conductivity: Conductivity, pixels squared per unit of time, (H, W).
    """
    height, width, channels = values.shape
    for y in prange(height):
        upper = np.empty(width)
        solution = np.empty((width, channels))
        left = 0.0
        for x in range(width):
            right = 0.0
            if x + 1 < width:
                right = min(conductivity[y, x], conductivity[y, x + 1])
            pivot = 1.0 + left + right
            if x > 0:
                pivot += left * upper[x - 1]
            upper[x] = -right / pivot
            for c in range(channels):
                carried = left * solution[x - 1, c] if x > 0 else 0.0
                solution[x, c] = (values[y, x, c] + carried) / pivot
            left = right
        for c in range(channels):
            values[y, width - 1, c] = solution[width - 1, c]
        for x in range(width - 2, -1, -1):
            for c in range(channels):
                solution[x, c] -= upper[x] * solution[x + 1, c]
                values[y, x, c] = solution[x, c]


def diffusion(
    image: np.ndarray, defocus: np.ndarray, aperture: Aperture | None = None, *, steps: int = 8
) -> np.ndarray:
    """Render by heat diffusion.

    A disc of radius r has the variance r^2 / 4 along each axis; diffusion over one unit of time has twice the
    conductivity as variance, so the conductivity is r^2 / 8. One implicit step along an axis gives a
    two-sided exponential; several shorter steps converge to the Gaussian.

    Args:
        image: Scene-linear, (H, W, 3).
        defocus: Signed blur radius in pixels, (H, W).
        aperture: Plain disc or None.
        steps: Number of steps along each axis, at least 1; the paper uses one.

    Returns:
        Picture (H, W, 3), float32.

    Source:
        Kass, Lefohn and Owens, "Interactive depth of field using simulated diffusion on a GPU", 2006; thesis
        000, eq. 3.20, with specific heat 1.
    """
    check_whole("steps", steps, 1)
    image, defocus, _ = check_baseline("diffusion", "disc", image, defocus, aperture)
    values = image.astype(np.float64)
    conductivity = defocus.astype(np.float64) ** 2 / (8 * steps)
    transposed = np.ascontiguousarray(conductivity.T)
    for _ in range(steps):
        with parallel_region:
            diffuse_rows(values, conductivity)
        values = np.ascontiguousarray(values.transpose(1, 0, 2))
        with parallel_region:
            diffuse_rows(values, transposed)
        values = np.ascontiguousarray(values.transpose(1, 0, 2))
    return values.astype(np.float32)
