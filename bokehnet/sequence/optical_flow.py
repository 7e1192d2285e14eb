"""Dense motion between two pictures by least squares, coarse to fine."""

import numpy as np
import numpy.typing as npt

from bokehnet.arrays.box_mean import box_mean
from bokehnet.arrays.pyramid import crop_to, downsample2, pad_to_multiple, upsample2
from bokehnet.checks import check_image, check_same_size

__all__ = ["coarse_flow", "full_flow", "optical_flow", "warp"]

Array = npt.NDArray[np.float32]

# Longest side at which motion is estimated; it is upsampled from there.
_MAX_SIDE_PX = 640

# Shorter side below which pictures are not halved further.
_MIN_SIDE_PX = 16

# Radius of the windows of constant motion, and the iterations at each size.
_WINDOW_RADIUS_PX, _ITERATIONS = 4, 3

# Regularisation: squared gradient of encoded light below which a window has no texture to track.
_MIN_SQUARED_GRADIENT = 1e-5

_MAX_UPDATE_PX = 1.5  # per iteration

# Reduction of the squared error of encoded light that a flow must gain over a simpler one.
_MIN_ERROR_REDUCTION = 1e-5


def optical_flow(first: Array, second: Array) -> Array:
    """Return the motion of each pixel from one picture to another, (H, W, 2), pixels right and down.

    A point at (x, y) in ``first`` is at (x + u, y + v) in ``second``. Equal pictures have exactly no motion.
    Motion is estimated at a longest side of 640 pixels; objects smaller than a window of 9 pixels at that
    size, and flat surfaces, get the motion of their surroundings.

    Args:
        first: Encoded (perceptually uniform) light, (H, W, 3).
        second: Encoded light of the same size.

    Raises:
        ShapeError: The arrays are not two pictures of one size.

    Source:
        Lucas and Kanade, "An iterative image registration technique with an application to stereo vision",
        IJCAI 1981; Bouguet, "Pyramidal implementation of the Lucas Kanade feature tracker", Intel 2000.

    Examples:
        >>> y, x = np.mgrid[:48, :64].astype(np.float32)
        >>> still = np.repeat((0.5 + 0.2 * np.sin(x / 3) * np.cos(y / 4))[..., None], 3, 2)
        >>> moved = np.repeat((0.5 + 0.2 * np.sin((x - 1) / 3) * np.cos(y / 4))[..., None], 3, 2)
        >>> np.round(np.median(optical_flow(still, moved), (0, 1)), 1).tolist()  # one pixel to the right
        [1.0, 0.0]
    """
    for name, picture in (("first", first), ("second", second)):
        check_image(name, picture)
    check_same_size("first", first, "second", second)
    return full_flow(coarse_flow(first, second), first.shape[:2])


def coarse_flow(first: Array, second: Array) -> Array:
    """Return the motion at the size at which it is estimated, (h, w, 2), pixels of that size.

    The size is that of the pictures, halved until the longest side is at most 640 pixels. See
    :func:`optical_flow` for the arguments.
    """
    sizes = [(_grey(first), _grey(second))]
    while max(sizes[0][0].shape) > _MAX_SIDE_PX:
        sizes[0] = _halves(sizes[0])
    while min(sizes[-1][0].shape) >= 2 * _MIN_SIDE_PX:
        sizes.append(_halves(sizes[-1]))
    flow = np.zeros((*sizes[-1][0].shape, 2), np.float32)
    for source, target in reversed(sizes):
        flow = _upsampled(flow, source.shape)
        for _ in range(_ITERATIONS):
            flow = _updated(source, target, flow)
        flow = _simplified(source, target, flow)
    return flow


def full_flow(flow: Array, shape: tuple[int, ...]) -> Array:
    """Return a coarse flow at the size (H, W) of its pictures, in their pixels."""
    while flow.shape[:2] != tuple(shape):
        above = tuple(-(-side // _factor(shape, flow.shape)) for side in shape)
        flow = _upsampled(flow, above)
    return flow


def warp(values: npt.NDArray[np.floating], flow: Array, first: int = 0) -> Array:
    """Return ``values``, (H, W) or (H, W, C), sampled at the moved pixel positions; bilinear.

    Args:
        values: Values of the entire picture.
        flow: Motion of some of its rows, (h, W, 2), pixels.
        first: Index of the first of these rows.
    """
    height, width = values.shape[:2]
    rows, columns = np.mgrid[first : first + len(flow), :width].astype(np.float32)
    x = np.clip(columns + flow[..., 0], 0, width - 1)
    y = np.clip(rows + flow[..., 1], 0, height - 1)
    left, top = (
        np.minimum(x.astype(np.intp), max(width - 2, 0)),
        np.minimum(y.astype(np.intp), max(height - 2, 0)),
    )
    right, below = np.minimum(left + 1, width - 1), np.minimum(top + 1, height - 1)
    a, b = x - left, y - top
    if values.ndim == 3:
        a, b = a[..., None], b[..., None]
    upper = values[top, left] + a * (values[top, right] - values[top, left])
    lower = values[below, left] + a * (values[below, right] - values[below, left])
    return np.asarray(upper + b * (lower - upper), np.float32)


def _grey(picture: Array) -> Array:
    return np.asarray(picture.mean(2), np.float32)


def _halves(pair: tuple[Array, Array]) -> tuple[Array, Array]:
    first, second = (downsample2(pad_to_multiple(picture, 2)) for picture in pair)
    return first, second


def _factor(above: tuple[int, ...], below: tuple[int, ...]) -> int:
    """Return half the integer ratio of two sizes: the size one doubling below the first."""
    factor = 1
    while -(-above[0] // (2 * factor)) > below[0] or -(-above[1] // (2 * factor)) > below[1]:
        factor *= 2
    return factor


def _upsampled(flow: Array, size: tuple[int, ...]) -> Array:
    """Return flow of half the size, or of this size, at this size."""
    if flow.shape[:2] == tuple(size):
        return flow
    doubled = 2 * upsample2(np.moveaxis(flow, 2, 0))
    return np.ascontiguousarray(np.moveaxis(crop_to(doubled, *size), 0, 2))


def _updated(source: Array, target: Array, flow: Array) -> Array:
    """Return the flow after one iteration of Lucas and Kanade and a 3x3 median."""
    warped = warp(target, flow)
    down, right = np.gradient(0.5 * (source + warped))
    change = source - warped
    products = (right * right, right * down, down * down, right * change, down * change)
    xx, xy, yy, xt, yt = (
        box_mean(np.asarray(product, np.float32), _WINDOW_RADIUS_PX) for product in products
    )
    xx, yy = xx + _MIN_SQUARED_GRADIENT, yy + _MIN_SQUARED_GRADIENT
    determinant = xx * yy - xy * xy
    step = np.stack([yy * xt - xy * yt, xx * yt - xy * xt], 2) / determinant[..., None]
    return _median(flow + np.clip(step, -_MAX_UPDATE_PX, _MAX_UPDATE_PX))


def _median(flow: Array) -> Array:
    height, width = flow.shape[:2]
    padded = np.pad(flow, [(1, 1), (1, 1), (0, 0)], "edge")
    neighbours = [padded[v : v + height, u : u + width] for v in range(3) for u in range(3)]
    return np.asarray(np.median(neighbours, 0), np.float32)


def _simplified(source: Array, target: Array, flow: Array) -> Array:
    """Replace the flow by zero or by the median flow in windows that these explain as well, or better."""
    error = box_mean((source - warp(target, flow)) ** 2, _WINDOW_RADIUS_PX)
    median = np.median(flow, (0, 1)).astype(np.float32)
    for candidate in (np.zeros(2, np.float32), median):
        uniform = np.broadcast_to(candidate, flow.shape)
        uniform_error = box_mean((source - warp(target, uniform)) ** 2, _WINDOW_RADIUS_PX)
        simple = uniform_error <= error + _MIN_ERROR_REDUCTION
        flow = np.where(simple[..., None], uniform, flow)
    return flow
