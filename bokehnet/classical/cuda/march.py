"""Rays on a CUDA device, for :func:`bokehnet.classical.layered.march.ray_marching.march`."""

import warnings
import weakref
from collections.abc import Callable
from functools import cache
from typing import Any

import numba.cuda
import numpy as np
from numba import float32, float64

from bokehnet.classical.cuda.ray_walk import GROUP_RAYS, make_march
from bokehnet.classical.layered.march.defocus_bins import BINS, TILE, DefocusBins, bin_runs
from bokehnet.classical.layered.march.ray_accumulators import GROUPS, PLAIN
from bokehnet.classical.layered.march.ray_marching import SETS
from bokehnet.errors import ParameterError
from bokehnet.optics.aperture import cats_eye_shift

cuda: Any = numba.cuda  # the device simulator of numba requires this name

__all__ = ["CudaMarch", "cuda_rays_unavailable_reason"]

# Shapes of the local arrays of a thread; numba requires constants.
_RUNS, _TOTALS, _LOOKS = (BINS // 2, 2), (GROUPS, PLAIN), (3, GROUP_RAYS)

_THREADS = (8, 8)  # threads per block: pixels of one tile, which share their runs of bins


def cuda_rays_unavailable_reason() -> str | None:
    """Return the reason why numba cannot use a CUDA device, or None if it can."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            is_available = cuda.is_available()
            return None if is_available else " ".join(str(cuda.cuda_error() or "no device").split())
    except (cuda.CudaSupportError, OSError) as error:
        return " ".join(str(error).split())


@cache
def _kernel() -> Any:
    """Return the CUDA kernel; one thread renders one pixel."""
    march_pixel = make_march(cuda.jit(device=True))
    shift = cuda.jit(device=True)(cats_eye_shift)
    runs_of = cuda.jit(device=True)(bin_runs.function)

    @cuda.jit
    def march(
        colors,
        cells,
        rays_mask,
        bits,
        smooth,
        held,
        bounds,
        points,
        chances,
        weights,
        placement,
        first,
        before,
        counts,
        sums,
    ):
        x, y = cuda.grid(2)
        if x >= sums.shape[1] or y >= sums.shape[0]:
            return
        if before == 0:
            for group in range(GROUPS):
                for number in range(PLAIN):
                    sums[y, x, group, number] = np.float32(0)
        if not rays_mask[first + y, x]:
            return
        row, column = (first + y) // TILE, x // TILE
        sent = counts[row - first // TILE, column]
        if sent <= before:
            return
        runs = cuda.local.array(_RUNS, float64)
        totals = cuda.local.array(_TOTALS, float32)
        looks = cuda.local.array(_LOOKS, float32)
        cats_eye, left, top, width, height, seed, above, variants = placement
        count = runs_of(bits[row, column], bounds[0], bounds[1], runs)
        tiles = held, np.float32(bounds[0]), np.float32(1.0 / bounds[1])
        shift_x, shift_y = shift(cats_eye, x + left, first + y + above + top, width, height)
        pattern = variants, seed, above, cats_eye, shift_x, shift_y
        march_pixel(
            x, first + y, colors, cells, tiles, runs, count, smooth[row, column], points, chances, weights,
            pattern, sums[y, x], totals, looks, before, sent,
        )  # fmt: skip

    return march


class CudaMarch:
    """Ray marching on the device, with its buffers.

    Picture and cells are copied to the device once and remain until the host frees the cells or another
    picture follows. The means of the first rays remain until the other rays of the same pixels are traced.
    """

    def __init__(self) -> None:
        self._cells: Callable[[], np.ndarray | None] = lambda: None
        self._arrays: tuple[Any, ...] = ()
        self._means: tuple[Any, Any] = (None, None)  # on the host and on the device

    def _release(self, _: Any = None) -> None:
        """Free the arrays of the picture on the device."""
        self._arrays = ()

    def __call__(
        self,
        colors: np.ndarray,
        cells: np.ndarray,
        rays_mask: np.ndarray,
        bins: DefocusBins,
        points: np.ndarray,
        chances: np.ndarray,
        weights: np.ndarray,
        lens: Any,
        outlines: Any,
        cats_eye: float,
        place: tuple[int, int, int, int],
        seed: int,
        above: int,
        first: int,
        before: int,
        counts: np.ndarray,
        sums: np.ndarray,
    ) -> None:
        """Add rays number ``before`` to ``counts`` of each pixel to its means, which begin at row ``first``.

        If ``before`` is 0, the means start at zero. Otherwise they continue from the previous call with the
        same ``sums``.

        Raises:
            ParameterError: The lens has aberrations.
        """
        if lens is not None or outlines is not None:
            raise ParameterError(
                "engine.device",
                expected="cpu for a lens that does more than focus",
                got="cuda",
                remedy="use --device cpu, or auto, which does so",
            )
        if self._cells() is not cells:  # a new picture: each march allocates its cells
            self._release()
            host_arrays = (colors, cells, rays_mask, *bins[:3], points, chances, weights)
            self._arrays = tuple(cuda.to_device(np.ascontiguousarray(array)) for array in host_arrays)
            self._cells = weakref.ref(cells, self._release)
        arrays = self._arrays
        placement = (float(cats_eye), *place, seed, above, points.shape[1] // SETS)
        if before == 0:
            means = cuda.device_array(sums.shape, sums.dtype)  # filled by the kernel
        else:
            means = self._means[1] if self._means[0] is sums else cuda.to_device(sums)
        blocks = -(-sums.shape[1] // _THREADS[0]), -(-sums.shape[0] // _THREADS[1])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # numba warns about pictures too small to fill the device
            _kernel()[blocks, _THREADS](
                *arrays[:6],
                (bins.low, bins.thickness),
                *arrays[6:],
                placement,
                first,
                before,
                cuda.to_device(counts),
                means,
            )
        means.copy_to_host(sums)
        self._means = (sums, means) if before == 0 else (None, None)
