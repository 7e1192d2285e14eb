"""Tiles whose pixels see nothing but large discs: there every fourth pixel sends rays for all.

Discs of radius r hold next to nothing at the frequency of pixels, and all pixels of such a tile are averaged
over windows that grow with r (:mod:`bokehnet.classical.layered.ray_averages`). One pixel of each 2x2 stands
for its four, at another place in each of four neighbouring ones, so that their mean lies in the middle, and
any 3x3 pixels hold two at least. It counts four times, so that windows over both kinds of tiles lean to
neither.

Source: Soler, Subr, Durand, Holzschuch and Sillion, "Fourier depth of field", ACM TOG 2009, for fewer pixels
where the disc is large.
"""

import numpy as np
from numba import prange

from bokehnet.classical.layered.defocus_bins import BINS, TILE, DefocusBins
from bokehnet.kernels import njit

__all__ = ["STANDS_FOR", "chosen_pixels", "sparse_tiles", "weigh"]

# Least radius of all discs that a sparse tile sees, pixels: their windows reach 4 pixels to either side.
_LEAST_RADIUS = 48.0

# Pixels for which each chosen one stands.
STANDS_FOR = 4


def sparse_tiles(bins: DefocusBins, height: int, width: int) -> np.ndarray:
    """Tiles whose rays can meet large discs alone, and that the border does not cut, (rows, columns) bool."""
    edges = bins.low + bins.thickness * np.arange(BINS + 1)
    near = (edges[:-1] < _LEAST_RADIUS) & (edges[1:] > -_LEAST_RADIUS)
    small = np.bitwise_or.reduce(np.uint64(1) << np.flatnonzero(near).astype(np.uint64), initial=np.uint64(0))
    found: np.ndarray = (bins.bits & small) == 0
    found[height // TILE :] = found[:, width // TILE :] = False
    return found


def chosen_pixels(sparse: np.ndarray, rays_mask: np.ndarray) -> np.ndarray:
    """The pixels of ``rays_mask`` (H, W) that send rays, (H, W) bool."""
    if not sparse.any():
        return rays_mask
    chosen = np.empty_like(rays_mask)
    _choose(sparse, rays_mask, chosen)
    return chosen


@njit(cache=True, parallel=True)
def _choose(sparse, rays_mask, chosen):  # type: ignore[no-untyped-def]
    """Fill ``chosen``."""
    for y in prange(rays_mask.shape[0]):
        for x in range(rays_mask.shape[1]):
            stands = (x & 1) == (y >> 1 & 1) and (y & 1) == (x >> 1 & 1)
            chosen[y, x] = rays_mask[y, x] and (stands or not sparse[y // TILE, x // TILE])


@njit(cache=True, parallel=True)
def weigh(sparse, sums):  # type: ignore[no-untyped-def]
    """Let the means ``sums`` (rows, W, GROUPS, numbers) in sparse tiles count for the pixels around."""
    for y in prange(sums.shape[0]):
        for x in range(sums.shape[1]):
            if sparse[y // TILE, x // TILE]:
                for group in range(sums.shape[2]):
                    for c in range(sums.shape[3]):
                        sums[y, x, group, c] *= STANDS_FOR
