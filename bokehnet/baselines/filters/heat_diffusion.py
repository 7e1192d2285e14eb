"""Blur as heat that spreads: a conductivity from the circle of confusion, solved implicitly row by row.

Faults: the blur is a Gaussian, so lights become no discs; nothing is ever seen beyond the outline of a
blurred foreground, whose heat stops dead where its surroundings are sharp.
"""

import numpy as np
from numba import prange

from bokehnet.baselines.openings import check_baseline
from bokehnet.checks import check_whole
from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit
from bokehnet.optics.aperture import Aperture

__all__ = ["diffuse_rows", "diffusion"]


@njit(cache=True, parallel=True)
def diffuse_rows(values, conductivity):  # type: ignore[no-untyped-def]
    """Let heat spread along the rows for one unit of time, in place, by one implicit step.

    Solves ``y[i] - b[i] (y[i + 1] - y[i]) + b[i - 1] (y[i] - y[i - 1]) = x[i]`` with ``b[i]`` the smaller
    conductivity of both neighbours, none beyond the ends: a tridiagonal system, by elimination.

    Args:
        values: (H, W, C).
        conductivity: (H, W), pixels squared a unit of time.
    """
    height, width, channels = values.shape
    for y in prange(height):
        upper = np.empty(width)
        done = np.empty((width, channels))
        before = 0.0
        for x in range(width):
            after = 0.0
            if x + 1 < width:
                after = min(conductivity[y, x], conductivity[y, x + 1])
            pivot = 1.0 + before + after
            if x > 0:
                pivot += before * upper[x - 1]
            upper[x] = -after / pivot
            for c in range(channels):
                carried = before * done[x - 1, c] if x > 0 else 0.0
                done[x, c] = (values[y, x, c] + carried) / pivot
            before = after
        for c in range(channels):
            values[y, width - 1, c] = done[width - 1, c]
        for x in range(width - 2, -1, -1):
            for c in range(channels):
                done[x, c] -= upper[x] * done[x + 1, c]
                values[y, x, c] = done[x, c]


def diffusion(
    image: np.ndarray, defocus: np.ndarray, aperture: Aperture | None = None, *, steps: int = 8
) -> np.ndarray:
    """Render by heat diffusion.

    A disc of radius r has the variance r^2 / 4 along each axis, heat that spreads for one unit of time twice
    its conductivity; so that is r^2 / 8. One implicit step along an axis makes a two-sided exponential,
    several that share the time tend to the Gaussian.

    Args:
        image: Scene-linear, (H, W, 3).
        defocus: Signed blur radius in pixels, (H, W).
        aperture: A plain disc or None.
        steps: Along each axis, one after the other, from 1 up; the paper makes one.

    Returns:
        Picture (H, W, 3), float32.

    Source:
        Kass, Lefohn and Owens, "Interactive depth of field using simulated diffusion on a GPU", 2006; thesis
        000, eq. 3.20, with the specific heat 1.
    """
    check_whole("steps", steps, 1)
    image, defocus, _ = check_baseline("diffusion", "disc", image, defocus, aperture)
    values = image.astype(np.float64)
    conductivity = defocus.astype(np.float64) ** 2 / (8 * steps)
    turned = np.ascontiguousarray(conductivity.T)
    for _ in range(steps):
        with parallel_region:
            diffuse_rows(values, conductivity)
        values = np.ascontiguousarray(values.transpose(1, 0, 2))
        with parallel_region:
            diffuse_rows(values, turned)
        values = np.ascontiguousarray(values.transpose(1, 0, 2))
    return values.astype(np.float32)
