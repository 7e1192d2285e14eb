"""Fraction of its light that a point sends to each pixel, for one aperture and a table of blur radii.

The light on a pixel at offset (i, j) is the transmission of the aperture, summed over the pixel's square in
aperture coordinates, [(i - 1/2) / r, (i + 1/2) / r] and the same in j. Running sums of the transmission
over a fine grid give it by four lookups, and since adjacent squares share their corners, the fractions of
all pixels sum to one for every radius. Between two steps of the radius table the fractions are linear:
the sum stays one, and the difference of the two is the derivative by the radius.

A step stores the lit part of its window as blocks of as many pixels of one row as a vector has, sorted by
rows: the position of a block, and in ``parts`` its fractions at the lower radius and the differences to the
next one. A list of equal blocks needs no inner loop of unpredictable length.
"""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from bokehnet.classical.scatter.disc_table import SMALLEST_RADIUS
from bokehnet.classical.simd.float8 import LANES, ORDER
from bokehnet.optics.aperture import Aperture, transmission

__all__ = ["LARGEST_TABLE", "MAX_CACHED_APERTURES", "STEP", "ShapeTable", "shape_table"]

# Distance of two radii of the radius table, pixels.
STEP = 0.25

# Largest radius of a radius table (10 MB in float32 for each side of the focus that differs).
LARGEST_TABLE = 64

# Number of apertures whose tables are cached: those of all presets, and a few more.
MAX_CACHED_APERTURES = 10

# Cells along each side of the running sums, and samples along each side of a cell.
_CELLS, _SAMPLES = 512, 2

# Fractions below this are rounding errors of the running sums.
_MIN_FRACTION = 1e-12


class ShapeTable(NamedTuple):
    """Radius table of one aperture, in the form that kernels read. Side 0 is in front of focus, 1 behind it.

    Attributes:
        reach: Rows of a step above and below its centre, (steps,).
        middle: Index into ``first`` of a step's centre row, (2, steps).
        first: Index of a row's first block, (R,); the row ends where the next one begins.
        rows: Row of each block, counted from the source, (B,).
        columns: First column of each block, (B,).
        parts: Fractions of the light and their differences, block by block, in ``ORDER``, (B * 2 * LANES,).
    """

    reach: np.ndarray
    middle: np.ndarray
    first: np.ndarray
    rows: np.ndarray
    columns: np.ndarray
    parts: np.ndarray


@lru_cache(maxsize=4)
def _running_sums(aperture: Aperture, side: int) -> np.ndarray:
    """Return the running sums of a point's image on its ``side`` of the focus, +1 or -1."""
    fine = _CELLS * _SAMPLES
    axis = side * ((np.arange(fine) + 0.5) * (2 / fine) - 1)
    light = transmission(aperture, axis[None, :], axis[:, None], side)
    cells = light.reshape(_CELLS, _SAMPLES, _CELLS, _SAMPLES).mean(axis=(1, 3))
    sums = np.pad(cells.cumsum(0).cumsum(1), ((1, 0), (1, 0)))
    return sums / sums[-1, -1]


def _parts(sums: np.ndarray, radius: float, reach: int) -> np.ndarray:
    """Return the fraction of the light on each pixel of a (2 reach + 1)^2 window."""
    edges = (np.arange(2 * reach + 2) - reach - 0.5) / radius
    position = np.clip((edges + 1) * (_CELLS / 2), 0, _CELLS)
    cell = np.minimum(position.astype(np.intp), _CELLS - 1)
    inside = position - cell
    down = sums[cell] * (1 - inside)[:, None] + sums[cell + 1] * inside[:, None]
    both = down[:, cell] * (1 - inside) + down[:, cell + 1] * inside
    parts = np.diff(np.diff(both, axis=0), axis=1)
    return np.where(parts > _MIN_FRACTION, parts, 0.0)


def _blocks(lower: np.ndarray, upper: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the number of blocks per row, (row, column) of each, and their fractions (B, 2, LANES)."""
    lit = np.maximum(lower, upper) > 0
    start = lit.argmax(1)
    length = np.where(lit.any(1), lit.shape[1] - lit[:, ::-1].argmax(1) - start, 0)
    counts = -(-length // LANES)
    row = np.repeat(np.arange(len(lit)), counts)
    column = start[row] + LANES * (np.arange(len(row)) - np.repeat(np.cumsum(counts) - counts, counts))
    pixels = row[:, None], column[:, None] + np.array(ORDER)
    pair = [np.pad(window, ((0, 0), (0, LANES)))[pixels] for window in (lower, upper - lower)]
    return counts, np.stack([row, column], 1), np.stack(pair, 1)


def _radius_table(sums: np.ndarray, steps: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return middle, first, blocks and parts of one side, counted from 0."""
    middle, first, blocks, parts = [], [], [], []
    rows = total = 0
    for step in range(steps):
        radius = SMALLEST_RADIUS + step * STEP
        reach = math.floor(radius + STEP + 0.5)
        counts, places, pair = _blocks(_parts(sums, radius, reach), _parts(sums, radius + STEP, reach))
        first.append(total + np.concatenate([[0], np.cumsum(counts)]))
        blocks.append(places - reach)
        parts.append(pair)
        middle.append(rows + reach)
        rows += 2 * reach + 2
        total += len(places)
    return np.array(middle), np.concatenate(first), np.concatenate(blocks), np.concatenate(parts)


def shape_table(aperture: Aperture, radius: float, dtype: str) -> ShapeTable:
    """Return a table that reaches ``radius`` or ``LARGEST_TABLE``, of type ``dtype``, without cat's-eye.

    The tables of the last apertures are cached. A cached larger one serves a smaller radius.
    """
    limit = 8
    while limit < min(radius, LARGEST_TABLE):
        limit *= 2
    # The step that starts at the limit, and the one that follows it.
    steps = math.ceil((limit - SMALLEST_RADIUS) / STEP) + 2
    cached = _cached_table(aperture, dtype)
    if not cached or len(cached[0].reach) < steps:
        cached[:] = [_make_table(aperture, steps, dtype)]
    return cached[0]


@lru_cache(maxsize=MAX_CACHED_APERTURES)
def _cached_table(aperture: Aperture, dtype: str) -> list[ShapeTable]:
    """Return the list that holds the largest table computed so far."""
    return []


def _make_table(aperture: Aperture, steps: int, dtype: str) -> ShapeTable:
    front, behind = _running_sums(aperture, 1), _running_sums(aperture, -1)
    middle, first, blocks, parts = _radius_table(front, steps)
    middles = [middle, middle]
    if not np.array_equal(front, behind):
        other, other_first, other_blocks, other_parts = _radius_table(behind, steps)
        middles[1] = other + len(first)
        first = np.concatenate([first, other_first + len(blocks)])
        blocks, parts = np.concatenate([blocks, other_blocks]), np.concatenate([parts, other_parts])
    reach = np.floor(SMALLEST_RADIUS + (np.arange(steps) + 1) * STEP + 0.5)
    return ShapeTable(
        reach=reach.astype(np.int64),
        middle=np.stack(middles).astype(np.int64),
        first=first.astype(np.int64),
        rows=blocks[:, 0].astype(np.int32),
        columns=blocks[:, 1].astype(np.int32),
        parts=parts.astype(dtype).ravel(),
    )
