"""Occluded pixels in inpainting order: from the edge of the occluder inwards."""

from typing import NamedTuple

import numpy as np

__all__ = ["OccludedRings", "occluded_rings"]


class OccludedRings(NamedTuple):
    """Occluded pixels by whole pixels of distance from the edge.

    Attributes:
        ys: Rows, the nearest first, (N,).
        xs: Columns, (N,).
        ends: Indices of the first pixels of rings 1, 2, ..., and N, (rings + 1,).
        rings: Ring of each pixel, 0 where nothing is occluded, (H, W) uint16.
    """

    ys: np.ndarray
    xs: np.ndarray
    ends: np.ndarray
    rings: np.ndarray

    def within(self, distance: int) -> "OccludedRings":
        """Return the pixels up to a distance from the edge, pixels."""
        ends = self.ends[: distance + 1]
        return OccludedRings(self.ys[: ends[-1]], self.xs[: ends[-1]], ends, self.rings)

    def select(self, kept: np.ndarray) -> "OccludedRings":
        """Return the pixels that ``kept``, (N,) bool, marks; the others become rings 0."""
        ys, xs, rings = self.ys[kept], self.xs[kept], np.zeros_like(self.rings)
        rings[ys, xs] = self.rings[ys, xs]
        return OccludedRings(ys, xs, np.append(0, np.cumsum(kept))[self.ends], rings)


def occluded_rings(distances: np.ndarray) -> OccludedRings:
    """Sort occluded pixels by distance; ``distances`` is (H, W), pixels, 0 where nothing is occluded."""
    ys, xs = np.nonzero(distances)
    rings, pixel_rings = np.zeros(distances.shape, np.uint16), np.ceil(distances[ys, xs])
    pixel_rings = np.minimum(pixel_rings, np.iinfo(rings.dtype).max).astype(
        rings.dtype
    )  # uint16 for radix sort
    rings[ys, xs] = pixel_rings
    order = np.argsort(pixel_rings, kind="stable")
    ys, xs, pixel_rings = ys[order], xs[order], pixel_rings[order]
    ends = np.searchsorted(pixel_rings, np.arange(1, int(pixel_rings.max(initial=0)) + 2))
    return OccludedRings(ys, xs, ends, rings)
