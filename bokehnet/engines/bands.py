"""Division of the columns of a picture into bands, for discs whose halo fills most of a strip of rows.

A strip of whole rows reads a halo above and below. Where memory allows few rows beside that halo, the layers
of the halo are most of the work. A part of the strip reads fewer columns, and the strip has more rows.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from bokehnet.classical.base import ALIGNED

__all__ = ["Band", "even_bands", "widest_band"]


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
