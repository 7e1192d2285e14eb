"""Polygonal apertures as ONNX operators: the spread of a pixel over a polygon, and samples of the pupil.

A convex polygon is tabulated by its rows: the ends of the chord at each height, and their integrals. The mean
of the ends over the height of a row of pixels is the difference of two integrals, so the area of the rows is
that of the polygon. Samples of the disc become samples of the polygon by the map that keeps areas: the height
has the same area below it, and the position along the chord is the same.
"""

import math
from dataclasses import dataclass

import numpy as np

from bokehnet.onnx_file.builder import Graph, Value

__all__ = ["Polygon", "read_polygon"]

# Number of rows of the table from -1 to 1.
_ROWS = 512

# Smallest area of a polygon, and smallest slope of an edge that bounds a chord.
_MIN_AREA, _MIN_SLOPE = 1e-3, 1e-6

_EPSILON = 1e-9


@dataclass(frozen=True, kw_only=True, slots=True)
class Polygon:
    """Table of a polygon in aperture coordinates, or of nothing.

    Attributes:
        exists: True if a polygon is given, (1,).
        ends: Left and right end of the chord at each height from -1 to 1, 0 where none is, (_ROWS + 1,) each.
        integrals: Their integrals from -1 to each height, (_ROWS + 1,) each.
        covered: Length of the heights with a chord from -1 to each height, (_ROWS + 1,).
    """

    exists: Value
    ends: tuple[Value, Value]
    integrals: tuple[Value, Value]
    covered: Value

    @property
    def area(self) -> Value:
        """Area of the polygon, (1,)."""
        left, right = self.integrals
        below = (right - left).cut(0, _ROWS, _ROWS + 1)
        return below.graph.maximum(below, _MIN_AREA)

    def mean_ends(self, radius: Value, row: Value) -> tuple[Value, Value, Value]:
        """Return the mean ends of a row of pixels, in pixels from the centre, and the row's covered fraction.

        Args:
            radius: Signed blur radii, pixels, (N,), not 0.
            row: Row, counted from the centre, (1,).
        """
        g = radius.graph
        size = abs(radius)
        middle = row.astype(np.float32) / radius
        low, high = middle - 0.5 / size, middle + 0.5 / size
        covered = _at(self.covered, high) - _at(self.covered, low)
        means = [(_at(x, high) - _at(x, low)) / g.maximum(covered, _EPSILON) * radius for x in self.integrals]
        return g.minimum(means[0], means[1]), g.maximum(means[0], means[1]), covered * size

    def samples(self, u: np.ndarray, v: np.ndarray) -> tuple[Value, Value]:
        """Return samples of the polygon from those of the disc, (N,) each; without a polygon the same."""
        g = self.exists.graph
        half_chord = np.sqrt(np.maximum(1 - v * v, 1e-12))
        below = 0.5 + (v * half_chord + np.arcsin(np.clip(v, -1, 1))) / math.pi
        along = np.clip(0.5 + 0.5 * u / half_chord, 0, 1)
        left, right = self.integrals
        areas = right - left
        target = g.constant(below, np.float32) * areas.cut(0, _ROWS, _ROWS + 1)
        row = (areas.reshape(1, -1) < target.reshape(-1, 1)).astype(np.int64).sum(1) - 1
        row = row.clip(0, _ROWS - 1)
        lower, upper = areas.take(row), areas.take(row + 1)
        position = row.astype(np.float32) + (target - lower) / g.maximum(upper - lower, 1e-12)
        height = position.clip(0.0, float(_ROWS)) * (2 / _ROWS) - 1
        ends = [_at(x, height) for x in self.ends]
        column = ends[0] + (ends[1] - ends[0]) * g.constant(along, np.float32)
        condition = self.exists
        return g.where(condition, column, g.constant(u, np.float32)), g.where(
            condition, height, g.constant(v, np.float32)
        )


def _at(table: Value, height: Value) -> Value:
    """Return a table at heights, interpolated; beyond -1 and 1 it is constant."""
    position = ((height + 1) * (_ROWS / 2)).clip(0.0, float(_ROWS))
    low = table.graph.floor(position).clip(0.0, _ROWS - 1.0)
    index = low.astype(np.int64)
    lower = table.take(index)
    return lower + (table.take(index + 1) - lower) * (position - low)


def read_polygon(g: Graph, vertices: Value) -> Polygon:
    """Return the table of a convex polygon.

    Args:
        g: Open graph.
        vertices: Corners in order, right and down in blur radii, within -1 and 1, (n, 2); (0, 2) is none.
    """
    exists = vertices.size(0) > 0
    square = g.constant([[-1, -1], [1, -1], [1, 1], [-1, 1]], np.float32)  # any polygon, for none
    corners = g.branch(exists, lambda: vertices.clip(-1.0, 1.0), lambda: square)
    count = corners.size(0)
    x, y = (corners.cut(1, c, c + 1).reshape(1, -1) for c in (0, 1))
    following = (g.count_up(count) + 1) % count
    next_x, next_y = (values.take(following, axis=1) for values in (x, y))
    turn = g.where((x * next_y - next_x * y).sum() < 0, -1.0, g.constant(1, np.float32))
    normal_x, normal_y = (next_y - y) * turn, (next_x - x) * turn * -1
    heights = g.constant(np.linspace(-1, 1, _ROWS + 1).reshape(-1, 1), np.float32)
    offset = normal_x * x + normal_y * y - heights * normal_y
    is_left, is_right = normal_x < -_MIN_SLOPE, normal_x > _MIN_SLOPE
    crossing = offset / g.where(is_left | is_right, normal_x, 1)
    left = g.where(is_left, crossing, -1).max(1)
    right = g.where(is_right, crossing, 1).min(1)
    flat = heights.reshape(-1)
    is_inside = (flat >= y.min()) & (flat <= y.max()) & (right > left)
    ends = tuple(g.where(is_inside, side, 0) for side in (left, right))
    return Polygon(
        exists=exists,
        ends=(ends[0], ends[1]),
        integrals=(_integral(ends[0]), _integral(ends[1])),
        covered=_integral(is_inside.astype(np.float32)),
    )


def _integral(values: Value) -> Value:
    """Return the integral of a table from its first height to each, by trapezoids."""
    g = values.graph
    steps = (values.cut(0, 0, _ROWS) + values.cut(0, 1, _ROWS + 1)) * (1 / _ROWS)
    return g.concat([g.zeros(np.float32, 1), g.op("CumSum", steps, g.constant(0))])
