"""A picture as a stack of layers, front to back: what rays are marched through."""

import math
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import prange

from bokehnet.classical.highlight_detection import are_lights, light_limit
from bokehnet.classical.known_layers import Layers
from bokehnet.classical.known_surfaces import KnownSurfaces
from bokehnet.classical.layered.depth_discontinuities import DISCONTINUITY_THRESHOLD
from bokehnet.classical.layered.mixed_pixels import find_mixed_pixels
from bokehnet.classical.layered.occluded_background import occluded_background
from bokehnet.classical.layered.unmixing import MixedPixels
from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit
from bokehnet.optics.pixel_filter import DEFAULT_FILTER, PixelFilter

__all__ = ["Layers", "split_layers", "split_picture"]


@njit(cache=True, parallel=True)
def _stack(image, defocus, hidden, behind, colors, depths, coverage):  # type: ignore[no-untyped-def]
    """Write what is seen and what is hidden as two layers, (H, W, 2, ...)."""
    height, width = defocus.shape
    for y in prange(height):
        for x in range(width):
            for c in range(3):
                colors[y, x, 0, c], colors[y, x, 1, c] = image[y, x, c], hidden[y, x, c]
            depths[y, x, 0], depths[y, x, 1] = defocus[y, x], min(defocus[y, x], behind[y, x])
            coverage[y, x, 0] = coverage[y, x, 1] = 1.0


@njit(cache=True, parallel=True)
def _lay_mixed(rows, columns, front, back, near, far, share, is_front, colors, depths, coverage):  # type: ignore[no-untyped-def]
    """Lay the nearer surface of mixed pixels over the farther one; layers (H, W, 2, ...) in place."""
    for i in prange(len(rows)):
        y, x = rows[i], columns[i]
        coverage[y, x, 0] = share[i]
        depths[y, x, 0] = near[i]
        one = abs(depths[y, x, 1] - far[i]) <= DISCONTINUITY_THRESHOLD
        for c in range(3):
            colors[y, x, 0, c] = front[i, c]
            if one or not is_front[i]:
                colors[y, x, 1, c] = back[i, c]
        if not is_front[i]:
            depths[y, x, 1] = far[i]


def split_layers(
    image: npt.NDArray[np.floating[Any]],
    defocus: npt.NDArray[np.floating[Any]],
    max_coc_radius: int | None = None,
    pixel_filter: PixelFilter = DEFAULT_FILTER,
    known: KnownSurfaces | None = None,
) -> Layers:
    """Make two layers of a picture: what is seen, and a guess of what stands behind.

    Soft steps of the defocus are sharpened
    (:func:`bokehnet.classical.layered.depth_discontinuities.sharpen_discontinuities`), pixels at an edge,
    whose colour mixes both sides, are parted (:func:`bokehnet.classical.layered.unmixing.unmix`; lights by
    :func:`bokehnet.classical.layered.light_carriers.part_lights`), and the occluded background is filled from
    what is left
    (:func:`bokehnet.classical.layered.occluded_background.occluded_background`).

    Args:
        image: All-in-focus picture, scene-linear, (H, W, 3).
        defocus: Signed blur radius in pixels, (H, W), + in front of focus.
        max_coc_radius: As for :func:`bokehnet.classical.layered.occluded_background.occluded_background`.
        pixel_filter: Of the picture.
        known: Surfaces of pixels at edges that need not be estimated.

    Raises:
        ShapeError: Not (H, W, 3) and (H, W) of one size.
        ParameterError: NaN or infinity in either, or known pixels outside.
    """
    return split_picture(image, defocus, max_coc_radius, pixel_filter, known)[0]


def split_picture(
    image: npt.NDArray[np.floating[Any]],
    defocus: npt.NDArray[np.floating[Any]],
    max_coc_radius: int | None = None,
    pixel_filter: PixelFilter = DEFAULT_FILTER,
    known: KnownSurfaces | None = None,
) -> tuple[Layers, MixedPixels]:
    """Make the layers of :func:`split_layers`, and tell which pixels were parted into which surfaces."""
    image, defocus = np.asarray(image, np.float32), np.ascontiguousarray(defocus, np.float32)
    reach = math.ceil(float(np.abs(defocus).max())) if max_coc_radius is None else max_coc_radius
    if known is not None:
        known.check_within(*defocus.shape)
    lights = are_lights(image, light_limit(image, reach))
    sharp, mixed = find_mixed_pixels(image, defocus, lights, pixel_filter, known)
    own = image.copy()
    own[mixed.rows, mixed.columns] = np.where(mixed.is_front[:, None], mixed.front, mixed.back)
    hidden, behind = occluded_background(own, sharp, reach)
    colors = np.empty((*sharp.shape, 2, 3), np.float32)
    depths, coverage = (np.empty((*sharp.shape, 2), np.float32) for _ in range(2))
    with parallel_region:
        _stack(image, sharp, hidden, behind, colors, depths, coverage)
        _lay_mixed(*mixed, colors, depths, coverage)
    return Layers(colors=colors, defocus=depths, coverage=coverage), mixed
