"""Division of a picture into strips of rows, and these into bands, rendered in turn, which bounds the memory.

A strip of whole rows reads a halo above and below. Where memory allows few rows beside that halo, its layers
are most of the work: bands of columns have more rows of their own (:mod:`bokehnet.engines.bands`).
"""

import math
from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from bokehnet.classical.base import ALIGNED, Strip
from bokehnet.classical.layered.march.resolution_levels import layers_halo
from bokehnet.engine_registry import CLASSICAL
from bokehnet.engines.bands import Band, band_bytes, even_bands, widest_band
from bokehnet.errors import ParameterError

__all__ = ["StripAccumulator", "cut_bands", "cut_strips", "memory_error", "min_strip_bytes", "working_memory"]

# Minimum halo of a strip, rows, for the averaging windows of pixels; very large discs need more.
_MIN_HALO_ROWS = 32

# Memory of a strip without a user limit, bytes; the first efficient one is used: less is faster because it is
# reused, but with large discs most of it would be halo.
_WORKING_MEMORY_BYTES = (2**30, 3 * 2**29, 2**31)

# Fraction of the pixels that strips of whole rows read which are their own; below, bands are considered.
_EFFICIENT_FRACTION = 0.5

# Minimum ratio of a strip's own rows to its halo for such strips to be efficient.
_MIN_ROWS_PER_HALO = 6


def _aligned(row: int) -> int:
    return row // ALIGNED * ALIGNED


def _halo(height: int, reach: int, classical: str) -> int:
    spec = CLASSICAL[classical]
    margin = layers_halo(reach) if spec.traces_rays else 0
    return spec.strip_halo * min(reach, height) + max(_MIN_HALO_ROWS, margin)


def _min_rows(height: int, reach: int, classical: str) -> int:
    """Return the rows of the narrowest strip, halo included, in a picture of this height."""
    return min(height, 2 * _halo(height, reach, classical) + 2 * ALIGNED)


def working_memory(height: int, width: int, reach: int, classical: str) -> int | None:
    """Return the memory of a strip, bytes, without a user limit; ``None`` if strips are not efficient.

    Strips of large pictures are efficient if the halo is small compared with their own rows.

    Args:
        height: Height of the picture, pixels.
        width: Width of the picture, pixels.
        reach: Maximum distance of rays from their pixel, pixels.
        classical: Name of the classical renderer.
    """
    halo = _halo(height, reach, classical)
    for memory in _WORKING_MEMORY_BYTES:
        max_rows = memory // (CLASSICAL[classical].bytes_per_pixel * width)
        if max_rows >= height:
            return None
        if max_rows - 2 * halo - ALIGNED >= _MIN_ROWS_PER_HALO * halo:
            return memory
    return None


def _own_fraction(height: int, bands: list[Band], halo: int, classical: str, memory: int) -> float:
    """Return the fraction of the pixels read by strips of bands that are their own; 0 if memory is short."""
    widest = widest_band(bands)
    rows = (memory - band_bytes(height, bands)) // (CLASSICAL[classical].bytes_per_pixel * widest)
    own_rows = height if rows >= height else rows - 2 * halo - ALIGNED
    if own_rows < ALIGNED:
        return 0.0
    read = sum(band.last - band.first for band in bands)
    return own_rows / min(rows, height) * bands[-1].stop / read


def cut_bands(height: int, width: int, reach: int, classical: str, memory: int) -> list[Band]:
    """Divide the columns of a picture into bands; one band where strips of whole rows are efficient.

    Args:
        height: Height of the picture, pixels.
        width: Width of the picture, pixels.
        reach: Maximum distance of rays from their pixel, pixels.
        classical: Name of the classical renderer.
        memory: Memory for strips and copies of bands, bytes.
    """
    halo = _halo(height, reach, classical)
    best = even_bands(width, halo, 1)
    fraction = _own_fraction(height, best, halo, classical, memory)
    if fraction >= _EFFICIENT_FRACTION or not CLASSICAL[classical].traces_rays:
        return best
    for count in range(2, _max_count(width, halo) + 1):
        bands = even_bands(width, halo, count)
        other = _own_fraction(height, bands, halo, classical, memory)
        if other > fraction:
            best, fraction = bands, other
    return best


def _max_count(width: int, halo: int) -> int:
    """Return the maximum number of bands: own columns are at least as many as those of one halo."""
    return max(1, width // max(halo, ALIGNED))


def min_strip_bytes(height: int, width: int, reach: int, classical: str, bands: bool) -> int:
    """Return the minimum memory of strips, bytes.

    In bands, a strip has at least as many own rows as one halo, so that no pixel is read more than about nine
    times.

    Args:
        height: Height of the picture, pixels.
        width: Width of the picture, pixels.
        reach: Maximum distance of rays from their pixel, pixels.
        classical: Name of the classical renderer.
        bands: True if the picture may be rendered in bands.
    """
    per_pixel, halo = CLASSICAL[classical].bytes_per_pixel, _halo(height, reach, classical)
    minimum = _min_rows(height, reach, classical) * width * per_pixel
    if not bands or not CLASSICAL[classical].traces_rays:
        return minimum
    rows = min(height, 3 * halo + 2 * ALIGNED)
    for count in range(2, _max_count(width, halo) + 1):
        columns = even_bands(width, halo, count)
        minimum = min(minimum, band_bytes(height, columns) + rows * widest_band(columns) * per_pixel)
    return minimum


def memory_error(
    min_bytes: int, memory: int, memory_in_use: int, width: int, max_coc_radius: int
) -> ParameterError:
    """Return the error that names the minimum memory; arguments in bytes and pixels."""
    scope = "in all" if memory_in_use else "beyond the pictures themselves"
    return ParameterError(
        "max_memory",
        f"at least {math.ceil((memory_in_use + min_bytes) / 1e6)} MB {scope}, for a "
        f"width of {width} and blur of {max_coc_radius} pixels",
        memory,
        shown=f"{memory / 1e6:.0f} MB",
    )


def cut_strips(
    height: int,
    width: int,
    max_coc_radius: int,
    classical: str,
    memory: int,
    memory_in_use: int = 0,
    max_ray_reach: int | None = None,
) -> Iterator[Strip]:
    """Divide a picture into strips, from top to bottom.

    Args:
        height: Height of the picture, pixels.
        width: Width of the picture, pixels.
        max_coc_radius: Largest blur radius of the picture, pixels.
        classical: Name of the classical renderer.
        memory: Maximum memory for a strip beyond input and output, including ``memory_in_use``, bytes.
        memory_in_use: Memory that is already in use, bytes.
        max_ray_reach: Maximum distance of rays from their pixel, if a lens sends them beyond
            ``max_coc_radius``, pixels.

    Raises:
        ParameterError: The narrowest strip exceeds the memory.
    """
    reach, shown_width = max(max_coc_radius, max_ray_reach or 0), width
    halo = _halo(height, reach, classical)
    if classical == "scatter":  # its largest arrays continue beyond both borders
        width += 2 * min(reach, -(-min(height, width) // 2))
    max_rows = max(0, memory - memory_in_use) // (CLASSICAL[classical].bytes_per_pixel * width)
    bounds = _strip_bounds(height, halo, max_rows)
    if bounds is None:
        min_bytes = min_strip_bytes(height, width, reach, classical, bands=False)
        raise memory_error(min_bytes, memory, memory_in_use, shown_width, max_coc_radius)
    for top, bottom in pairwise(bounds):
        first = _aligned(max(0, top - halo))
        yield Strip(
            first=first,
            last=min(height, bottom + halo),
            height=height,
            max_coc_radius=max_coc_radius,
            output_rows=slice(top - first, bottom - first),
        )


def _strip_bounds(height: int, halo: int, max_rows: int) -> list[int] | None:
    """Return the first row of each strip and the height, so that all strips read about equally many rows.

    The first and the last strip have one halo only. All bounds but the last are multiples of ``ALIGNED``.

    Args:
        height: Height of the picture, pixels.
        halo: Rows that a strip reads beyond its own on either side.
        max_rows: Maximum number of rows that a strip may read.

    Returns:
        Bounds; ``None`` if the narrowest strip reads more than ``max_rows``.
    """
    if max_rows >= height:
        return [0, height]
    inner, first = _aligned(max_rows - 2 * halo - ALIGNED), _aligned(max_rows - halo)
    if inner < ALIGNED:
        return None
    last = max_rows - halo - ALIGNED
    count = 2 + max(0, -(-(height - first - last) // inner))
    rows = (height + 2 * halo * (count - 1)) / count  # with halos
    bounds = [0]
    while height - max(0, _aligned(bounds[-1] - halo)) > max_rows:
        own, limit = (rows - halo, first) if len(bounds) == 1 else (rows - 2 * halo, inner)
        bounds.append(bounds[-1] + min(max(ALIGNED, _aligned(math.ceil(own) + ALIGNED - 1)), limit))
    return [*bounds, height]


class StripAccumulator:
    """Results of strips, collected row by row in an array of the whole picture.

    Args:
        read: Array that the strips read, (H, W) or (H, W, C).
        overwrite: True if the results replace it, as soon as no later strip reads there. If it is read-only,
            they do not.
    """

    def __init__(self, read: np.ndarray, overwrite: bool) -> None:
        self._overwrites = overwrite and read.flags.writeable
        self.array = read if self._overwrites else np.empty_like(read)
        self._pending: list[tuple[int, np.ndarray]] = []

    def add(self, first: int, rows: np.ndarray, read_from: int) -> None:
        """Add some rows of the result.

        Args:
            first: Row of the picture at which they begin.
            rows: Result, (rows, W) or (rows, W, C).
            read_from: Row of the picture from which on later strips read; its height after the last strip.
        """
        self._pending.append((first, rows))
        pending, self._pending = self._pending, []
        for start, part in pending:
            writable = min(max(read_from - start, 0), len(part)) if self._overwrites else len(part)
            self.array[start : start + writable] = part[:writable]
            if writable < len(part):
                self._pending.append((start + writable, part[writable:].copy()))
