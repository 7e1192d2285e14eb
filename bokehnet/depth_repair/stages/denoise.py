"""Noise of a map, as from sensors and renders with few samples: removal.

Noise makes blur radii uneven and, if it is as high as depth edges, creates false edges.

Method: joint bilateral filter (Tomasi and Manduchi, "Bilateral filtering for gray and color images", ICCV
1998) in two passes; the second one assumes half the noise. Depth edges and colour edges are not smoothed.

In: the picture, scene-linear (H, W, 3), and the map (H, W), any unit. Out: the map in the same unit.
"""

import numpy as np

from bokehnet.depth_repair.filters import joint_bilateral
from bokehnet.optics.encoding import encode

__all__ = ["denoise_map"]

# Half width of the window, pixels; standard deviation of encoded colours; standard deviations of disparities
# in each pass, in standard deviations of the noise.
_RADIUS_PX, _COLOR_SIGMA, _DISPARITY_SIGMAS = 3, 0.06, (2.5, 1.25)


def denoise_map(image: np.ndarray, disparity: np.ndarray, deviation: float) -> np.ndarray:
    """Return the map without noise, (H, W) float32.

    Args:
        image: All-in-focus picture, scene-linear, not negative, (H, W, 3).
        disparity: Map, (H, W), float32, any unit.
        deviation: Standard deviation of the noise, in the unit of the map.
    """
    colors = np.asarray(encode(image), np.float32)
    for sigma in _DISPARITY_SIGMAS:
        disparity = joint_bilateral(colors, disparity, _RADIUS_PX, _COLOR_SIGMA, sigma * deviation)
    return disparity
