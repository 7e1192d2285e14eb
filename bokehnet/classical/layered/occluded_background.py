"""What stands behind each foreground: a background, filled from the surroundings that lie farther away."""

import math
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import prange

from bokehnet.classical.base import check_inputs
from bokehnet.classical.highlight_detection import brightest, light_limit
from bokehnet.classical.layered.depth_discontinuities import DISCONTINUITY_THRESHOLD
from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit

__all__ = ["occluded_background"]

# Samples along each side of the window from which a hidden pixel takes its colour.
_TAPS = 7

# A pixel as one number: its row above these bits, its column in them.
_ROW, _COLUMN = 32, 2**32 - 1


@njit(cache=True, parallel=True)
def _at_discontinuities(defocus, source):  # type: ignore[no-untyped-def]
    """Give each pixel that stands before a depth discontinuity its farthest neighbour as source."""
    height, width = defocus.shape
    for y in prange(height):
        for x in range(width):
            lowest = defocus[y, x] - DISCONTINUITY_THRESHOLD
            for v in range(max(0, y - 1), min(height, y + 2)):
                for u in range(max(0, x - 1), min(width, x + 2)):
                    if defocus[v, u] < lowest:
                        lowest = defocus[v, u]
                        source[y, x] = v << _ROW | u


@njit(cache=True)
def _adopt(defocus, source, y, x, v, u):  # type: ignore[no-untyped-def]
    """Let pixel (y, x) take the source of its neighbour (v, u) where that is nearer than its own.

    A ray that passes an edge at defocus f falls at most f - b pixels behind it before it meets b.
    """
    height, width = defocus.shape
    if not (0 <= v < height and 0 <= u < width):
        return
    found, own = source[v, u], source[y, x]
    if found < 0 or found == own:
        return
    a, b = found >> _ROW, found & _COLUMN
    step = defocus[y, x] - defocus[a, b]
    square = (y - a) * (y - a) + (x - b) * (x - b)
    if step <= DISCONTINUITY_THRESHOLD or square > (step + 2.0) ** 2:
        return
    c, d = own >> _ROW, own & _COLUMN
    if own < 0 or square < (y - c) * (y - c) + (x - d) * (x - d):
        source[y, x] = found


@njit(cache=True)
def _carry_inwards(defocus, source):  # type: ignore[no-untyped-def]
    """Give each pixel the nearest source, in two sweeps, each along every row in both directions."""
    height, width = defocus.shape
    for sweep in range(2):
        up = -1 if sweep == 0 else 1
        for line in range(height):
            y = line if sweep == 0 else height - 1 - line
            for x in range(width):
                _adopt(defocus, source, y, x, y + up, x - 1)
                _adopt(defocus, source, y, x, y + up, x)
                _adopt(defocus, source, y, x, y + up, x + 1)
                _adopt(defocus, source, y, x, y, x - 1)
            for x in range(width - 1, -1, -1):
                _adopt(defocus, source, y, x, y, x + 1)


@njit(cache=True, parallel=True)
def _fill(image, defocus, lights, source, colors, depths):  # type: ignore[no-untyped-def]
    """Mean over a window around the source, half as wide as the source is far, of its own surface."""
    height, width = defocus.shape
    for y in prange(height):
        for x in range(width):
            if source[y, x] < 0:
                continue
            a, b = source[y, x] >> _ROW, source[y, x] & _COLUMN
            radius = max(1.0, 0.5 * math.sqrt((y - a) * (y - a) + (x - b) * (x - b)))
            weight = depth = red = green = blue = 0.0
            for i in range(_TAPS):
                v = a + int(round((2.0 * i / (_TAPS - 1) - 1.0) * radius))
                for j in range(_TAPS):
                    u = b + int(round((2.0 * j / (_TAPS - 1) - 1.0) * radius))
                    if not (0 <= v < height and 0 <= u < width):
                        continue
                    if abs(defocus[v, u] - defocus[a, b]) > DISCONTINUITY_THRESHOLD:
                        continue
                    w = 1e-3 if lights[v, u] else 1.0
                    weight += w
                    depth += w * defocus[v, u]
                    red += w * image[v, u, 0]
                    green += w * image[v, u, 1]
                    blue += w * image[v, u, 2]
            colors[y, x, 0], colors[y, x, 1], colors[y, x, 2] = red / weight, green / weight, blue / weight
            depths[y, x] = depth / weight


def occluded_background(
    image: npt.NDArray[np.floating[Any]],
    defocus: npt.NDArray[np.floating[Any]],
    max_coc_radius: int | None = None,
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Guess what stands behind each foreground, as far inwards from its edge as rays can see.

    The nearest surface that ends behind a depth discontinuity is carried on under the foreground at the
    defocus it has there; its colour is averaged over a window that widens with the distance from the edge,
    since what is farther inside is known less. Lights are not carried on: one behind the edge says nothing of
    another.

    Args:
        image: All-in-focus picture, scene-linear, (H, W, 3).
        defocus: Signed blur radius in pixels, (H, W), + in front of focus.
        max_coc_radius: Half-width in pixels of the surroundings that a light outshines; default: the largest
            radius.

    Returns:
        Colours (H, W, 3) and defocus (H, W). Where nothing is hidden they equal the inputs.

    Raises:
        ShapeError: Not (H, W, 3) and (H, W) of one size.
        ParameterError: NaN or infinity in either.

    Source:
        Danielsson, "Euclidean distance mapping", 1980, for the sweeps.
    """
    image, defocus = check_inputs(image, defocus)
    colors, depths = image.copy(), defocus.copy()
    limit = light_limit(
        image, math.ceil(float(np.abs(defocus).max())) if max_coc_radius is None else max_coc_radius
    )
    lights = brightest(image) > limit
    source = np.full(defocus.shape, -1, np.int64)  # the pixel that ends behind a depth discontinuity
    with parallel_region:
        _at_discontinuities(defocus, source)
        _carry_inwards(defocus, source)
        _fill(image, defocus, lights, source, colors, depths)
    filled = brightest(colors)
    y, x = np.nonzero((source >= 0) & (filled > limit))
    colors[y, x] *= (limit[y, x] / filled[y, x])[:, None]
    return colors, depths
