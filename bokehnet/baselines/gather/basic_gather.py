"""Basic gather: each pixel is the mean of random pixels inside its own circle of confusion.

Faults: noise from few samples; sharp surroundings bleed into blurred pixels; a blurred foreground keeps its
    sharp outline, as only a pixel's own blur counts.
"""

import math

import numpy as np
from numba import prange

from bokehnet.baselines.apertures import ANGLES, check_baseline, outline
from bokehnet.baselines.gather.nearest_pixel import nearest_pixel
from bokehnet.baselines.gather.resolution import with_resolution
from bokehnet.checks import check_whole
from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit
from bokehnet.optics.aperture import Aperture

__all__ = ["gather_basic", "random_number"]


@njit(cache=True)
def random_number(x, y, index):
    """Return a hash of position and index in [0, 1), by the finaliser of MurmurHash3."""
    state = np.uint32(x) * np.uint32(0x9E3779B1) ^ np.uint32(y) * np.uint32(0x85EBCA77)
    state = np.uint32(state) ^ np.uint32(index) * np.uint32(0xC2B2AE3D)
    state = np.uint32(state ^ (state >> np.uint32(16))) * np.uint32(0x85EBCA6B)
    state = np.uint32(state) ^ (np.uint32(state) >> np.uint32(13))
    state = np.uint32(state) * np.uint32(0xC2B2AE35)
    state = np.uint32(state) ^ (np.uint32(state) >> np.uint32(16))
    return np.uint32(state) / 4294967296.0


@njit(cache=True, parallel=True)
def _gather(image, defocus, shape, samples, bokeh):
    height, width, _ = image.shape
    for y in prange(height):
        for x in range(width):
            red, green, blue = 0.0, 0.0, 0.0
            red += image[y, x, 0]
            green += image[y, x, 1]
            blue += image[y, x, 2]
            blur = abs(defocus[y, x])
            side = 1.0 if defocus[y, x] > 0.0 else -1.0
            for index in range(samples):
                turn = random_number(x, y, 2 * index)
                angle = 2.0 * math.pi * turn
                rho = shape[int(turn * ANGLES)] * blur * side
                rho *= math.sqrt(random_number(x, y, 2 * index + 1))
                row, column = nearest_pixel(
                    y - rho * math.sin(angle), x - rho * math.cos(angle), height, width
                )
                red += image[row, column, 0]
                green += image[row, column, 1]
                blue += image[row, column, 2]
            bokeh[y, x, 0] = red / (samples + 1)
            bokeh[y, x, 1] = green / (samples + 1)
            bokeh[y, x, 2] = blue / (samples + 1)


@with_resolution
def gather_basic(
    image: np.ndarray, defocus: np.ndarray, aperture: Aperture | None = None, *, samples: int = 512
) -> np.ndarray:
    """Render by the basic gather.

    Args:
        image: Scene-linear, (H, W, 3).
        defocus: Signed blur radius in pixels, (H, W), + in front of focus.
        aperture: Aperture whose outline shapes the samples; default: disc.
        samples: Number of samples in addition to the pixel itself, at least 1.

    Returns:
        Picture (H, W, 3), float32.

    Source:
        Thesis 004, 2.2.3, the first listing. It adds ``iterations + 1`` colours and divides by
        ``iterations``, so that its pictures are too bright by 1 / ``iterations``; this function returns the
        mean.
    """
    check_whole("samples", samples, 1)
    image, defocus, aperture = check_baseline("gather_basic", "outline", image, defocus, aperture)
    bokeh = np.empty_like(image)
    with parallel_region:
        _gather(image, defocus, outline(aperture), samples, bokeh)
    return bokeh
