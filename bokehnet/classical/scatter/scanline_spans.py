"""Shape of a point's light as spans of rows: the input of spreading by differences on tensors.

A span is a row of pixels, counted from the source, from a first column to the one behind its last, with the
same fraction of the light on each; spans of one row may overlap and then add up. A round shape has
about six spans per pixel of radius, whatever its area, and so has any evenly lit one. Where the light
varies inside the shape (rim, pictures) nearly each of its pixels is a span of its own.

A radius table contains the spans for a series of radii; between two of them the fractions are linear.
Discs beyond its last radius are listed on demand, as far as they can be inside the picture. The
values are those of the other kernels: :mod:`bokehnet.classical.scatter.disc_table` for discs (beyond the
radius table these are exact there, and within 2 in 10,000 of the light here),
:mod:`bokehnet.classical.scatter.aperture_table` for all others.
"""

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from bokehnet.classical.scatter.aperture_table import LARGEST_TABLE, STEP, shape_table
from bokehnet.classical.scatter.disc_table import SMALLEST_RADIUS, TABLE_RADIUS, disc_table, list_row
from bokehnet.classical.simd.float8 import LANES, ORDER
from bokehnet.kernels import njit
from bokehnet.optics.aperture import Aperture

__all__ = [
    "FAR_STEPS",
    "RadiusTable",
    "Spans",
    "far_radius",
    "list_far_discs",
    "make_radius_table",
    "radius_table_limit",
]

# Steps per doubling of the radius for discs beyond the radius table. Between two of them less than 2 in
# 10,000 of the light move.
FAR_STEPS = 512

# Radius tables of shapes other than discs have two sizes. The shorter is enough where large shapes are
# scattered on smaller pictures.
_SHORT_LIMIT, _LONG_LIMIT = 16, LARGEST_TABLE

# Adjacent fractions that differ by less than this fraction of the largest are one span: the difference is the
# rounding error of running sums.
_EQUALITY_TOLERANCE = 2.0**-30


class Spans(NamedTuple):
    """Spans of n shapes, one shape after the other.

    Attributes:
        first: Index of each shape's first span; it ends where the next one begins, (n + 1,).
        rows: Row, counted from the source, (m,).
        left: First column, counted from the source, (m,).
        right: Column behind the last, counted from the source, (m,).
        parts: Fraction of the light on each pixel, (m,).
        slopes: Derivative of the fraction by the radius in pixels, (m,).
    """

    first: np.ndarray
    rows: np.ndarray
    left: np.ndarray
    right: np.ndarray
    parts: np.ndarray
    slopes: np.ndarray


class RadiusTable(NamedTuple):
    """Spans for all radii below ``limit``.

    Attributes:
        spans: Spans of step i in front of focus; if the other side differs, those behind focus follow.
        radii: Radius at which step i starts, ascending, pixels, (steps,).
        limit: First radius beyond the table, pixels.
        two_sided: True if shapes behind focus differ from those in front of it.
    """

    spans: Spans
    radii: np.ndarray
    limit: float
    two_sided: bool


def _join(lengths: np.ndarray, *columns: np.ndarray) -> Spans:
    """Return spans from the number of them in each shape, and their columns."""
    first = np.concatenate([[0], np.cumsum(lengths)])
    rows, left, right = (column.astype(np.int32) for column in columns[:3])
    return Spans(first, rows, left, right, columns[3], columns[4])


def _spans_of_ends(shape: np.ndarray, shapes: int, places: np.ndarray, weights: np.ndarray) -> Spans:
    """Convert the lower halves of discs, from :func:`list_row`, to whole ones."""
    k, j = places.T
    below = k > 0  # row 0 is listed as its lower half
    weights = np.where(below[:, None], weights, 2 * weights)
    rows = np.concatenate([k, -k[below]])
    reach = np.concatenate([j, j[below]])
    parts = np.concatenate([weights, weights[below]])
    shape = np.concatenate([shape, shape[below]])
    order = np.argsort(shape, kind="stable")
    lengths = np.bincount(shape, minlength=shapes)
    return _join(lengths, rows[order], -reach[order], reach[order] + 1, *parts[order].T)


def _disc_radius_table() -> RadiusTable:
    table = disc_table()
    shape = np.repeat(np.arange(len(table.first)), table.first[:, -1] - table.first[:, 0])
    spans = _spans_of_ends(shape, len(table.first), table.places, table.weights)
    return RadiusTable(spans, table.radii[:-1], TABLE_RADIUS, False)


@njit(cache=True)
def _list_disc(radius, rows, border, places, weights):
    """List the ends of one disc, down to ``rows`` (exclusive); return their number."""
    count = 0
    for k in range(rows):
        count = list_row(radius, k, border, count, places, weights)
    return count


def _ends_of_disc(radius: float, height: int, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Return places (n, 2) and weights (n,) of a disc's ends as far as they are inside a picture."""
    longest = width + 3 * height + 8
    places, weights = np.empty((longest, 2), np.int32), np.empty((longest, 2))
    count = _list_disc(radius, min(height, int(radius + 0.5) + 1), width, places, weights)
    return places[:count].copy(), weights[:count, 0].copy()


def far_radius(step: Any) -> Any:
    """Return the start radius in pixels of a step of the discs beyond the radius table."""
    return TABLE_RADIUS * 2.0 ** (step / FAR_STEPS)


def list_far_discs(steps: np.ndarray, height: int, width: int) -> Spans:
    """List discs beyond the table: each shape interpolates between a step's disc and the next one's.

    Args:
        steps: Steps, see :func:`far_radius`, (n,), n > 0.
        height: Height of the picture, pixels; ends beyond it are omitted.
        width: Width of the picture, pixels.

    Returns:
        Spans of n shapes, in the order of the steps.
    """
    places, weights, shapes = [], [], []
    for shape, step in enumerate(steps):
        length = far_radius(step + 1) - far_radius(step)
        for offset in (0, 1):
            ends, strengths = _ends_of_disc(far_radius(int(step) + offset), height, width)
            slopes = strengths / length
            places.append(ends)
            weights.append(np.stack([strengths, -slopes] if offset == 0 else [0 * strengths, slopes], 1))
            shapes.append(np.full(len(ends), shape))
    listed = np.concatenate(places), np.concatenate(weights)
    return _spans_of_ends(np.concatenate(shapes), len(steps), *listed)


def _spans_of_blocks(
    shape: np.ndarray, shapes: int, rows: np.ndarray, columns: np.ndarray, parts: np.ndarray
) -> Spans:
    """Convert blocks of pixels, from the tables of shapes, to spans.

    Args:
        shape: Shape of each block, ascending, (B,).
        shapes: Number of shapes.
        rows: See :class:`bokehnet.classical.scatter.aperture_table.ShapeTable`.
        columns: See the same class.
        parts: See the same class.
    """
    pairs = parts.reshape(-1, 2, LANES)[:, :, np.argsort(ORDER)]
    peaks = np.full(shapes, 1e-300)
    np.maximum.at(peaks, shape, np.abs(pairs).max(axis=(1, 2)))
    keys = np.rint(pairs / (_EQUALITY_TOLERANCE * peaks[shape, None, None])).transpose(0, 2, 1).reshape(-1, 2)
    lit = keys.any(axis=1)
    column = np.repeat(columns, LANES)[lit] + np.tile(np.arange(LANES), len(rows))[lit]
    row, owner, keys = np.repeat(rows, LANES)[lit], np.repeat(shape, LANES)[lit], keys[lit]
    values = pairs.transpose(0, 2, 1).reshape(-1, 2)[lit]
    starts = np.ones(len(column), bool)
    starts[1:] = (np.diff(column) != 1) | (np.diff(row) != 0) | (np.diff(owner) != 0)
    starts[1:] |= (np.diff(keys, axis=0) != 0).any(axis=1)
    begin = np.flatnonzero(starts)
    right = column[np.append(begin[1:], len(column)) - 1] + 1
    lengths = np.bincount(owner[begin], minlength=shapes)
    lower, rise = values[begin].T
    return _join(lengths, row[begin], column[begin], right, lower, rise / STEP)


def _shape_radius_table(aperture: Aperture, reach: int) -> RadiusTable:
    table = shape_table(aperture, reach, "float64")
    steps = len(table.reach)
    two_sided = bool(table.middle[1, 0] != table.middle[0, 0])
    middle = table.middle if two_sided else table.middle[:1]
    begin, end = table.first[middle - table.reach].ravel(), table.first[middle + table.reach + 1].ravel()
    shape = np.repeat(np.arange(middle.size), end - begin)
    spans = _spans_of_blocks(shape, middle.size, table.rows, table.columns, table.parts)
    radii = SMALLEST_RADIUS + STEP * np.arange(steps)
    return RadiusTable(spans, radii, SMALLEST_RADIUS + STEP * steps, two_sided)


def radius_table_limit(aperture: Aperture | None, radius: float) -> int:
    """Return the argument ``reach`` of :func:`make_radius_table` for shapes of up to ``radius`` pixels."""
    if aperture is None:
        return int(TABLE_RADIUS)
    return _SHORT_LIMIT if radius <= _SHORT_LIMIT else _LONG_LIMIT


@lru_cache(maxsize=8)
def make_radius_table(aperture: Aperture | None, reach: int) -> RadiusTable:
    """Return the radius table of an aperture; the last tables are cached.

    Args:
        aperture: Shape of the aperture, without its cat's-eye; None for a disc.
        reach: Minimum radius in pixels at which the table ends, from :func:`radius_table_limit`.
    """
    return _disc_radius_table() if aperture is None else _shape_radius_table(aperture, reach)
