"""Where a hybrid of rasteriser and rays sends its rays: the published edge mask, and one of ours.

Source: Tan et al., "A hybrid system for real-time rendering of depth of field effect in games", 2022, as
thesis 000 gives it, 5.0.2 and 5.1.2 (eqs. 5.8 to 5.10), and what it leaves for later, 6.0.1.
"""

import numpy as np

from bokehnet.baselines.gather.scatter_as_you_gather import TILE, tile_ways
from bokehnet.baselines.gather.tiles import dilated_tiles
from bokehnet.checks import check_choice, check_same_size
from bokehnet.classical.error_map import geometric_error_map
from bokehnet.errors import ParameterError

__all__ = ["MASKS", "gaussian", "in_mixed_tiles", "normals_of_depth", "ray_mask", "sobel_magnitude"]

MASKS = ("sobel", "sobel-depth", "reach")

# Five-tap Sobel: smoothing and derivative, the latter of a ramp of one per pixel 1.
_SMOOTH = np.array([1.0, 4.0, 6.0, 4.0, 1.0]) / 16.0
_SLOPE = np.array([-1.0, -2.0, 0.0, 2.0, 1.0]) / 8.0

# Gaussian blur before it, against noise, pixels.
_NOISE = 0.7


def _along(values: np.ndarray, kernel: np.ndarray, axis: int) -> np.ndarray:
    """Weighted sums of neighbours along an axis, the border's values beyond it."""
    reach = len(kernel) // 2
    padding = [(reach, reach) if a == axis else (0, 0) for a in range(values.ndim)]
    windows = np.lib.stride_tricks.sliding_window_view(
        np.pad(values, padding, mode="edge"), len(kernel), axis=axis
    )
    summed: np.ndarray = windows @ kernel
    return summed


def gaussian(values: np.ndarray, sigma: float) -> np.ndarray:
    """A map (H, W) or (H, W, C) blurred along rows and columns, the border's values beyond it."""
    reach = int(4 * sigma + 0.5)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    kernel /= kernel.sum()
    return _along(_along(np.asarray(values, np.float64), kernel, 0), kernel, 1)


def sobel_magnitude(values: np.ndarray) -> np.ndarray:
    """Length of the gradient of a map (H, W) or (H, W, C), over all channels, per pixel, (H, W).

    Source:
        Sobel and Feldman, 1968, at 5 x 5.
    """
    channels = np.atleast_3d(np.asarray(values, np.float64))
    total = np.zeros(channels.shape[:2])
    for channel in np.moveaxis(channels, 2, 0):
        for axis in (0, 1):
            total += _along(_along(channel, _SLOPE, axis), _SMOOTH, 1 - axis) ** 2
    return np.sqrt(total)


def normals_of_depth(depth: np.ndarray, slope_per_pixel: float) -> np.ndarray:
    """Normals towards the camera from the depth of the pixels, (H, W, 3), of length 1.

    Args:
        depth: Along the axis, (H, W), finite.
        slope_per_pixel: Slope of a pixel's ray more than its neighbour's.
    """
    height, width = depth.shape
    x = (np.arange(width) - 0.5 * (width - 1)) * slope_per_pixel
    y = (np.arange(height) - 0.5 * (height - 1)) * slope_per_pixel
    place = np.stack([x[None] * depth, y[:, None] * depth, depth], -1)
    normal = np.cross(np.gradient(place, axis=0), np.gradient(place, axis=1))
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-30)
    return np.where((normal * place).sum(-1, keepdims=True) > 0, -normal, normal)


def in_mixed_tiles(defocus: np.ndarray) -> np.ndarray:
    """Pixels of tiles that hold several depths, (H, W) bool.

    Where a tile and those whose blur reaches it have one depth, within a tenth of the blur, nothing hides
    anything, and where nothing is blurred rays bring nothing: there the post-process will do.

    Args:
        defocus: Signed blur radius in pixels, (H, W).
    """
    half = np.asarray(defocus) / 2
    nearest, largest = dilated_tiles(half, TILE)
    mixed = tile_ways(nearest, -dilated_tiles(-half, TILE)[0], largest) > 0
    height, width = half.shape
    return np.asarray(np.repeat(np.repeat(mixed, TILE, 0), TILE, 1)[:height, :width])


def ray_mask(
    kind: str | np.ndarray, normals: np.ndarray, depth: np.ndarray, defocus: np.ndarray, scale: float = 1.0
) -> np.ndarray:
    """Share of the most rays of a pixel that it asks for, (H, W), 0 to 1.

    ``sobel`` is ``1 - 1 / (x + 1)`` with x the gradient of the normals times ``scale``. Two cards one before
    the other have the same normals, so it is blind to the edge between them; and it is five pixels wide,
    however wide the blur. ``sobel-depth`` adds the gradient of the depth, in units of the depth in the
    picture's middle: it grows with the square of the distance, so that far floors are all edge, for which the
    thesis dropped it. ``reach``, ours, takes all that the blur of a depth discontinuity reaches, and nothing
    else: there only can the post-process be wrong about what hides what.

    Args:
        kind: One of ``MASKS``, or shares of one's own, (H, W), as an expected error gives them.
        normals: Of length 1, (H, W, 3).
        depth: (H, W).
        defocus: Signed blur radius in pixels, (H, W).
        scale: The published s.

    Raises:
        ParameterError: Another kind, or shares outside 0 to 1.
        ShapeError: Shares of another size.
    """
    if isinstance(kind, np.ndarray):
        check_same_size("defocus", defocus, "mask", kind)
        if not ((kind >= 0) & (kind <= 1)).all():
            raise ParameterError("mask", "shares from 0 to 1", shown=f"{kind.min():g} to {kind.max():g}")
        return np.asarray(kind, np.float64)
    check_choice("mask", kind, MASKS)
    if kind == "reach":
        return np.asarray(geometric_error_map(defocus) > 0, np.float64)
    change = sobel_magnitude(gaussian(normals, _NOISE))
    if kind == "sobel-depth":
        change = change + sobel_magnitude(gaussian(depth, _NOISE)) / np.median(depth)
    return np.asarray(1.0 - 1.0 / (1.0 + scale * change))
