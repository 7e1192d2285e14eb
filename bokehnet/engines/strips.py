"""Division of a picture into strips of rows, and these into bands of columns, which bounds the memory.

A strip reads a halo above and below, and a band to the left and right: what rays reach, and around it what
the background estimated there depends on.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from bokehnet.classical.base import ALIGNED, Strip, with_halo
from bokehnet.classical.picture_job import MIN_HALO_PX, output_halo
from bokehnet.engine_registry import CLASSICAL
from bokehnet.errors import ParameterError

__all__ = ["StripAccumulator", "cut", "even_bands", "min_strip_bytes", "strip_bytes", "working_memory"]

# Memory of a strip without a user limit, bytes; the first efficient one is used: less is faster because it is
# reused, but with large discs most of it would be halo.
_WORKING_MEMORY_BYTES = (2**30, 3 * 2**29, 2**31)

# Fraction of the pixels that strips of whole rows read which are their own; below, bands are considered.
_EFFICIENT_FRACTION = 0.5

# Minimum ratio of a strip's own rows to its halo for such strips to be efficient.
_MIN_ROWS_PER_HALO = 6

# Bytes per pixel of the results of a strip: light and error map.
_OUTPUT_BYTES = 16


@dataclass(frozen=True, kw_only=True, slots=True)
class _Halos:
    """Pixels around the output on either side: those that rays reach, and all that are read."""

    reached: int
    read: int


def even_bands(width: int, count: int) -> list[slice]:
    """Return ``count`` bands of columns, or fewer, about equally wide and without halo."""
    own = max(ALIGNED, -(-width // (count * ALIGNED)) * ALIGNED)
    return [slice(left, min(width, left + own)) for left in range(0, width, own)]


def _halos(reach: int, classical: str) -> _Halos:
    if not CLASSICAL[classical].traces_rays:
        return _Halos(reached=reach + MIN_HALO_PX, read=reach + MIN_HALO_PX)
    reached = output_halo(reach)
    return _Halos(reached=reached, read=reached + reach)


def _pixels(size: tuple[int, int], own: tuple[int, int], halo: int) -> int:
    """Return the pixels within a halo of ``own`` rows and columns of a picture, at most."""
    rows, columns = (
        min(side, part if part >= side else part + 2 * halo + ALIGNED)
        for side, part in zip(size, own, strict=True)
    )
    return rows * columns


def strip_bytes(
    size: tuple[int, int], own: tuple[int, int], reach: int, classical: str, *, bands: bool = False
) -> int:
    """Return the peak memory of a strip beyond input and output, bytes.

    Args:
        size: Height and width of the picture, pixels.
        own: Rows and columns of the strip, or of one band of it, without halo.
        reach: Maximum distance of light or rays from their pixel, pixels.
        classical: Name of the classical renderer.
        bands: True if the strip is rendered in several bands, whose results are kept until no later strip
            reads there.
    """
    spec, (height, width) = CLASSICAL[classical], size
    halos = _halos(reach, classical)
    if classical == "scatter":  # its largest arrays continue beyond both borders
        beyond = 2 * min(reach, -(-min(height, width) // 2))
        size, own = (height, width + beyond), (own[0], own[1] + beyond)
    reached, read = (_pixels(size, own, halo) for halo in (halos.reached, halos.read))
    kept = _OUTPUT_BYTES * width * min(height, own[0] + 2 * halos.read) if bands else 0
    return spec.bytes_per_pixel * reached + spec.halo_bytes_per_pixel * read + kept


def _own_rows(size: tuple[int, int], bands: list[slice], reach: int, classical: str, memory: int) -> int:
    """Return the maximum rows of a strip without halo, a multiple of ``ALIGNED`` or all; 0 if none fit."""
    height, own_columns, several = size[0], bands[0].stop, len(bands) > 1  # the first is the widest

    def fits(rows: int) -> bool:
        return strip_bytes(size, (rows, own_columns), reach, classical, bands=several) <= memory

    if fits(height):
        return height
    low, high = 0, -(-height // ALIGNED)  # in units of ALIGNED: the lower one fits
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if fits(middle * ALIGNED) else (low, middle)
    return low * ALIGNED


def _own_fraction(size: tuple[int, int], bands: list[slice], rows: int, halo: int) -> float:
    """Return the fraction of the pixels that strips of ``rows`` rows in bands read which are their own."""
    if not rows:
        return 0.0
    height, width = size
    read_rows = rows if rows >= height else min(height, rows + 2 * halo)
    read = [with_halo(band, halo, width) for band in bands]
    read_columns = sum(band.stop - band.start for band in read)
    return rows * width / (read_rows * read_columns)


def working_memory(size: tuple[int, int], reach: int, classical: str) -> int | None:
    """Return the memory of a strip, bytes, without a user limit; ``None`` if strips are not efficient.

    Strips of large pictures are efficient if the halo is small compared with their own rows.

    Args:
        size: Height and width of the picture, pixels.
        reach: Maximum distance of rays from their pixel, pixels.
        classical: Name of the classical renderer.
    """
    halo = _halos(reach, classical).read
    for memory in _WORKING_MEMORY_BYTES:
        rows = _own_rows(size, even_bands(size[1], 1), reach, classical, memory)
        if rows >= size[0]:
            return None
        if rows >= _MIN_ROWS_PER_HALO * halo:
            return memory
    return None


def _cut_bands(size: tuple[int, int], reach: int, classical: str, memory: int) -> tuple[list[slice], int]:
    """Return the bands of a picture, one where strips of whole rows are efficient, and the rows of strips."""
    halo = _halos(reach, classical).read
    best = even_bands(size[1], 1)
    rows = _own_rows(size, best, reach, classical, memory)
    fraction = _own_fraction(size, best, rows, halo)
    if fraction >= _EFFICIENT_FRACTION:
        return best, rows
    for count in range(2, _max_count(size[1], halo) + 1):
        bands = even_bands(size[1], count)
        other_rows = _own_rows(size, bands, reach, classical, memory)
        other = _own_fraction(size, bands, other_rows, halo)
        if other > fraction:
            best, rows, fraction = bands, other_rows, other
    return best, rows


def _max_count(width: int, halo: int) -> int:
    """Return the maximum number of bands: own columns are at least as many as those of one halo."""
    return max(1, width // max(halo, ALIGNED))


def min_strip_bytes(size: tuple[int, int], reach: int, classical: str, bands: bool) -> int:
    """Return the minimum memory of strips, bytes.

    In bands, a strip has at least as many own rows as one halo, so that no pixel is read more than about nine
    times.

    Args:
        size: Height and width of the picture, pixels.
        reach: Maximum distance of rays from their pixel, pixels.
        classical: Name of the classical renderer.
        bands: True if strips may be divided into bands; only rays gain from them.
    """
    width, halo = size[1], _halos(reach, classical).read
    minimum = strip_bytes(size, (ALIGNED, width), reach, classical)
    if not (bands and CLASSICAL[classical].traces_rays):
        return minimum
    rows = -(-halo // ALIGNED) * ALIGNED
    for count in range(2, _max_count(width, halo) + 1):
        own = even_bands(width, count)[0].stop
        minimum = min(minimum, strip_bytes(size, (rows, own), reach, classical, bands=True))
    return minimum


def _memory_error(
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


def cut(
    size: tuple[int, int],
    max_coc_radius: int,
    classical: str,
    memory: int,
    memory_in_use: int = 0,
    max_ray_reach: int | None = None,
    *,
    bands: bool = False,
) -> Iterator[list[Strip]]:
    """Divide a picture into strips, from top to bottom, and each into bands, from left to right.

    Args:
        size: Height and width of the picture, pixels.
        max_coc_radius: Largest blur radius of the picture, pixels.
        classical: Name of the classical renderer.
        memory: Maximum memory for a strip beyond input and output, including ``memory_in_use``, bytes.
        memory_in_use: Memory that is already in use, bytes.
        max_ray_reach: Maximum distance of rays from their pixel, if a lens sends them beyond
            ``max_coc_radius``, pixels.
        bands: True to divide strips into bands where strips of whole rows are mostly halo, and rays are sent.

    Raises:
        ParameterError: The narrowest strip exceeds the memory.
    """
    (height, width), available = size, memory - memory_in_use
    reach = max(max_coc_radius, max_ray_reach or 0)
    halos = _halos(reach, classical)
    min_bytes = min_strip_bytes(size, reach, classical, bands)
    columns = even_bands(width, 1)
    rows = _own_rows(size, columns, reach, classical, available)
    if rows < height and available < min_bytes:
        raise _memory_error(min_bytes, memory, memory_in_use, width, max_coc_radius)
    if bands and CLASSICAL[classical].traces_rays:
        columns, rows = _cut_bands(size, reach, classical, available)
    for top, bottom in pairwise(_strip_bounds(height, halos, rows)):
        read = with_halo(slice(top, bottom), halos.read, height)
        yield [
            Strip(
                first=read.start,
                last=read.stop,
                left=across.start,
                right=across.stop,
                height=height,
                width=width,
                max_coc_radius=max_coc_radius,
                max_ray_reach=reach,
                output_rows=slice(top - read.start, bottom - read.start),
                output_columns=slice(band.start - across.start, band.stop - across.start),
            )
            for band, across in ((band, with_halo(band, halos.read, width)) for band in columns)
        ]


def _strip_bounds(height: int, halos: _Halos, max_rows: int) -> list[int]:
    """Return the first row of each strip and the height, so that all strips read about equally many rows.

    The first and the last strip have one halo only. All bounds but the last are multiples of ``ALIGNED``.

    Args:
        height: Height of the picture, pixels.
        halos: Rows around a strip on either side.
        max_rows: Maximum number of rows of a strip without halo, a multiple of ``ALIGNED`` or the height.
    """
    if max_rows >= height:
        return [0, height]
    outer = max_rows + halos.reached // ALIGNED * ALIGNED  # rows of the first strip and of the last, at most
    count = 2 + max(0, -(-(height - 2 * outer) // max_rows))
    rows = (height + 2 * halos.read * (count - 1)) / count  # with halos
    bounds = [0]
    while height - bounds[-1] > outer:
        first = len(bounds) == 1
        own, limit = (rows - halos.read, outer) if first else (rows - 2 * halos.read, max_rows)
        bounds.append(bounds[-1] + min(max(ALIGNED, -(-math.ceil(own) // ALIGNED) * ALIGNED), limit))
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
