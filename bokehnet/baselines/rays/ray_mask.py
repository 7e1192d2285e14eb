"""Ray masks of a hybrid of rasteriser and rays: the published edge mask, and a new one.

Source: Tan et al., "A hybrid system for real-time rendering of depth of field effect in games", 2022, after
    thesis 000, 5.0.2 and 5.1.2 (eqs. 5.8 to 5.10), and its future work, 6.0.1.
"""

import numpy as np

from bokehnet.baselines.gather.scatter_as_you_gather import TILE, tile_strategies
from bokehnet.baselines.gather.tiles import dilated_tiles
from bokehnet.checks import check_choice, check_same_size
from bokehnet.classical.error_map import geometric_error_map
from bokehnet.errors import ParameterError

__all__ = ["MASKS", "gaussian", "in_mixed_tiles", "normals_of_depth", "ray_mask", "sobel_magnitude"]

MASKS = ("sobel", "sobel-depth", "reach")

# Five-tap Sobel: smoothing and derivative; the derivative of a unit ramp is 1.
_SMOOTH = np.array([1.0, 4.0, 6.0, 4.0, 1.0]) / 16.0
_SLOPE = np.array([-1.0, -2.0, 0.0, 2.0, 1.0]) / 8.0

# Sigma of the Gaussian against noise before it, pixels.
_DENOISING_SIGMA_PX = 0.7


def _along(values: np.ndarray, kernel: np.ndarray, axis: int) -> np.ndarray:
    """Return weighted sums of neighbours along an axis, border repeated."""
    reach = len(kernel) // 2
    padding = [(reach, reach) if a == axis else (0, 0) for a in range(values.ndim)]
    windows = np.lib.stride_tricks.sliding_window_view(
        np.pad(values, padding, mode="edge"), len(kernel), axis=axis
    )
    summed: np.ndarray = windows @ kernel
    return summed


def gaussian(values: np.ndarray, sigma: float) -> np.ndarray:
    """Return a map (H, W) or (H, W, C) blurred along rows and columns, border repeated."""
    reach = int(4 * sigma + 0.5)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    kernel /= kernel.sum()
    return _along(_along(np.asarray(values, np.float64), kernel, 0), kernel, 1)


def sobel_magnitude(values: np.ndarray) -> np.ndarray:
    """Return the gradient magnitude of a map (H, W) or (H, W, C) over all channels, per pixel, (H, W).

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
    """Return unit normals towards the camera from the depth of the pixels, (H, W, 3).

    Args:
        depth: Depth along the axis, (H, W), finite.
        slope_per_pixel: Difference of the slopes of neighbouring pixels' rays.
    """
    height, width = depth.shape
    x = (np.arange(width) - 0.5 * (width - 1)) * slope_per_pixel
    y = (np.arange(height) - 0.5 * (height - 1)) * slope_per_pixel
    position = np.stack([x[None] * depth, y[:, None] * depth, depth], -1)
    normal = np.cross(np.gradient(position, axis=0), np.gradient(position, axis=1))
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-30)
    return np.where((normal * position).sum(-1, keepdims=True) > 0, -normal, normal)


def in_mixed_tiles(defocus: np.ndarray) -> np.ndarray:
    """Return the mask of pixels of tiles with several depths, (H, W) bool.

    Where a tile and the tiles whose blur reaches it have one depth, within a tenth of the blur, nothing is
    occluded; where nothing is blurred, rays gain nothing: there the post-process suffices.

    Args:
        defocus: Signed blur radius in pixels, (H, W).
    """
    half = np.asarray(defocus) / 2
    nearest, largest = dilated_tiles(half, TILE)
    mixed = tile_strategies(nearest, -dilated_tiles(-half, TILE)[0], largest) > 0
    height, width = half.shape
    return np.asarray(np.repeat(np.repeat(mixed, TILE, 0), TILE, 1)[:height, :width])


def ray_mask(
    kind: str | np.ndarray, normals: np.ndarray, depth: np.ndarray, defocus: np.ndarray, scale: float = 1.0
) -> np.ndarray:
    """Return the fraction of the maximum number of rays for each pixel, (H, W), 0 to 1.

    ``sobel`` is ``1 - 1 / (x + 1)`` with x the gradient of the normals times ``scale``. Two parallel cards
    have the same normals, so it misses the edge between them; and it is five pixels wide for any blur.
    ``sobel-depth`` adds the gradient of the depth, in units of the median depth: it grows with the square of
    the distance, so that distant floors are all edge, for which reason the thesis dropped it. ``reach``,
    which is new here, covers exactly the reach of the blur of depth discontinuities, the only place where the
    post-process can be wrong about occlusion.

    Args:
        kind: One of ``MASKS``, or a map of fractions, (H, W), for example from an expected error.
        normals: Unit normals, (H, W, 3).
        depth: Depth, (H, W).
        defocus: Signed blur radius in pixels, (H, W).
        scale: Parameter s of the publication.

    Raises:
        ParameterError: The kind is unknown, or a fraction is outside 0 to 1.
        ShapeError: The map has another size.
    """
    if isinstance(kind, np.ndarray):
        check_same_size("defocus", defocus, "mask", kind)
        if not ((kind >= 0) & (kind <= 1)).all():
            raise ParameterError("mask", "fractions from 0 to 1", shown=f"{kind.min():g} to {kind.max():g}")
        return np.asarray(kind, np.float64)
    check_choice("mask", kind, MASKS)
    if kind == "reach":
        return np.asarray(geometric_error_map(defocus) > 0, np.float64)
    change = sobel_magnitude(gaussian(normals, _DENOISING_SIGMA_PX))
    if kind == "sobel-depth":
        change = change + sobel_magnitude(gaussian(depth, _DENOISING_SIGMA_PX)) / np.median(depth)
    return np.asarray(1.0 - 1.0 / (1.0 + scale * change))
