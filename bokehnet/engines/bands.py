"""Division of a picture into bands of columns, for discs whose halo fills most of a strip of rows.

A strip of whole rows reads a halo above and below. Where memory allows few rows beside that halo, the layers
of the halo are most of the work. A band reads fewer columns and has more rows of its own. Bands are copied
with their halo of columns, rendered in strips of rows, and written back, from left to right.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from bokehnet.classical.base import ALIGNED

__all__ = ["Band", "BandReader", "band_bytes", "even_bands", "widest_band"]

# Bytes per pixel of the copy of a band: light and defocus.
_COPY_BYTES = 16


@dataclass(frozen=True, kw_only=True, slots=True)
class Band:
    """Columns of a picture that are rendered together.

    Attributes:
        first: Column of the picture at which the band begins; a multiple of ``ALIGNED``.
        last: Column behind its last one.
        start: First column of its own; the others are the halo.
        stop: Column behind the last one of its own.
    """

    first: int
    last: int
    start: int
    stop: int


def even_bands(width: int, halo: int, count: int) -> list[Band]:
    """Return ``count`` bands, or fewer, of about equally many own columns.

    Args:
        width: Width of the picture, pixels.
        halo: Columns that a band reads beyond its own on either side.
        count: Number of bands.
    """
    own = max(ALIGNED, -(-width // (count * ALIGNED)) * ALIGNED)
    return [
        Band(
            first=max(0, start - halo) // ALIGNED * ALIGNED,
            last=min(width, start + own + halo),
            start=start,
            stop=min(width, start + own),
        )
        for start in range(0, width, own)
    ]


def widest_band(bands: Sequence[Band]) -> int:
    """Return the number of columns of the widest band, halo included."""
    return max(band.last - band.first for band in bands)


def band_bytes(height: int, bands: Sequence[Band]) -> int:
    """Return the memory of the copy of the widest band, and of the columns kept for the next one, bytes."""
    if len(bands) < 2:
        return 0
    kept = max(band.stop - after.first for band, after in pairwise(bands))
    return _COPY_BYTES * height * (widest_band(bands) + kept)


class BandReader:
    """Copies of bands from arrays whose own columns are overwritten by results, from left to right.

    Args:
        arrays: Arrays of the picture, (H, W, ...).
        bands: Bands, from left to right.
    """

    def __init__(self, arrays: list[np.ndarray], bands: Sequence[Band]) -> None:
        self._arrays, self._bands = arrays, bands
        self._kept = [array[:, :0] for array in arrays]

    def read(self, index: int) -> list[np.ndarray]:
        """Return the contiguous pixels of a band, (H, columns, ...), one array each; call once, in order."""
        band, copies = self._bands[index], []
        for number, array in enumerate(self._arrays):
            kept = self._kept[number]
            rest = array[:, band.first + kept.shape[1] : band.last]
            copy = np.concatenate([kept, rest], axis=1)
            if index + 1 < len(self._bands):
                after = self._bands[index + 1]
                self._kept[number] = copy[:, after.first - band.first : band.stop - band.first].copy()
            copies.append(copy)
        return copies
