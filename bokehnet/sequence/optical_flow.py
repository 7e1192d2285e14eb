"""Where the pixels of one picture are in the next: dense motion by least squares, coarse to fine."""

import numpy as np
import numpy.typing as npt

from bokehnet.arrays.pyramid import crop_to, downsample2, pad_to_multiple, upsample2
from bokehnet.checks import check_image, check_same_size

__all__ = ["box_mean", "follow", "optical_flow"]

Array = npt.NDArray[np.float32]

# Longest side at which motion is sought; it is enlarged from there.
_FINEST = 640

# Shorter side below which pictures are not halved further.
_COARSEST = 16

# Half the width of the windows in which motion is one, pixels, and the rounds at each size.
_WINDOW, _ROUNDS = 4, 3

# Squared slope, of encoded light, below which a window has nothing to hold on to.
_FLAT = 1e-5

# No round moves further, pixels.
_FARTHEST_STEP = 1.5

# By how much motion must explain a window better than a simpler one does, squared encoded light.
_REST = 1e-5


def optical_flow(first: Array, second: Array) -> Array:
    """Return how far each pixel of one picture has moved in another, (H, W, 2), pixels right and down.

    What is at (x, y) in ``first`` is at (x + u, y + v) in ``second``. Equal pictures have no motion, exactly.
    Motion is sought at a longest side of 640 pixels; that of things smaller than a window of 9 pixels there,
    or across a flat surface, is that of their surroundings.

    Args:
        first: Encoded light (about evenly spaced to the eye), (H, W, 3).
        second: Likewise, of the same size.

    Raises:
        ShapeError: Not two pictures of one size.

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
    sizes = [(_grey(first), _grey(second))]
    while max(sizes[0][0].shape) > _FINEST:
        sizes[0] = _halves(sizes[0])
    while min(sizes[-1][0].shape) >= 2 * _COARSEST:
        sizes.append(_halves(sizes[-1]))
    flow = np.zeros((*sizes[-1][0].shape, 2), np.float32)
    for here, there in reversed(sizes):
        flow = _fitted(flow, here.shape)
        for _ in range(_ROUNDS):
            flow = _improved(here, there, flow)
        flow = _simplest(here, there, flow)
    while flow.shape[:2] != first.shape[:2]:
        above = tuple(-(-side // _factor(first.shape, flow.shape)) for side in first.shape[:2])
        flow = _fitted(flow, above)
    return flow


def follow(values: npt.NDArray[np.floating], flow: Array, first: int = 0) -> Array:
    """Return what of ``values``, (H, W) or (H, W, C), is where pixels have moved; bilinear.

    Args:
        values: Of the whole picture.
        flow: Of some of its rows, (h, W, 2).
        first: Of these rows.
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


def box_mean(values: Array, radius: int) -> Array:
    """Mean over the square window around each pixel of (H, W), the border repeated."""
    size = 2 * radius + 1
    for axis in (0, 1):
        around = [(radius + 1, radius) if a == axis else (0, 0) for a in (0, 1)]
        padded = np.pad(values, around, "edge").astype(np.float64)
        padded[(slice(0, 1), slice(None)) if axis == 0 else (slice(None), slice(0, 1))] = 0
        sums = np.moveaxis(padded.cumsum(axis), axis, 0)
        values = np.moveaxis((sums[size:] - sums[:-size]) / size, 0, axis).astype(np.float32)
    return values


def _grey(picture: Array) -> Array:
    return np.asarray(picture.mean(2), np.float32)


def _halves(pair: tuple[Array, Array]) -> tuple[Array, Array]:
    first, second = (downsample2(pad_to_multiple(picture, 2)) for picture in pair)
    return first, second


def _factor(above: tuple[int, ...], below: tuple[int, ...]) -> int:
    """Half the whole number of times that one size is the other: the size one doubling below the first."""
    factor = 1
    while -(-above[0] // (2 * factor)) > below[0] or -(-above[1] // (2 * factor)) > below[1]:
        factor *= 2
    return factor


def _fitted(flow: Array, size: tuple[int, ...]) -> Array:
    """Motion found at half the size, or at this one."""
    if flow.shape[:2] == tuple(size):
        return flow
    doubled = 2 * upsample2(np.moveaxis(flow, 2, 0))
    return np.ascontiguousarray(np.moveaxis(crop_to(doubled, *size), 0, 2))


def _improved(here: Array, there: Array, flow: Array) -> Array:
    """One round of Lucas and Kanade, and the median of each 3x3 pixels."""
    moved = follow(there, flow)
    down, right = np.gradient(0.5 * (here + moved))
    change = here - moved
    products = (right * right, right * down, down * down, right * change, down * change)
    xx, xy, yy, xt, yt = (box_mean(np.asarray(product, np.float32), _WINDOW) for product in products)
    xx, yy = xx + _FLAT, yy + _FLAT
    determinant = xx * yy - xy * xy
    step = np.stack([yy * xt - xy * yt, xx * yt - xy * xt], 2) / determinant[..., None]
    return _median(flow + np.clip(step, -_FARTHEST_STEP, _FARTHEST_STEP))


def _median(flow: Array) -> Array:
    height, width = flow.shape[:2]
    padded = np.pad(flow, [(1, 1), (1, 1), (0, 0)], "edge")
    around = [padded[v : v + height, u : u + width] for v in range(3) for u in range(3)]
    return np.asarray(np.median(around, 0), np.float32)


def _simplest(here: Array, there: Array, flow: Array) -> Array:
    """Where a window is explained as well, none, or better that of most of the picture."""
    seen = box_mean((here - follow(there, flow)) ** 2, _WINDOW)
    most = np.median(flow, (0, 1)).astype(np.float32)
    for simpler in (np.zeros(2, np.float32), most):
        uniform = np.broadcast_to(simpler, flow.shape)
        plain = box_mean((here - follow(there, uniform)) ** 2, _WINDOW) <= seen + _REST
        flow = np.where(plain[..., None], uniform, flow)
    return flow
