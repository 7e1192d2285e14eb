"""Layers of a picture, front to back, estimated or known, through which rays are marched."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NoReturn

import numpy as np
import numpy.typing as npt
from numba import prange

from bokehnet.checks import check_finite, check_rank
from bokehnet.classical.parallel import parallel_region
from bokehnet.deprecation import earlier_name
from bokehnet.errors import ParameterError, ShapeError
from bokehnet.kernels import njit

__all__ = ["Layers"]


@dataclass(frozen=True, kw_only=True, slots=True)
class Layers:
    """Surfaces along each pixel's pinhole ray, front to back.

    Attributes:
        colors: Scene-linear colors, (H, W, L, 3), float32.
        defocus: Signed blur radius in pixels, + in front of focus, (H, W, L), float32; a layer is never
            in front of the previous one.
        coverage: Fraction of the pixel that the layer covers, (H, W, L), float32 in [0, 1]. 0 where there is
            no surface.

    Raises:
        ShapeError: The sizes do not fit.
        ParameterError: NaN, infinity, coverage outside [0, 1], or layers that are not front to back.
    """

    colors: npt.NDArray[np.float32]
    defocus: npt.NDArray[np.float32]
    coverage: npt.NDArray[np.float32]

    def __post_init__(self) -> None:
        check_rank("layer colors", self.colors, 4, "(H, W, L, 3)")
        for name, array in (("layer defocus", self.defocus), ("layer coverage", self.coverage)):
            check_rank(name, array, 3, "(H, W, L)")
            if array.shape != self.colors.shape[:3]:
                raise ShapeError(
                    f"{name}: expected {self.colors.shape[:3]} like the colors, got {array.shape}"
                )
        if self.colors.shape[3] != 3:
            raise ShapeError(f"layer colors: expected 3 channels, got {self.colors.shape[3]}")
        for name in ("colors", "defocus", "coverage"):
            object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name), np.float32))
        with parallel_region:
            valid = _are_valid(self.colors, self.defocus, self.coverage)
        if not valid:
            self._raise_fault()

    def part(self, rows: slice, columns: slice) -> "Layers":
        """Return the layers of some rows and columns."""
        colors, defocus, coverage = (
            array[rows, columns] for array in (self.colors, self.defocus, self.coverage)
        )
        return Layers(colors=colors, defocus=defocus, coverage=coverage)

    def with_mapped_colors(
        self, formula: Callable[[npt.NDArray[np.float32]], npt.NDArray[np.float32]]
    ) -> "Layers":
        """Return the same layers with ``formula`` applied to the colors of each layer, (H, W, 3)."""
        colors = np.stack([formula(layer) for layer in np.moveaxis(self.colors, 2, 0)], 2)
        return Layers(colors=colors, defocus=self.defocus, coverage=self.coverage)

    def _raise_fault(self) -> NoReturn:
        for name in ("colors", "defocus", "coverage"):
            check_finite(name, getattr(self, name))
        if self.coverage.min() < 0 or self.coverage.max() > 1:
            shown = f"{self.coverage.min():g} to {self.coverage.max():g}"
            raise ParameterError("coverage", "0 to 1", self.coverage, shown=shown)
        expected = "layers from front to back"
        raise ParameterError("defocus", expected, self.defocus, shown="a layer in front of the previous one")

    in_light = earlier_name("Layers", "in_light")


@njit(cache=True, parallel=True)
def _are_valid(colors, defocus, coverage):
    """Return whether all values are finite, coverage is in [0, 1] and the layers are front to back."""
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
