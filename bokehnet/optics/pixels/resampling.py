"""Resampling of pictures at fractional pixel positions."""

import numpy as np
import numpy.typing as npt

from bokehnet.checks import Array, array_namespace
from bokehnet.kernels import njit

__all__ = ["bilinear", "inside", "sample"]


def sample(image: Array, places: Array) -> Array:
    """Return a picture at fractional pixel positions by cubic convolution; repeats border pixels outside.

    Along rows, then along columns, the cubic is clamped between the two central values: without that
    it would draw dark rings around lamps, and light below 0. The result is continuous in ``places``, and
    equals the pixel at pixel centres.

    Args:
        image: (..., H, W, C), array or tensor, then differentiable with respect to both arguments; for a
            batch (B, C, H, W) use ``movedim(1, -1)``.
        places: Positions, (..., 2), x right and y down in pixels, 0 at the centre of the first pixel; array
            or tensor like ``image``.

    Returns:
        (..., C): the leading axes of ``image``, then those of ``places``.

    Source:
        Keys, "Cubic convolution interpolation for digital image processing", 1981.
    """
    xp = array_namespace(image)
    height, width, channels = image.shape[-3:]
    flat = image.reshape(*image.shape[:-3], height * width, channels)
    first_x, weights_x = _taps(places[..., 0], width, image.dtype)
    first_y, weights_y = _taps(places[..., 1], height, image.dtype)
    columns = [xp.clip(first_x + i, 0, width - 1) for i in range(4)]
    rows = []
    for j in range(4):
        start = xp.clip(first_y + j, 0, height - 1) * width
        pixels = [_take(flat, start + column) for column in columns]
        rows.append(_blend(pixels, weights_x))
    return _blend(rows, weights_y)


def bilinear(
    values: np.ndarray, rows: np.ndarray, columns: np.ndarray, dtype: npt.DTypeLike = np.float64
) -> np.ndarray:
    """Return NumPy values at fractional positions by bilinear interpolation.

    Args:
        values: (..., H, W).
        rows: Positions downwards, pixels, 0 to H - 1, any shape; 0 is the centre of the first row.
        columns: Positions to the right, pixels, 0 to W - 1, the same shape.
        dtype: Type of the weights.

    Returns:
        The leading axes of ``values``, then those of the positions.
    """
    shape = rows.shape
    planes = np.ascontiguousarray(values).reshape(-1, *values.shape[-2:])
    rows, columns = (np.ascontiguousarray(x, np.float64).ravel() for x in (rows, columns))
    top, left = rows.astype(np.int64), columns.astype(np.int64)
    y, x = (rows - top).astype(dtype), (columns - left).astype(dtype)
    result = np.empty((len(planes), rows.size), np.result_type(planes, y))
    _blend_neighbors(planes, top, left, y, x, result)
    return result.reshape((*values.shape[:-2], *shape))


@njit(cache=True)
def _blend_neighbors(planes, top, left, y, x, result):  # type: ignore[no-untyped-def]
    """Write the mean of four pixels of (C, H, W) with the weights ``y`` and ``x``, (N,), to (C, N)."""
    one, height, width = np.float32(1), planes.shape[1], planes.shape[2]
    for i in range(top.size):
        bottom, right = min(top[i] + 1, height - 1), min(left[i] + 1, width - 1)
        for c in range(planes.shape[0]):
            upper = planes[c, top[i], left[i]] * (one - x[i]) + planes[c, top[i], right] * x[i]
            lower = planes[c, bottom, left[i]] * (one - x[i]) + planes[c, bottom, right] * x[i]
            result[c, i] = upper * (one - y[i]) + lower * y[i]


def inside(places: Array, height: int, width: int) -> Array:
    """Return a soft mask of the positions (..., 2) on a picture: 1 up to the border pixels, 0 a pixel on."""
    xp = array_namespace(places)
    x, y = places[..., 0], places[..., 1]
    across = xp.clip(x + 1, 0, 1) * xp.clip(width - x, 0, 1)
    return across * xp.clip(y + 1, 0, 1) * xp.clip(height - y, 0, 1)


def _taps(place: Array, size: int, dtype: object) -> tuple[Array, tuple[Array, ...]]:
    """Return the first of four pixels around ``place`` (...,), and four weights (cubic with a = -1/2)."""
    xp = array_namespace(place)
    place = xp.clip(place, -2.0, size + 1.0)  # an infinite position has no pixel
    floor = xp.floor(place)
    t = place - floor
    whole = floor.astype(xp.int64) if xp is np else floor.long()
    square, rest = t * t, 1 - t
    weights = (
        -0.5 * t * rest * rest,
        1 + square * (1.5 * t - 2.5),
        1 + rest * rest * (1.5 * rest - 2.5),
        -0.5 * square * rest,
    )
    if xp is np:
        return whole - 1, tuple(weight.astype(dtype) for weight in weights)
    return whole - 1, tuple(weight.to(dtype) for weight in weights)


def _take(flat: Array, index: Array) -> Array:
    """Return pixels of a picture (..., N, C), flattened to one row, by their indices (...,)."""
    pixels = (
        flat.take(index.reshape(-1), -2) if array_namespace(flat) is np else flat[..., index.reshape(-1), :]
    )
    return pixels.reshape(*flat.shape[:-2], *index.shape, flat.shape[-1])


def _blend(values: list[Array], weights: tuple[Array, ...]) -> Array:
    """Return the cubic of four values (..., C) with ``weights`` (...,), clamped between the middle two."""
    xp = array_namespace(values[0])
    total = sum(value * weight[..., None] for value, weight in zip(values, weights, strict=True))
    low, high = xp.minimum(values[1], values[2]), xp.maximum(values[1], values[2])
    return xp.minimum(xp.maximum(total, low), high)
