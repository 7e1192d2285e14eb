"""Advanced gather: a spiral of samples, each mixed in by the coverage of the pixel by its blur.

Faults: a sample out of reach counts as the running mean, so samples near the centre weigh too much; a blurred
    foreground stays visible inside its own blur; the spiral is visible with few samples.
"""

import math

import numpy as np
from numba import prange

from bokehnet.baselines.apertures import ANGLES, check_baseline, outline
from bokehnet.baselines.gather.nearest_pixel import nearest_pixel
from bokehnet.baselines.gather.resolution import with_resolution
from bokehnet.baselines.gather.spiral import spiral
from bokehnet.checks import check_above
from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit
from bokehnet.optics.aperture import Aperture

__all__ = ["gather_spiral"]


@njit(cache=True, parallel=True)
def _gather(image, defocus, offsets, bokeh):
    height, width, _ = image.shape
    for y in prange(height):
        for x in range(width):
            red, green, blue = 0.0, 0.0, 0.0
            red += image[y, x, 0]
            green += image[y, x, 1]
            blue += image[y, x, 2]
            centre = defocus[y, x]
            steps = 1.0
            for index in range(offsets.shape[0]):
                radius = offsets[index, 2]
                row, column = nearest_pixel(y + offsets[index, 1], x + offsets[index, 0], height, width)
                blur = abs(defocus[row, column])
                if defocus[row, column] < centre:  # behind the pixel
                    blur = min(blur, 2.0 * abs(centre))
                t = min(max(blur - radius + 0.5, 0.0), 1.0)
                m = t * t * (3.0 - 2.0 * t)
                red += red / steps * (1.0 - m) + image[row, column, 0] * m
                green += green / steps * (1.0 - m) + image[row, column, 1] * m
                blue += blue / steps * (1.0 - m) + image[row, column, 2] * m
                steps += 1.0
            bokeh[y, x, 0] = red / steps
            bokeh[y, x, 1] = green / steps
            bokeh[y, x, 2] = blue / steps


@with_resolution
def gather_spiral(
    image: np.ndarray, defocus: np.ndarray, aperture: Aperture | None = None, *, scale: float = 0.35
) -> np.ndarray:
    """Render by the advanced gather.

    Args:
        image: Scene-linear, (H, W, 3).
        defocus: Signed blur radius in pixels, (H, W), + in front of focus.
        aperture: Aperture whose outline, the same on both sides of focus, shapes the samples; default: disc.
        scale: Scale of the spiral, pixels; the area per sample is 2 pi scale.

    Source:
        Gustafsson, "Bokeh depth of field in a single pass", 2018; thesis 004, 2.2.3, the second listing, with
        the outline of eq. 2.2 for apertures with blades.
    """
    check_above("scale", scale, 0)
    image, defocus, aperture = check_baseline("gather_spiral", "outline", image, defocus, aperture)
    angle, radius = spiral(float(np.abs(defocus).max()), scale).T
    stretched = radius * outline(aperture)[(angle / (2 * math.pi) % 1 * ANGLES).astype(int) % ANGLES]
    offsets = np.stack([stretched * np.cos(angle), stretched * np.sin(angle), radius], -1)
    bokeh = np.empty_like(image)
    with parallel_region:
        _gather(image, defocus, np.ascontiguousarray(offsets), bokeh)
    return bokeh
