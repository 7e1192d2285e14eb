"""Conversion of a picture to a stack of layers, front to back, through which rays are marched."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from numba import prange

from bokehnet.classical.highlight_detection import are_lights, light_limit
from bokehnet.classical.known_layers import Layers
from bokehnet.classical.known_surfaces import KnownSurfaces
from bokehnet.classical.layered.background.occluded_background import occluded_background
from bokehnet.classical.layered.boundaries.mixed_pixels import find_mixed_pixels
from bokehnet.classical.layered.boundaries.unmixing import MixedPixels
from bokehnet.classical.layered.depth_discontinuities import DISCONTINUITY_THRESHOLD
from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit
from bokehnet.optics.pixels.pixel_filter import DEFAULT_FILTER, PixelFilter

__all__ = ["Layers", "RaysWindow", "SplitPicture", "split_layers", "split_picture"]

# Completed fraction of the work after unmixing and after the background is filled, for a progress bar only.
_UNMIXED_FRACTION, _FILLED_FRACTION = 0.2, 0.6


@njit(cache=True, parallel=True)
def _insert_backs(rows, columns, back, far, is_last, hidden, behind):
    """Write the farther surface of mixed pixels to the occluded background, (H, W, ...) in place.

    ``is_last``: True where no other surface is behind that surface, (N,).
    """
    for i in prange(len(rows)):
        y, x = rows[i], columns[i]
        if abs(behind[y, x] - far[i]) <= DISCONTINUITY_THRESHOLD or is_last[i]:
            for c in range(3):
                hidden[y, x, c] = back[i, c]
        if is_last[i]:
            behind[y, x] = far[i]


@njit(cache=True, parallel=True)
def _remove_shallow_layer(defocus, behind, beyond):
    """Set ``beyond``, (H, W), to ``behind`` where that occludes nothing; return the number of the others."""
    left = 0
    for y in prange(beyond.shape[0]):
        for x in range(beyond.shape[1]):
            if behind[y, x] >= defocus[y, x] - DISCONTINUITY_THRESHOLD:
                beyond[y, x] = behind[y, x]
            left += beyond[y, x] < behind[y, x] - DISCONTINUITY_THRESHOLD
    return left


@njit(cache=True, parallel=True)
def _write_layer(color, defocus, top, left, layer, colors, depths, coverage):
    """Write the window of one opaque layer from row ``top`` and column ``left`` on to (h, w, L, ...).

    It is nowhere in front of the previous one.
    """
    height, width = depths.shape[:2]
    for y in prange(height):
        for x in range(width):
            for c in range(3):
                colors[y, x, layer, c] = color[top + y, left + x, c]
            depths[y, x, layer] = defocus[top + y, left + x]
            if layer > 0:
                depths[y, x, layer] = min(depths[y, x, layer], depths[y, x, layer - 1])
            coverage[y, x, layer] = 1.0


class RaysWindow(NamedTuple):
    """Window of a picture that rays can reach.

    Attributes:
        rows: Rows, a slice with both ends.
        columns: Columns, a slice with both ends.
        rays_mask: Pixels of the window that send rays, (h, w).
    """

    rows: slice
    columns: slice
    rays_mask: npt.NDArray[np.bool_]


class SplitPicture(NamedTuple):
    """Layers of a window of a picture.

    Attributes:
        layers: Layers, (h, w, L, ...).
        mixed: Mixed pixels of the window with their surfaces.
        light_limit: Brightness above which pixels of the first layer are lights, (h, w).
    """

    layers: Layers
    mixed: MixedPixels
    light_limit: npt.NDArray[np.float32]


def split_layers(
    image: npt.NDArray[np.floating[Any]],
    defocus: npt.NDArray[np.floating[Any]],
    max_coc_radius: int | None = None,
    pixel_filter: PixelFilter = DEFAULT_FILTER,
    known: KnownSurfaces | None = None,
) -> Layers:
    """Convert a picture to layers: the visible picture and an estimate of the occluded background.

    Soft steps of the defocus are sharpened
    (:func:`bokehnet.classical.layered.depth_discontinuities.sharpen_discontinuities`); pixels at an edge,
    whose color mixes both sides, are unmixed (:func:`bokehnet.classical.layered.boundaries.unmixing.unmix`;
    lights by :func:`bokehnet.classical.layered.boundaries.light_carriers.split_lights`); the occluded
    background is filled from the rest
    (:func:`bokehnet.classical.layered.background.occluded_background.occluded_background`). Where that
    background occludes another surface, as a leaf behind a leaf occludes the sky, a third layer is filled in
    the same way: otherwise rays that pass both leaves would end nowhere, and the mean of the other rays would
    contain too much of the leaves.

    Args:
        image: All-in-focus picture, scene-linear, (H, W, 3).
        defocus: Signed blur radius in pixels, (H, W), + in front of focus.
        max_coc_radius: See
            :func:`bokehnet.classical.layered.background.occluded_background.occluded_background`.
        pixel_filter: Pixel filter of the picture.
        known: Known surfaces of pixels at edges, which are not estimated.

    Raises:
        ShapeError: The arrays are not (H, W, 3) and (H, W) of the same size.
        ParameterError: NaN or infinity in either, or known pixels outside the picture.
    """
    return split_picture(image, defocus, max_coc_radius, pixel_filter, known).layers


def _with_one_behind(mixed: MixedPixels, behind: np.ndarray) -> MixedPixels:
    """Remove mixed pixels at slight steps that occlude a further surface.

    Args:
        mixed: All mixed pixels.
        behind: Defocus of the occluded background, (H, W).
    """
    hides_more = behind[mixed.rows, mixed.columns] < mixed.far - DISCONTINUITY_THRESHOLD
    kept = ~(mixed.is_slight & hides_more)
    return MixedPixels(*(values[kept] for values in mixed))


def _ignore_fraction(fraction: float) -> None:
    """Progress callback that does nothing."""


def _part(mixed: MixedPixels, rows: slice, columns: slice) -> MixedPixels:
    """Return the mixed pixels of a window, with rows and columns counted from its first."""
    inside = (mixed.rows >= rows.start) & (mixed.rows < rows.stop)
    inside &= (mixed.columns >= columns.start) & (mixed.columns < columns.stop)
    part = MixedPixels(*(values[inside] for values in mixed))
    return part._replace(rows=part.rows - rows.start, columns=part.columns - columns.start)


def split_picture(
    image: npt.NDArray[np.floating[Any]],
    defocus: npt.NDArray[np.floating[Any]],
    max_coc_radius: int | None = None,
    pixel_filter: PixelFilter = DEFAULT_FILTER,
    known: KnownSurfaces | None = None,
    progress: Callable[[float], None] | None = None,
    window: RaysWindow | None = None,
) -> SplitPicture:
    """Return the layers of :func:`split_layers` in a window of the picture, by default all of it.

    ``progress`` receives the completed fraction of the work, 0 to 1. Where no rays of the window arrive, the
    occluded background is only a mean of its surroundings.
    """
    report = progress or _ignore_fraction
    image, defocus = (np.ascontiguousarray(array, np.float32) for array in (image, defocus))
    reach = math.ceil(float(np.abs(defocus).max())) if max_coc_radius is None else max_coc_radius
    if known is not None:
        known.check_within(*defocus.shape)
    rows, columns, rays_mask = slice(0, len(image)), slice(0, image.shape[1]), None
    if window is not None:
        rows, columns, rays_mask = window.rows, window.columns, np.zeros(defocus.shape, np.bool_)
        rays_mask[rows, columns] = window.rays_mask
    lights = are_lights(image, light_limit(image, reach))
    sharp, mixed = find_mixed_pixels(image, defocus, lights, pixel_filter, known)
    del lights
    report(_UNMIXED_FRACTION)
    own = image.copy()
    own[mixed.rows, mixed.columns] = np.where(mixed.is_front[:, None], mixed.front, mixed.back)
    hidden, behind = occluded_background(own, sharp, reach, rays_mask=rays_mask)
    del own
    mixed = _with_one_behind(mixed, behind)
    is_last = mixed.is_slight | ~mixed.is_front
    with parallel_region:
        _insert_backs(mixed.rows, mixed.columns, mixed.back, mixed.far, is_last, hidden, behind)
    sharp[mixed.rows, mixed.columns] = mixed.near
    report(_FILLED_FRACTION)
    beyond: list[tuple[np.ndarray, np.ndarray]] = []
    hides = behind < sharp - DISCONTINUITY_THRESHOLD
    if hides.any():
        beyond = [occluded_background(hidden, behind, reach, hides, rays_mask)]
        with parallel_region:
            if not _remove_shallow_layer(sharp, behind, beyond[0][1]):
                beyond.clear()
    del hides
    first = image.copy()
    first[mixed.rows, mixed.columns] = mixed.front
    limit = light_limit(first, reach)
    surfaces = [(first, sharp), (hidden, behind), *beyond]
    shape = (rows.stop - rows.start, columns.stop - columns.start, len(surfaces))
    colors = np.empty((*shape, 3), np.float32)
    depths, coverage = (np.empty(shape, np.float32) for _ in range(2))
    with parallel_region:
        for layer, (color, depth) in enumerate(surfaces):
            _write_layer(color, depth, rows.start, columns.start, layer, colors, depths, coverage)
    mixed = _part(mixed, rows, columns)
    coverage[mixed.rows, mixed.columns, 0] = mixed.coverage
    report(1.0)
    layers = Layers(colors=colors, defocus=depths, coverage=coverage)
    return SplitPicture(layers, mixed, np.ascontiguousarray(limit[rows, columns]))
