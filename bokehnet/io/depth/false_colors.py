"""Maps in false colours, as demonstrations of depth networks write them: recognition and decoding."""

from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

__all__ = ["COLOR_MAPS", "TABLES_FILE", "decode_colors", "recognise_colors"]

# Colour maps in the order of the stored tables, which `python -m tools.color_tables` writes.
COLOR_MAPS = ("turbo", "inferno", "magma", "plasma", "viridis", "jet", "Spectral_r")
TABLES_FILE = Path(__file__).with_name("color_tables.npy")

# Distance from the nearest colour of a table, Euclidean in 8-bit levels: the median and the 90th percentile
# of a map that uses the table, JPEG included; and the largest distance of a colour that is decoded.
_MAX_MEDIAN, _MAX_HIGH, _MAX_DECODED = 6.0, 20.0, 30.0

# Two tables are told apart if the distances from one are this many times smaller, in the mean.
_MIN_RATIO = 1.5

# Pixels that decide about the table.
_SAMPLES = 20_000

# Colours per block, whose distances of 1 MiB stay in the cache.
_BLOCK = 512


def recognise_colors(colors: NDArray[np.floating]) -> str | None:
    """Return the name of the colour map that a picture uses; None if none fits, or several do.

    Args:
        colors: Stored colours, (H, W, 3), 0 to 1.

    Examples:
        >>> ramp = _tables()[COLOR_MAPS.index("magma")][None] / 255
        >>> recognise_colors(ramp), recognise_colors(np.random.default_rng(0).random((8, 8, 3)))
        ('magma', None)
    """
    flat = colors.reshape(-1, 3)
    sample = 255 * flat[:: max(1, len(flat) // _SAMPLES)].astype(np.float64)
    distances = [_nearest(sample, table)[1] for table in _tables()]
    means = np.array([distance.mean() for distance in distances])
    first, second = np.argsort(means)[:2]
    best = distances[first]
    if np.median(best) > _MAX_MEDIAN or np.percentile(best, 90) > _MAX_HIGH:
        return None
    distinct = means[second] > _MIN_RATIO * means[first] + 1.0
    return COLOR_MAPS[first] if distinct else None


def decode_colors(colors: NDArray[np.floating], name: str) -> NDArray[np.float32]:
    """Return the values of a map in false colours, (H, W), 0 to 1; NaN where no colour of the table is near.

    Blended colours, as at edges of a resized or JPEG file, lie off the table: they have no value.

    Args:
        colors: Stored colours, (H, W, 3), 0 to 1.
        name: One of ``COLOR_MAPS``.

    Examples:
        >>> colors = _tables()[COLOR_MAPS.index("turbo")][None, [0, 51, 255]] / 255
        >>> [round(float(value), 3) for value in decode_colors(colors, "turbo")[0]]
        [0.0, 0.2, 1.0]
    """
    levels = np.rint(np.clip(colors, 0, 1) * 255).astype(np.uint32).reshape(-1, 3)
    packed = levels[:, 0] << 16 | levels[:, 1] << 8 | levels[:, 2]
    distinct, position = np.unique(packed, return_inverse=True)
    unpacked = np.stack([distinct >> 16, distinct >> 8 & 255, distinct & 255], axis=1).astype(np.float64)
    table = _tables()[COLOR_MAPS.index(name)]
    index, distance = _nearest(unpacked, table)
    equal = (table[:, None] == table[None]).all(axis=2)  # jet repeats colours: take the middle of the run
    middle = (equal @ np.arange(len(table))) / equal.sum(axis=1)
    values = np.where(distance <= _MAX_DECODED, middle[index] / 255, np.nan).astype(np.float32)
    decoded: NDArray[np.float32] = values[position].reshape(colors.shape[:2])
    return decoded


def _nearest(
    colors: NDArray[np.float64], table: NDArray[np.uint8]
) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Return the index of the nearest table colour and its distance, for colours (N, 3) in 8-bit levels."""
    entries = table.astype(np.float64)
    doubled, squares = 2 * entries.T, (entries**2).sum(axis=1)
    index = np.empty(len(colors), np.intp)
    # Not as a matrix product: for three products per value the threads of BLAS cost more than they gain.
    for first in range(0, len(colors), _BLOCK):
        block = colors[first : first + _BLOCK]
        scores = squares - block[:, :1] * doubled[0]
        scores -= block[:, 1:2] * doubled[1]
        scores -= block[:, 2:] * doubled[2]
        index[first : first + _BLOCK] = np.argmin(scores, axis=1)
    return index, np.linalg.norm(colors - entries[index], axis=1)


@lru_cache(maxsize=1)
def _tables() -> NDArray[np.uint8]:
    """Return the colours of all maps, (maps, 256, 3), uint8."""
    tables: NDArray[np.uint8] = np.load(TABLES_FILE)
    return tables
