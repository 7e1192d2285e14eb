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

cuda: Any = numba.cuda  # by this name numba's simulator of a device finds it

__all__ = ["CudaMarch", "why_no_rays"]

# Shapes of what a thread keeps for itself; numba wants them as constants.
_RUNS, _TOTALS, _LOOKS = (BINS // 2, 2), (GROUPS, PLAIN), (3, GROUP_RAYS)

_THREADS = (8, 8)  # of a block: the pixels of a tile, which walk through the same runs


def why_no_rays() -> str | None:
    """Why numba can use no CUDA device here, in a few words; None where it can."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = cuda.is_available()
            return None if found else " ".join(str(cuda.cuda_error() or "no device").split())
    except (cuda.CudaSupportError, OSError) as error:
        return " ".join(str(error).split())


@cache
def _kernel() -> Any:
    """The kernel of one pixel a thread."""
    march_pixel = make_march(cuda.jit(device=True))
    shift = cuda.jit(device=True)(cats_eye_shift)
    runs_of = cuda.jit(device=True)(bin_runs.function)

    @cuda.jit
    def march(  # type: ignore[no-untyped-def]
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
        where,
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
        cats_eye, left, top, width, height, seed, above, variants = where
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
    """Sends the rays of a picture on the device.

    Picture and cells are copied there once and stay until the host frees the cells, or until others come.
    The means of the first rays stay until the other rays of the same pixels are sent.
    """

    def __init__(self) -> None:
        self._cells: Callable[[], np.ndarray | None] = lambda: None
        self._there: tuple[Any, ...] = ()
        self._means: tuple[Any, Any] = (None, None)  # on the host and there

    def _release(self, _: Any = None) -> None:
        """Free the picture's arrays on the device."""
        self._there = ()

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
        """Add rays ``before`` to ``counts`` of each pixel to its means, which begin at row ``first``.

        With ``before`` 0 the means are taken to be zeros; else to be as the call before left them, if that
        had the same ``sums``.

        Raises:
            ParameterError: A lens that does more than focus.
        """
        if lens is not None or outlines is not None:
            raise ParameterError(
                "engine.device",
                expected="cpu for a lens that does more than focus",
                got="cuda",
                remedy="use --device cpu, or auto, which does so",
            )
        if self._cells() is not cells:  # a new picture: a march makes its own cells
            self._release()
            whole = (colors, cells, rays_mask, *bins[:3], points, chances, weights)
            self._there = tuple(cuda.to_device(np.ascontiguousarray(array)) for array in whole)
            self._cells = weakref.ref(cells, self._release)
        there = self._there
        where = (float(cats_eye), *place, seed, above, points.shape[1] // SETS)
        if before == 0:
            means = cuda.device_array(sums.shape, sums.dtype)  # filled by the kernel
        else:
            means = self._means[1] if self._means[0] is sums else cuda.to_device(sums)
        blocks = -(-sums.shape[1] // _THREADS[0]), -(-sums.shape[0] // _THREADS[1])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of pictures too small to fill the device
            _kernel()[blocks, _THREADS](
                *there[:6],
                (bins.low, bins.thickness),
                *there[6:],
                where,
                first,
                before,
                cuda.to_device(counts),
                means,
            )
        means.copy_to_host(sums)
        self._means = (sums, means) if before == 0 else (None, None)
