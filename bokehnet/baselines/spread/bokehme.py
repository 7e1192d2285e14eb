"""BokehMe's scatter as published: soft discs weighted by their area, without occlusion.

Faults: foreground and background mix without order; discs grow by half a pixel; lights behind a sharp edge
shine through it.
"""

import math

import numpy as np

from bokehnet.baselines.apertures import check_baseline
from bokehnet.baselines.spread.psf_spreading import normalised
from bokehnet.checks import check_range
from bokehnet.kernels import njit
from bokehnet.optics.aperture import Aperture

__all__ = ["bokehme_scatter"]


@njit(cache=True)
def _scatter(light, defocus, sums, weights):
    height, width, _ = light.shape
    for y in range(height):
        for x in range(width):
            radius = abs(defocus[y, x])
            reach = int(radius + 1.0)
            for v in range(max(0, y - reach), min(height, y + reach + 1)):
                for u in range(max(0, x - reach), min(width, x + reach + 1)):
                    distance = math.sqrt((u - x) * (u - x) + (v - y) * (v - y))
                    weight = (0.5 + 0.5 * math.tanh(4.0 * (radius - distance))) / (radius * radius + 0.2)
                    weights[v, u] += weight
                    for c in range(3):
                        sums[v, u, c] += weight * light[y, x, c]


def bokehme_scatter(
    image: np.ndarray, defocus: np.ndarray, aperture: Aperture | None = None, *, gamma: float = 1.0
) -> np.ndarray:
    """Render by the published scatter.

    Args:
        image: Scene-linear, (H, W, 3).
        defocus: Signed blur radius in pixels, (H, W).
        aperture: Plain disc or None.
        gamma: Exponent of scene-linear light for blending, 0.2 to 5; that of the paper, for encoded light, is
            2.2 times as large.

    Returns:
        Picture (H, W, 3), float32.

    Source:
        Peng et al., "BokehMe: When neural rendering meets classical rendering", CVPR 2022.
    """
    check_range("gamma", gamma, 0.2, 5)
    image, defocus, _ = check_baseline("bokehme_scatter", "disc", image, defocus, aperture)
    light = image if gamma == 1 else np.maximum(image, 0) ** np.float32(gamma)
    sums, weights = np.zeros(light.shape), np.zeros(defocus.shape)
    _scatter(light, defocus, sums, weights)
    bokeh = normalised(sums, weights, light)
    return bokeh if gamma == 1 else np.maximum(bokeh, 0) ** np.float32(1 / gamma)
