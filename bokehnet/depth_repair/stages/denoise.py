"""Noise of a map, as from sensors, stereo and renders with few samples: removal.

Noise makes blur radii uneven and, if it is as high as depth edges, creates false edges.

Method: joint bilateral filter (Tomasi and Manduchi, "Bilateral filtering for gray and color images", ICCV
1998) in two passes, the first with distant samples: errors of stereo matching are shared by the pixels of a
window, so that near samples do not average them. It smooths no colour edges, so that faint depth edges stay.
The second pass averages over colours: in fine texture the first one finds too few similar pixels.

In: the picture, scene-linear (H, W, 3), and the map (H, W), any unit. Out: the map in the same unit.
"""

import math

import numpy as np

from bokehnet.depth_repair.config import COLOR_SIGMA
from bokehnet.depth_repair.filters import joint_bilateral
from bokehnet.optics.encoding import encode

__all__ = ["denoise_map"]

# Half width of the window in samples, also the distance of the samples in the first pass, pixels; and
# standard deviation of disparities, in those of the noise.
_RADIUS, _SIGMAS = 3, 2.0


def denoise_map(image: np.ndarray, disparity: np.ndarray, deviation: float) -> np.ndarray:
    """Return the map without noise, (H, W) float32.

    Args:
        image: All-in-focus picture, scene-linear, not negative, (H, W, 3).
        disparity: Map, (H, W), float32, any unit.
        deviation: Standard deviation of the noise, in the unit of the map.
    """
    colors = np.asarray(encode(image), np.float32)
    for spacing, color_sigma in ((_RADIUS, COLOR_SIGMA), (1, math.inf)):
        disparity = joint_bilateral(
            colors, disparity, _RADIUS, color_sigma, _SIGMAS * deviation, spacing=spacing
        )
    return disparity
