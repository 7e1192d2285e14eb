"""A picture as a stack of layers, front to back: what rays are marched through."""

import math
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np
import numpy.typing as npt
from numba import prange

from bokehnet.checks import check_finite, check_rank
from bokehnet.classical.highlight_detection import brightest, light_limit
from bokehnet.classical.known_surfaces import KnownSurfaces
from bokehnet.classical.layered.depth_discontinuities import DISCONTINUITY_THRESHOLD
from bokehnet.classical.layered.mixed_pixels import find_mixed_pixels
from bokehnet.classical.layered.occluded_background import occluded_background
from bokehnet.classical.layered.unmixing import MixedPixels
from bokehnet.classical.parallel import parallel_region
from bokehnet.errors import ParameterError, ShapeError
from bokehnet.kernels import njit
from bokehnet.optics.pixel_filter import DEFAULT_FILTER, PixelFilter

__all__ = ["Layers", "split_layers", "split_picture"]


@dataclass(frozen=True, kw_only=True, slots=True)
class Layers:
    """Surfaces along each pixel's pinhole ray, front to back.

    Attributes:
        colors: Scene-linear, (H, W, L, 3), float32.
        defocus: Signed blur radius in pixels, + in front of focus, (H, W, L), float32; a layer is never
            in front of the one before.
        coverage: Share of the pixel that a layer covers, (H, W, L), float32 in [0, 1]. 0 where there is
            no surface.

    Raises:
        ShapeError: The sizes do not fit.
        ParameterError: NaN, infinity, coverage outside [0, 1], or layers that are not front to back.
    """

    colors: npt.NDArray[np.float32]
    defocus: npt.NDArray[np.float32]
    coverage: npt.NDArray[np.float32]

    def __post_init__(self) -> None:
        check_rank("layer colours", self.colors, 4, "(H, W, L, 3)")
        for name, array in (("layer defocus", self.defocus), ("layer coverage", self.coverage)):
            check_rank(name, array, 3, "(H, W, L)")
            if array.shape != self.colors.shape[:3]:
                raise ShapeError(
                    f"{name}: expected {self.colors.shape[:3]} as the colours, got {array.shape}"
                )
        if self.colors.shape[3] != 3:
            raise ShapeError(f"layer colours: expected 3 channels, got {self.colors.shape[3]}")
        for name in ("colors", "defocus", "coverage"):
            object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name), np.float32))
        with parallel_region:
            sound = _are_sound(self.colors, self.defocus, self.coverage)
        if not sound:
            self._raise_fault()

    def _raise_fault(self) -> NoReturn:
        for name in ("colors", "defocus", "coverage"):
            check_finite(name, getattr(self, name))
        if self.coverage.min() < 0 or self.coverage.max() > 1:
            found = f"{self.coverage.min():g} to {self.coverage.max():g}"
            raise ParameterError("coverage", "0 to 1", self.coverage, shown=found)
        expected = "layers from front to back"
        raise ParameterError("defocus", expected, self.defocus, shown="one in front of the one before it")


@njit(cache=True, parallel=True)
def _are_sound(colors, defocus, coverage):  # type: ignore[no-untyped-def]
    """Whether all is finite, coverage within 0 to 1 and no layer in front of the one before."""
    height, width, layers = defocus.shape
    faults = 0
    for y in prange(height):
        for x in range(width):
            for layer in range(layers):
                for c in range(3):
                    faults += not math.isfinite(colors[y, x, layer, c])
                faults += not math.isfinite(defocus[y, x, layer])
                faults += not 0.0 <= coverage[y, x, layer] <= 1.0
                faults += layer > 0 and defocus[y, x, layer] > defocus[y, x, layer - 1]
    return faults == 0


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
    lights = brightest(image) > light_limit(image, reach)
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
