"""A picture as a stack of layers, front to back: what rays are marched through."""

import math
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np
import numpy.typing as npt
from numba import prange

from bokehnet.checks import check_finite, check_rank
from bokehnet.classical.layered.depth_discontinuities import (
    BACK,
    DISCONTINUITY_THRESHOLD,
    FRONT,
    discontinuity_sides,
    sharpen_discontinuities,
)
from bokehnet.classical.layered.occluded_background import occluded_background
from bokehnet.classical.parallel import parallel_region
from bokehnet.errors import ParameterError, ShapeError
from bokehnet.kernels import njit

__all__ = ["Layers", "split_layers"]

# Half the width of the window that tells the pure colours of both sides of a depth discontinuity.
_WINDOW = 2

# Squared difference of two colours, as a part of the sum of their squares, below which a mixed pixel says
# little about its coverage.
_REGULARISATION = 0.03

# Coverage below this is left out.
_LEAST_COVERAGE = 0.02


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


@njit(cache=True)
def _pure(image, defocus, sides, y, x, depth, color):  # type: ignore[no-untyped-def]
    """Write the mean colour around (y, x) of the surface at ``depth``, where not mixed; False if none."""
    height, width = defocus.shape
    weight = 0.0
    color[:] = 0.0
    for v in range(max(0, y - _WINDOW), min(height, y + _WINDOW + 1)):
        for u in range(max(0, x - _WINDOW), min(width, x + _WINDOW + 1)):
            if sides[v, u] == 0 and abs(defocus[v, u] - depth) <= DISCONTINUITY_THRESHOLD:
                w = 1.0 / (1.0 + (v - y) * (v - y) + (u - x) * (u - x))
                weight += w
                for c in range(3):
                    color[c] += w * image[v, u, c]
    if weight == 0.0:
        return False
    color /= weight
    return True


@njit(cache=True)
def _purest(image, defocus, y, x, depth, back, color):  # type: ignore[no-untyped-def]
    """Write the colour of a thin thing at ``depth``: of its pixels, the one least like what is behind it."""
    height, width = defocus.shape
    largest = -1.0
    for v in range(max(0, y - _WINDOW), min(height, y + _WINDOW + 1)):
        for u in range(max(0, x - _WINDOW), min(width, x + _WINDOW + 1)):
            if abs(defocus[v, u] - depth) <= DISCONTINUITY_THRESHOLD:
                square = 0.0
                for c in range(3):
                    square += (image[v, u, c] - back[c]) ** 2
                if square > largest:
                    largest = square
                    color[:] = image[v, u]


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
def _split_mixed(image, defocus, sides, colors, depths, coverage):  # type: ignore[no-untyped-def]
    """Part mixed pixels at discontinuities into near and far surface; layers (H, W, 2, ...) in place."""
    height, width = defocus.shape
    for y in prange(height):
        front, back = np.empty(3), np.empty(3)
        for x in range(width):
            side = sides[y, x]
            if side != FRONT and side != BACK:
                continue
            near = far = defocus[y, x]
            for v in range(max(0, y - 1), min(height, y + 2)):
                for u in range(max(0, x - 1), min(width, x + 2)):
                    near = max(near, defocus[v, u]) if side == BACK else near
                    far = min(far, defocus[v, u]) if side == FRONT else far
            if not _pure(image, defocus, sides, y, x, far, back):
                continue
            if not _pure(image, defocus, sides, y, x, near, front):
                _purest(image, defocus, y, x, near, back, front)
            along = across = 0.0
            regularisation = 1e-12
            for c in range(3):
                regularisation += _REGULARISATION * (front[c] * front[c] + back[c] * back[c])
                along += (image[y, x, c] - back[c]) * (front[c] - back[c])
                across += (front[c] - back[c]) * (front[c] - back[c])
            share = (along + (regularisation if side == FRONT else 0.0)) / (across + regularisation)
            if side == FRONT:
                share = min(max(share, 0.5), 1.0)
                coverage[y, x, 0] = share
                for c in range(3):
                    colors[y, x, 0, c] = max(0.0, (image[y, x, c] - (1.0 - share) * back[c]) / share)
            elif share > _LEAST_COVERAGE:
                share = min(share, 0.5)
                coverage[y, x, 0] = share
                depths[y, x, 0] = near
                depths[y, x, 1] = defocus[y, x]
                for c in range(3):
                    colors[y, x, 0, c] = front[c]
                    colors[y, x, 1, c] = max(0.0, (image[y, x, c] - share * front[c]) / (1.0 - share))


def split_layers(
    image: npt.NDArray[np.floating[Any]],
    defocus: npt.NDArray[np.floating[Any]],
    max_coc_radius: int | None = None,
) -> Layers:
    """Make two layers of a picture: what is seen, and a guess of what stands behind.

    Soft steps of the defocus are sharpened
    (:func:`bokehnet.classical.layered.depth_discontinuities.sharpen_discontinuities`), the occluded
    background is filled (:func:`bokehnet.classical.layered.occluded_background.occluded_background`), and
    pixels at an edge, whose colour mixes both sides, are parted: the share of the nearer side follows from
    the pure colours beside the edge, at least one half where the pixel's own depth is the nearer one, at most
    one half otherwise.

    Args:
        image: All-in-focus picture, scene-linear, (H, W, 3).
        defocus: Signed blur radius in pixels, (H, W), + in front of focus.
        max_coc_radius: As for :func:`bokehnet.classical.layered.occluded_background.occluded_background`.

    Raises:
        ShapeError: Not (H, W, 3) and (H, W) of one size.
        ParameterError: NaN or infinity in either.
    """
    image, sharp = (
        np.asarray(image, np.float32),
        sharpen_discontinuities(np.ascontiguousarray(defocus, np.float32)),
    )
    hidden, behind = occluded_background(image, sharp, max_coc_radius)
    colors = np.empty((*sharp.shape, 2, 3), np.float32)
    depths, coverage = (np.empty((*sharp.shape, 2), np.float32) for _ in range(2))
    sides = discontinuity_sides(sharp)
    with parallel_region:
        _stack(image, sharp, hidden, behind, colors, depths, coverage)
        _split_mixed(image, sharp, sides, colors, depths, coverage)
    return Layers(colors=colors, defocus=depths, coverage=coverage)
