"""How a picture is cut into strips that are rendered one after the other, so that memory stays bounded."""

import math
from collections.abc import Iterator

import numpy as np

from bokehnet.classical.base import ALIGNED, Strip
from bokehnet.classical.layered.march.ray_averages import window_halo
from bokehnet.engine_registry import CLASSICAL
from bokehnet.errors import ParameterError

__all__ = ["StripAccumulator", "cut_strips", "least_rows", "working_memory"]

# Rows that the averaging windows of pixels need around a strip, unless a disc is very large.
_MIN_HALO_ROWS = 32

# Bytes that a strip takes where nobody says how much may be taken, the first that is worth it: less is
# faster, as it is used again, but of large discs little of it would be the strip's own.
_WORKING_MEMORY = (2**30, 3 * 2**29, 2**31)

# Rows of a strip, over those around it that are looked at as well, from which on such strips are worth it.
_WORTH = 6


def _aligned(row: int) -> int:
    return row // ALIGNED * ALIGNED


def _halo(height: int, reach: int, classical: str) -> int:
    return CLASSICAL[classical].strip_halo * min(reach, height) + max(_MIN_HALO_ROWS, window_halo(reach))


def least_rows(height: int, reach: int, classical: str) -> int:
    """Rows that the narrowest strip holds, with those around it, in a picture of that height."""
    return min(height, 2 * _halo(height, reach, classical) + 2 * ALIGNED)


def working_memory(height: int, width: int, reach: int, classical: str) -> int | None:
    """Bytes of a strip of a picture whose memory nobody bounds; ``None`` where it is not worth cutting.

    Large pictures are, where few rows around a strip are looked at beside its own.

    Args:
        height: Of the picture.
        width: Of the picture.
        reach: Pixels within which rays stay.
        classical: Name of the classical renderer.
    """
    halo = _halo(height, reach, classical)
    for memory in _WORKING_MEMORY:
        most = memory // (CLASSICAL[classical].bytes_per_pixel * width)
        if most >= height:
            return None
        if most - 2 * halo - ALIGNED >= _WORTH * halo:
            return memory
    return None


def cut_strips(
    height: int,
    width: int,
    max_coc_radius: int,
    classical: str,
    memory: int,
    taken: int = 0,
    crossed: int | None = None,
) -> Iterator[Strip]:
    """Cut a picture into strips, from top to bottom.

    Args:
        height: Of the picture.
        width: Of the picture.
        max_coc_radius: Its largest blur radius, pixels.
        classical: Name of the classical renderer.
        memory: Bytes that rendering a strip may take beyond input and output, and that are taken already.
        taken: Those that are taken already.
        crossed: Pixels within which rays stay, where a lens sends them beyond ``max_coc_radius``.

    Raises:
        ParameterError: Not even the narrowest strip fits.
    """
    reach = max(max_coc_radius, crossed or 0)
    halo = _halo(height, reach, classical)
    most = max(0, memory - taken) // (CLASSICAL[classical].bytes_per_pixel * width)
    rows = height if most >= height else _aligned(most - 2 * halo - ALIGNED)
    if rows < ALIGNED and rows < height:
        least = least_rows(height, reach, classical) * width * CLASSICAL[classical].bytes_per_pixel
        which = "in all" if taken else "beyond the pictures themselves"
        raise ParameterError(
            "max_memory",
            f"at least {math.ceil((taken + least) / 1e6)} MB {which}, for a "
            f"width of {width} and blur of {max_coc_radius} pixels",
            memory,
            shown=f"{memory / 1e6:.0f} MB",
        )
    for top in range(0, height, rows):
        bottom = min(height, top + rows)
        first = _aligned(max(0, top - halo))
        yield Strip(
            first=first,
            last=min(height, bottom + halo),
            height=height,
            max_coc_radius=max_coc_radius,
            wanted=slice(top - first, bottom - first),
        )


class StripAccumulator:
    """What strips give, gathered row by row in an array of the whole picture.

    Args:
        read: The array that the strips read, (H, W) or (H, W, C).
        overwrite: Whether the results take its place, as soon as no later strip reads there. Where it
            cannot be written to, they do not.
    """

    def __init__(self, read: np.ndarray, overwrite: bool) -> None:
        self._over = overwrite and read.flags.writeable
        self.array = read if self._over else np.empty_like(read)
        self._waiting: list[tuple[int, np.ndarray]] = []

    def add(self, first: int, rows: np.ndarray, read_from: int) -> None:
        """Take in some rows of the result.

        Args:
            first: Row of the picture at which they begin.
            rows: The result, (rows, W) or (rows, W, C).
            read_from: Row of the picture from which on later strips read; its height after the last strip.
        """
        self._waiting.append((first, rows))
        waiting, self._waiting = self._waiting, []
        for start, part in waiting:
            done = min(max(read_from - start, 0), len(part)) if self._over else len(part)
            self.array[start : start + done] = part[:done]
            if done < len(part):
                self._waiting.append((start + done, part[done:].copy()))
