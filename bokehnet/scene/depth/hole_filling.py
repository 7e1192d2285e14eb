"""Fill pixels without data of a disparity map along the surfaces that the picture shows.

Method: each pixel without data takes the value of the nearest pixel with data, by a distance that grows
across colour edges of the picture (P. Toivanen, "New geodesic distance transforms for gray-scale images",
Pattern Recognition Letters, 1996, two raster scans until nothing changes). Between values of one surface the
result is then interpolated by Gauss-Seidel relaxation of Laplace's equation with weights by colour (Levin,
Lischinski and Weiss, "Colorization using optimization", SIGGRAPH 2004), never across a step of disparity.

In: a map (H, W) with NaN, and the picture. Out: the map without NaN, its other values unchanged.
"""

import numpy as np
import numpy.typing as npt

from bokehnet.arrays.resample import resample, same_aspect
from bokehnet.io.color.srgb import linear_to_srgb
from bokehnet.kernels import njit

__all__ = ["fill_holes"]

Array = npt.NDArray[np.float32]

# Distance in pixels that a colour difference of 1, sRGB, Euclidean, adds; differences below the threshold are
# noise and texture.
_PX_PER_COLOR, _MIN_COLOR_DIFFERENCE = 100.0, 0.03

# Maximum number of pairs of raster scans; each reaches around one more bend of a colour edge.
_MAX_SCANS = 16

# Relaxation: sweeps, over-relaxation, and the step of disparity that separates surfaces, as a fraction of the
# range between the 2nd and the 98th percentile.
_SWEEPS, _OVER_RELAXATION, _MAX_STEP = 60, 1.7, 0.05


def fill_holes(values: Array, image: Array | None = None) -> Array:
    """Return a map whose NaN are filled along the surfaces of the picture.

    Args:
        values: Disparity, (H, W), NaN where there are no data; at least one value is finite.
        image: Scene-linear picture, (h, w, 3), of the same view; None fills by distance alone.

    Examples:
        >>> values = np.array([[0.2, np.nan, np.nan, 0.8]], np.float32)
        >>> image = np.array([[[0.1] * 3, [0.1] * 3, [0.7] * 3, [0.7] * 3]], np.float32)
        >>> fill_holes(values, image).round(2).tolist()
        [[0.20000000298023224, 0.20000000298023224, 0.800000011920929, 0.800000011920929]]
    """
    known = np.isfinite(values)
    if known.all():
        return values
    colors = _guide(image, *values.shape)
    filled = np.where(known, values, 0).astype(np.float32)
    _take_nearest(filled, known, colors)
    low, high = np.percentile(values[known], (2, 98))
    _relax(filled, known, colors, float(_MAX_STEP * (high - low)))
    return filled


def _guide(image: Array | None, height: int, width: int) -> Array:
    """Return the colours of the picture at the size of the map, sRGB, (H, W, 3); 0 without a picture."""
    if image is None or not same_aspect(image.shape, (height, width)):
        return np.zeros((height, width, 3), np.float32)
    image = linear_to_srgb(np.clip(image, 0, 1)).astype(np.float32)
    if image.shape[:2] == (height, width):
        return np.ascontiguousarray(image)
    smaller = height < image.shape[0]
    return np.ascontiguousarray(resample(image, height, width, "area" if smaller else "linear"))


@njit(cache=True)
def _color_distance(colors, y, x, b, a):
    """Return the Euclidean distance of two colours above the noise."""
    total = np.float32(0)
    for c in range(3):
        difference = colors[y, x, c] - colors[b, a, c]
        total += difference * difference
    return max(np.float32(0), np.sqrt(total) - np.float32(_MIN_COLOR_DIFFERENCE))


@njit(cache=True)
def _take_nearest(values: Array, known: npt.NDArray[np.bool_], colors: Array) -> None:
    """Write the value of the nearest known pixel into each unknown one, (H, W)."""
    height, width = values.shape
    distance = np.empty((height, width), np.float32)
    for y in range(height):
        for x in range(width):
            distance[y, x] = 0.0 if known[y, x] else np.inf
    for _ in range(_MAX_SCANS):
        changed = False
        for direction in (1, -1):
            for row in range(height):
                y = row if direction == 1 else height - 1 - row
                for column in range(width):
                    x = column if direction == 1 else width - 1 - column
                    if known[y, x]:
                        continue
                    for neighbour in range(4):
                        b = y if neighbour == 0 else y - direction
                        a = x - direction if neighbour == 0 else x + neighbour - 2
                        if b < 0 or b >= height or a < 0 or a >= width or distance[b, a] == np.inf:
                            continue
                        length = np.float32(1.0) if b == y or a == x else np.float32(1.4142135)
                        step = length + np.float32(_PX_PER_COLOR) * _color_distance(colors, y, x, b, a)
                        if distance[b, a] + step < distance[y, x]:
                            distance[y, x] = distance[b, a] + step
                            values[y, x] = values[b, a]
                            changed = True
        if not changed:
            break


@njit(cache=True)
def _relax(values: Array, known: npt.NDArray[np.bool_], colors: Array, max_step: float) -> None:
    """Interpolate the unknown pixels of each surface, (H, W), in place."""
    height, width = values.shape
    for _ in range(_SWEEPS):
        for y in range(height):
            for x in range(width):
                if known[y, x]:
                    continue
                total, weights = 0.0, 0.0
                for neighbour in range(4):
                    b = y + (neighbour == 0) - (neighbour == 1)
                    a = x + (neighbour == 2) - (neighbour == 3)
                    if b < 0 or b >= height or a < 0 or a >= width:
                        continue
                    if abs(values[b, a] - values[y, x]) > max_step:
                        continue
                    weight = 1.0 / (1.0 + _PX_PER_COLOR * _color_distance(colors, y, x, b, a))
                    total += weight * values[b, a]
                    weights += weight
                if weights > 0.0:
                    change = total / weights - values[y, x]
                    values[y, x] += np.float32(_OVER_RELAXATION * change)
