"""Assignment of lights at depth discontinuities to the surface that carries them.

A lamp at an outline is drawn over several pixels, some of which have the depth of the other surface. Such a
pixel shows ``I = a L + (1 - a) M``: L is the lamp, as its brightest neighbour on that other surface shows
it, M the mean of the pixel's own surface without lights. Its coverage follows by least squares,
``a = (I - M) . (L - M) / |L - M|^2``, between 0 and 1, and the remainder of ``I`` is assigned to the lamp, so
that no energy is lost. Lights without a brighter neighbour on another surface stay whole, at the depth of
their pixel.
"""

import numpy as np
from numba import prange

from bokehnet.classical.layered.boundaries.unmixing import MixedPixels, mean_color
from bokehnet.classical.layered.depth_discontinuities import DISCONTINUITY_THRESHOLD
from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit

__all__ = ["split_lights"]


@njit(cache=True)
def _carrier(image, defocus, lights, y, x):
    """Return row and column of the brightest light next to (y, x) on another surface; else -1."""
    height, width = defocus.shape
    largest = max(image[y, x, 0], image[y, x, 1], image[y, x, 2])
    row = column = -1
    for v in range(max(0, y - 1), min(height, y + 2)):
        for u in range(max(0, x - 1), min(width, x + 2)):
            brightness = max(image[v, u, 0], image[v, u, 1], image[v, u, 2])
            apart = abs(defocus[v, u] - defocus[y, x])
            if lights[v, u] and brightness > largest and apart > DISCONTINUITY_THRESHOLD:
                largest, row, column = brightness, v, u
    return row, column


@njit(cache=True, parallel=True)
def _split_lights(image, defocus, lights, sides, places, colors, surfaces):
    """Fill colors (N, 2, 3) of lamp and rest, and (N, 3): the lamp's defocus, coverage and existence."""
    for i in prange(len(places)):
        y, x = places[i, 0], places[i, 1]
        surfaces[i, 2] = 0.0
        v, u = _carrier(image, defocus, lights, y, x)
        if v < 0:
            continue
        around = (image, defocus, lights, sides, y, x, defocus[y, x], DISCONTINUITY_THRESHOLD)
        if mean_color(*around, colors[i, 1]) < 0.0:
            continue
        along = square = 0.0
        for c in range(3):
            across = image[v, u, c] - colors[i, 1, c]
            along += (image[y, x, c] - colors[i, 1, c]) * across
            square += across * across
        if along <= 0.0:
            continue
        coverage = min(along / square, 1.0)
        for c in range(3):
            rest = min((1.0 - coverage) * colors[i, 1, c], image[y, x, c])
            colors[i, 0, c] = (image[y, x, c] - rest) / coverage
            if coverage < 1.0:
                colors[i, 1, c] = rest / (1.0 - coverage)
        surfaces[i, 0], surfaces[i, 1], surfaces[i, 2] = defocus[v, u], coverage, 1.0


def split_lights(
    image: np.ndarray, defocus: np.ndarray, sides: np.ndarray, lights: np.ndarray
) -> MixedPixels:
    """Split lights whose brighter neighbour has another depth into the lamp and the surface of the pixel.

    Args:
        image: All-in-focus picture, scene-linear, (H, W, 3), float32.
        defocus: Signed blur radius in pixels, (H, W), + in front of focus, float32, with sharp steps.
        sides: From :func:`bokehnet.classical.layered.depth_discontinuities.discontinuity_sides`.
        lights: Mask of lights, (H, W) bool.

    Returns:
        Both surfaces of these pixels. They add up to the picture except for rounding.
    """
    places = np.argwhere((sides != 0) & lights)
    colors, surfaces = np.empty((len(places), 2, 3)), np.empty((len(places), 3))
    with parallel_region:
        _split_lights(image, defocus, lights, sides, places, colors, surfaces)
    split = surfaces[:, 2] > 0
    (rows, columns), colors = places[split].T, colors[split].astype(np.float32)
    lamp_defocus, lamp_coverage = surfaces[split, :2].T.astype(np.float32)
    own = defocus[rows, columns]
    is_front = own > lamp_defocus
    front_index = np.where(is_front, 1, 0)
    indices = np.arange(len(rows))
    return MixedPixels(
        rows=rows,
        columns=columns,
        front=colors[indices, front_index],
        back=colors[indices, 1 - front_index],
        near=np.maximum(own, lamp_defocus),
        far=np.minimum(own, lamp_defocus),
        coverage=np.where(is_front, 1 - lamp_coverage, lamp_coverage).astype(np.float32),
        is_front=is_front,
    )
