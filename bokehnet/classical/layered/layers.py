"""A picture as a stack of layers, front to back: what rays are marched through."""

import math
from collections.abc import Callable
from typing import Any

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

__all__ = ["Layers", "split_layers", "split_picture"]

# Shares of the work when mixed pixels are parted, and when what they hide is filled: for a bar alone.
_PARTED, _FILLED = 0.2, 0.6


@njit(cache=True, parallel=True)
def _lay_backs(rows, columns, back, far, is_last, hidden, behind):  # type: ignore[no-untyped-def]
    """Write the farther surface of mixed pixels to what is hidden, (H, W, ...) in place.

    ``is_last``: whether nothing else is behind that surface, (N,).
    """
    for i in prange(len(rows)):
        y, x = rows[i], columns[i]
        if abs(behind[y, x] - far[i]) <= DISCONTINUITY_THRESHOLD or is_last[i]:
            for c in range(3):
                hidden[y, x, c] = back[i, c]
        if is_last[i]:
            behind[y, x] = far[i]


@njit(cache=True, parallel=True)
def _hide_again(defocus, behind, beyond):  # type: ignore[no-untyped-def]
    """Let nothing be behind what hides nothing, ``beyond`` (H, W) in place; how many pixels are left."""
    left = 0
    for y in prange(beyond.shape[0]):
        for x in range(beyond.shape[1]):
            if behind[y, x] >= defocus[y, x] - DISCONTINUITY_THRESHOLD:
                beyond[y, x] = behind[y, x]
            left += beyond[y, x] < behind[y, x] - DISCONTINUITY_THRESHOLD
    return left


@njit(cache=True, parallel=True)
def _stack(color, defocus, layer, colors, depths, coverage):  # type: ignore[no-untyped-def]
    """Write one layer that covers all, nowhere before the last one, to (H, W, L, ...)."""
    height, width = defocus.shape
    for y in prange(height):
        for x in range(width):
            for c in range(3):
                colors[y, x, layer, c] = color[y, x, c]
            depths[y, x, layer] = defocus[y, x]
            if layer > 0:
                depths[y, x, layer] = min(defocus[y, x], depths[y, x, layer - 1])
            coverage[y, x, layer] = 1.0


@njit(cache=True, parallel=True)
def _lay_fronts(rows, columns, front, share, colors, coverage):  # type: ignore[no-untyped-def]
    """Write colour and coverage of the nearer surface of mixed pixels to (H, W, L, ...) in place."""
    for i in prange(len(rows)):
        y, x = rows[i], columns[i]
        coverage[y, x, 0] = share[i]
        for c in range(3):
            colors[y, x, 0, c] = front[i, c]


def split_layers(
    image: npt.NDArray[np.floating[Any]],
    defocus: npt.NDArray[np.floating[Any]],
    max_coc_radius: int | None = None,
    pixel_filter: PixelFilter = DEFAULT_FILTER,
    known: KnownSurfaces | None = None,
) -> Layers:
    """Make layers of a picture: what is seen, and a guess of what stands behind.

    Soft steps of the defocus are sharpened
    (:func:`bokehnet.classical.layered.depth_discontinuities.sharpen_discontinuities`), pixels at an edge,
    whose colour mixes both sides, are parted (:func:`bokehnet.classical.layered.boundaries.unmixing.unmix`;
    lights by :func:`bokehnet.classical.layered.boundaries.light_carriers.part_lights`), and the occluded
    background is filled from what is left
    (:func:`bokehnet.classical.layered.background.occluded_background.occluded_background`). Where that
    background hides something in turn, as a leaf behind a leaf hides the sky, there is a third layer, filled
    alike: rays that pass both leaves would end nowhere, and what is left of the others would be too much of
        leaves.

    Args:
        image: All-in-focus picture, scene-linear, (H, W, 3).
        defocus: Signed blur radius in pixels, (H, W), + in front of focus.
        max_coc_radius: As for
            :func:`bokehnet.classical.layered.background.occluded_background.occluded_background`.
        pixel_filter: Of the picture.
        known: Surfaces of pixels at edges that need not be estimated.

    Raises:
        ShapeError: Not (H, W, 3) and (H, W) of one size.
        ParameterError: NaN or infinity in either, or known pixels outside.
    """
    return split_picture(image, defocus, max_coc_radius, pixel_filter, known)[0]


def _with_one_behind(mixed: MixedPixels, behind: np.ndarray) -> MixedPixels:
    """Leave out mixed pixels at slight steps that hide something else as well.

    Args:
        mixed: All.
        behind: Defocus of what is hidden, (H, W).
    """
    hides_more = behind[mixed.rows, mixed.columns] < mixed.far - DISCONTINUITY_THRESHOLD
    kept = ~(mixed.is_slight & hides_more)
    return MixedPixels(*(values[kept] for values in mixed))


def _untold(share: float) -> None:
    """Nobody asked."""


def split_picture(
    image: npt.NDArray[np.floating[Any]],
    defocus: npt.NDArray[np.floating[Any]],
    max_coc_radius: int | None = None,
    pixel_filter: PixelFilter = DEFAULT_FILTER,
    known: KnownSurfaces | None = None,
    progress: Callable[[float], None] | None = None,
) -> tuple[Layers, MixedPixels]:
    """Make the layers of :func:`split_layers`, and tell which pixels were parted into which surfaces.

    ``progress`` is called with the share of the work that is done, 0 to 1.
    """
    tell = progress or _untold
    image, defocus = np.asarray(image, np.float32), np.ascontiguousarray(defocus, np.float32)
    reach = math.ceil(float(np.abs(defocus).max())) if max_coc_radius is None else max_coc_radius
    if known is not None:
        known.check_within(*defocus.shape)
    lights = are_lights(image, light_limit(image, reach))
    sharp, mixed = find_mixed_pixels(image, defocus, lights, pixel_filter, known)
    tell(_PARTED)
    own = image.copy()
    own[mixed.rows, mixed.columns] = np.where(mixed.is_front[:, None], mixed.front, mixed.back)
    hidden, behind = occluded_background(own, sharp, reach)
    del own
    mixed = _with_one_behind(mixed, behind)
    is_last = mixed.is_slight | ~mixed.is_front
    with parallel_region:
        _lay_backs(mixed.rows, mixed.columns, mixed.back, mixed.far, is_last, hidden, behind)
    sharp[mixed.rows, mixed.columns] = mixed.near
    tell(_FILLED)
    found = [(image, sharp), (hidden, behind)]
    hides = behind < sharp - DISCONTINUITY_THRESHOLD
    if hides.any():
        deepest, beyond = occluded_background(hidden, behind, reach, hides)
        with parallel_region:
            if _hide_again(sharp, behind, beyond):
                found.append((deepest, beyond))
    colors = np.empty((*sharp.shape, len(found), 3), np.float32)
    depths, coverage = (np.empty((*sharp.shape, len(found)), np.float32) for _ in range(2))
    with parallel_region:
        for layer, (color, depth) in enumerate(found):
            _stack(color, depth, layer, colors, depths, coverage)
        _lay_fronts(mixed.rows, mixed.columns, mixed.front, mixed.coverage, colors, coverage)
    tell(1.0)
    return Layers(colors=colors, defocus=depths, coverage=coverage), mixed
