"""Depth brush: strokes on a map, stored as paths, so that they apply to maps of any size."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from bokehnet.errors import ParameterError
from bokehnet.io.color.srgb import linear_to_srgb

__all__ = ["Effect", "Stroke", "painted"]

Effect = Literal["nearer", "farther", "same", "sharp", "hidden"]

Array = NDArray[np.float32]

_MAX_POINTS = 2000

# Quantile of the map around a stroke that counts as the farthest surface, robust against noise.
_FARTHEST_QUANTILE = 0.02

# Minimum scale of differences of encoded colours, 0 to 1, for a brush that respects edges.
_MIN_COLOR_SIGMA = 0.06


@dataclass(frozen=True, kw_only=True, slots=True)
class Stroke:
    """Stroke of the brush.

    Attributes:
        effect: ``nearer`` and ``farther`` move by ``strength``, ``same`` sets the depth at the start of the
            stroke, ``sharp`` that of the current focus, ``hidden`` that of the farthest surface around the
            stroke, as seen between hair or through a fence.
        points: Points of its path, (x, y) relative to the picture's width and height.
        radius: Radius relative to the picture's width.
        strength: Shift relative to the range of the map.
        edges: True to paint only pixels with colours similar to those under the middle of the stroke.

    Raises:
        ParameterError: A value is out of range.
    """

    effect: Effect
    points: tuple[tuple[float, float], ...]
    radius: float
    strength: float = 0.1
    edges: bool = True

    def __post_init__(self) -> None:
        if self.effect not in get_args(Effect):
            raise ParameterError("stroke.effect", f"one of {', '.join(get_args(Effect))}", self.effect)
        for name, high in (("radius", 0.5), ("strength", 1.0)):
            if not 0 < getattr(self, name) <= high:
                raise ParameterError(f"stroke.{name}", f"above 0 and up to {high:g}", getattr(self, name))
        inside = all(-1 <= x <= 2 and -1 <= y <= 2 for x, y in self.points)
        if not (1 <= len(self.points) <= _MAX_POINTS and inside):
            raise ParameterError("stroke.points", f"1 to {_MAX_POINTS} points in the picture", shown="others")

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> "Stroke":
        """Return the stroke of a table from a page or a session file, or raise ``ParameterError``.

        Examples:
            >>> Stroke.from_table({"effect": "nearer", "points": [[0.5, 0.5]], "radius": 0.1}).strength
            0.1
        """
        try:
            return cls(
                effect=table["effect"],
                points=tuple((float(x), float(y)) for x, y in table["points"]),
                radius=float(table["radius"]),
                strength=float(table.get("strength", 0.1)),
                edges=bool(table.get("edges", True)),
            )
        except (KeyError, TypeError, ValueError) as error:
            if isinstance(error, ParameterError):
                raise
            raise ParameterError("stroke", "effect, points and radius", shown="something else") from error

    def to_table(self) -> dict[str, Any]:
        """Return a table for :meth:`from_table`."""
        points = [list(point) for point in self.points]
        return {
            "effect": self.effect,
            "points": points,
            "radius": self.radius,
            "strength": self.strength,
            "edges": self.edges,
        }


def painted(values: Array, image: Array, strokes: Sequence[Stroke], focus: float | None = None) -> Array:
    """Return a map with strokes applied; strokes of effect ``sharp`` come last.

    Args:
        values: Disparity, (H, W), near is large.
        image: Picture, scene-linear, (H, W, 3), for brushes that respect edges.
        strokes: Strokes in the order of drawing.
        focus: Focus in the unit of the map; None skips strokes of effect ``sharp``.

    Examples:
        >>> values, image = np.full((9, 9), 0.5, np.float32), np.ones((9, 9, 3), np.float32)
        >>> dot = Stroke(effect="sharp", points=((0.5, 0.5),), radius=0.2)
        >>> result = painted(values, image, [dot], focus=0.75)
        >>> float(result[4, 4]), float(result[0, 0])
        (0.75, 0.5)
    """
    result = values.copy()
    low, high = float(values.min()), float(values.max())
    span = high - low or 1.0
    for stroke in sorted(strokes, key=lambda stroke: stroke.effect == "sharp"):
        if stroke.effect == "sharp" and focus is None:
            continue
        rows, columns, weight = _weight(stroke, image)
        under = result[rows, columns]
        if stroke.effect in ("nearer", "farther"):
            step = stroke.strength * span * (1 if stroke.effect == "nearer" else -1)
            new = np.clip(
                under + step * weight, min(low, 0), max(high, 1) if low >= 0 and high <= 1 else high
            )
        else:
            target = _target(stroke, result, focus, under)
            new = np.where(weight >= 0.5, np.float32(target), under)  # no values between surfaces
        result[rows, columns] = new
    return result


def _target(stroke: Stroke, values: Array, focus: float | None, under: Array) -> float:
    """Return the depth set by a stroke; ``under`` is the map in its bounding box."""
    if stroke.effect == "sharp":
        assert focus is not None
        return focus
    if stroke.effect == "hidden":
        return float(np.quantile(under, _FARTHEST_QUANTILE)) if under.size else 0.0
    return _value_at(values, stroke.points[0])


def _value_at(values: Array, point: tuple[float, float]) -> float:
    height, width = values.shape
    row, column = int(np.clip(point[1] * height, 0, height - 1)), int(np.clip(point[0] * width, 0, width - 1))
    return float(values[row, column])


def _weight(stroke: Stroke, image: Array) -> tuple[slice, slice, Array]:
    """Return rows and columns of a stroke's bounding box, and its weight per pixel, 0 to 1."""
    height, width = image.shape[:2]
    radius = max(stroke.radius * width, 0.75)
    path = np.asarray(stroke.points, np.float32) * (width, height) - 0.5
    (left, top), (right, bottom) = path.min(0) - radius - 1, path.max(0) + radius + 2
    rows = slice(int(np.clip(top, 0, height)), int(np.clip(bottom, 0, height)))
    columns = slice(int(np.clip(left, 0, width)), int(np.clip(right, 0, width)))
    distance = np.full((rows.stop - rows.start, columns.stop - columns.start), np.inf, np.float32)
    for begin, end in pairwise(path) if len(path) > 1 else ((path[0], path[0]),):
        _update_distance(distance, (columns.start, rows.start), begin, end, radius)
    weight = np.clip((radius - distance) / max(0.2 * radius, 1) + 0.5, 0, 1).astype(np.float32)
    if stroke.edges and weight.size:
        weight *= _color_similarity(image[rows, columns], distance <= 0.4 * radius)
    return rows, columns, weight


def _update_distance(
    distance: Array, corner: tuple[int, int], begin: Array, end: Array, radius: float
) -> None:
    """Lower distances (H, W), whose first pixel is at ``corner``, to those from one segment of the path."""
    height, width = distance.shape
    low, high = np.minimum(begin, end) - radius - 1, np.maximum(begin, end) + radius + 2
    x0, x1 = (int(np.clip(edge - corner[0], 0, width)) for edge in (low[0], high[0]))
    y0, y1 = (int(np.clip(edge - corner[1], 0, height)) for edge in (low[1], high[1]))
    x = np.arange(x0, x1, dtype=np.float32)[None] + np.float32(corner[0]) - begin[0]
    y = np.arange(y0, y1, dtype=np.float32)[:, None] + np.float32(corner[1]) - begin[1]
    segment = end - begin
    t = np.clip((x * segment[0] + y * segment[1]) / max(float(segment @ segment), 1e-9), 0, 1)
    window = distance[y0:y1, x0:x1]
    np.minimum(window, np.hypot(x - t * segment[0], y - t * segment[1]), out=window)


def _color_similarity(image: Array, core: NDArray[np.bool_]) -> Array:
    """Return 1 for colours of the core, falling to 0 within 3 sigma; image (H, W, 3), core (H, W)."""
    colors = np.asarray(linear_to_srgb(np.clip(image, 0, 1)), np.float32)
    inside = colors[core] if core.any() else colors.reshape(-1, 3)
    deviation = np.abs(colors - np.median(inside, axis=0)) / np.maximum(inside.std(axis=0), _MIN_COLOR_SIGMA)
    result: Array = np.clip((3 - deviation.max(axis=-1)) / 1.5, 0, 1)
    return result
