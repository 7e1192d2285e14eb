"""Layers of a picture as ONNX operators: unmixed pixels at depth edges, and the occluded background.

Pixels are unmixed in :mod:`bokehnet.onnx_file.occlusion.unmixing`. The rest is simpler than
:mod:`bokehnet.classical.layered`: the background is the mean that eight directions find, with lines only
along these directions and without exemplars; soft and slight steps of the defocus are not treated apart, nor
are lights, and there is no third layer.
"""

from typing import NamedTuple

import numpy as np

from bokehnet.classical.layered.depth_discontinuities import DISCONTINUITY_THRESHOLD
from bokehnet.onnx_file.builder import Graph, Value
from bokehnet.onnx_file.occlusion.unmixing import Picture, unmix, write_rows

__all__ = ["GraphLayers", "split_layers"]

# Directions in which the background is searched, rows and columns, and the number of doublings of the step.
_DIRECTIONS = ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1))
_DOUBLINGS = 7

# Spacing of the samples that a direction averages, as a fraction of its length.
_SAMPLE_SPACING = 0.25

# Change of the defocus per pixel up to which two directions meet one surface.
_MAX_SLOPE = 0.1

_EPSILON = 1e-9

# Relative difference of two sides up to which they count as alike, and the distance in pixels at which lines
# between them have the weight 1 / e.
_LINE_CONTRAST, _FADING_DISTANCE_PX = 0.05, 16.0


class GraphLayers(NamedTuple):
    """First and second layer: colours (H W, 3), defocus (H W,); coverage of the first (H W,)."""

    colors: tuple[Value, Value]
    defocus: tuple[Value, Value]
    coverage: Value


def _shift(g: Graph, x: Value, direction: tuple[int, int], step: Value | int, fill: float) -> Value:
    """Return (H, W) with the value of the pixel ``step`` pixels away, ``fill`` beyond the border."""
    for axis, sign in enumerate(direction):
        if sign == 0:
            continue
        at = g.count_up(x.size(axis)) + step * sign
        last = x.size(axis) - 1
        inside = (at >= 0) & (at <= last)
        shape = (-1, 1) if axis == 0 else (1, -1)
        x = g.where(inside.reshape(*shape), x.take(g.minimum(g.maximum(at, 0), last), axis), fill)
    return x


def _search(g: Graph, defocus: Value, direction: tuple[int, int]) -> tuple[Value, Value]:
    """Return the steps to the surface behind each pixel, 0 for none, and its defocus, (H, W).

    The steps double: a pixel takes over what the pixel at that distance has met, if it hides that, too.
    """
    length = float(np.hypot(*direction))
    next_to = _shift(g, defocus, direction, 1, 1e9)
    is_step = next_to < defocus - DISCONTINUITY_THRESHOLD

    def double(_: Value, step: Value, count: Value, behind: Value) -> tuple[list[Value], list[Value]]:
        other_count = _shift(g, count, direction, step, 0.0)
        other = _shift(g, behind, direction, step, 1e9)
        gap, total = defocus - other, other_count + step.astype(np.float32)
        valid = (
            (other_count > 0) & (gap > DISCONTINUITY_THRESHOLD) & (total * length <= gap + 2) & (count <= 0)
        )
        return [step * 2, g.where(valid, total, count), g.where(valid, other, behind)], []

    start = [g.sizes(1), is_step.astype(np.float32), g.where(is_step, next_to, defocus)]
    return tuple(g.loop(double, start, times=g.sizes(_DOUBLINGS))[1:])  # type: ignore[return-value]


def _background(g: Graph, picture: Picture, own: Value) -> tuple[Value, Value]:
    """Return colours (H W, 3) and defocus (H W,) of the occluded background; the picture where there is none.

    Args:
        g: Open graph.
        picture: Picture whose defocus is searched.
        own: Colours with the own surface of mixed pixels, (H W, 3).
    """
    grid = picture.defocus.reshape(picture.height, picture.width)
    searches = [_search(g, grid, direction) for direction in _DIRECTIONS]
    any_count = g.op("Max", *(count for count, _ in searches)).reshape(-1)
    index = g.op("NonZero", any_count, dtype=np.int64).reshape(-1)
    row, column = index // picture.width, index % picture.width
    counts = [count.reshape(-1).take(index) for count, _ in searches]
    depths = [depth.reshape(-1).take(index) for _, depth in searches]
    lengths = [count * float(np.hypot(*d)) for count, d in zip(counts, _DIRECTIONS, strict=True)]
    exists = [(count > 0).astype(np.float32) for count in counts]
    inverse = [e / g.maximum(length * length, 1) for e, length in zip(exists, lengths, strict=True)]

    def is_one_surface(i: int, j: int) -> Value:
        apart = g.maximum(lengths[i], lengths[j])
        return (abs(depths[i] - depths[j]) <= apart * _MAX_SLOPE + DISCONTINUITY_THRESHOLD).astype(np.float32)

    best, best_depth, best_length = row.astype(np.float32) * 0 - 1, depths[0], lengths[0]
    for i in range(len(searches)):
        support = exists[i] * sum(
            (inverse[j] * is_one_surface(i, j) for j in range(1, len(searches))),
            inverse[0] * is_one_surface(i, 0),
        )
        better = support > best
        best, best_depth = g.where(better, support, best), g.where(better, depths[i], best_depth)
        best_length = g.where(better, lengths[i], best_length)
    total, depth_sum = best * 0, best * 0
    color_sum = g.zeros(np.float32, index.size(0), 3)
    members, edge_colors = [], []
    for direction, count, depth, length, weight in zip(
        _DIRECTIONS, counts, depths, lengths, inverse, strict=True
    ):
        apart = g.maximum(length, best_length)
        agrees = abs(depth - best_depth) <= apart * _MAX_SLOPE + DISCONTINUITY_THRESHOLD
        weight = weight * agrees.astype(np.float32)
        color, mean_depth, edge_color = _edge_mean(g, picture, own, (row, column), direction, count, depth)
        total, depth_sum = total + weight, depth_sum + weight * mean_depth
        color_sum = color_sum + weight.reshape(-1, 1) * color
        members.append((weight > 0).astype(np.float32))
        edge_colors.append(edge_color)
    total = g.maximum(total, _EPSILON)
    defocus = g.minimum(depth_sum / total, picture.defocus.take(index))
    color = _with_lines(g, color_sum / total.reshape(-1, 1), members, lengths, edge_colors)
    colors = write_rows(g, own, index, color)
    return colors, write_rows(g, picture.defocus, index, defocus)


def _known_or_estimated(
    g: Graph, picture: Picture, own: Value, known: tuple[Value, Value] | None
) -> tuple[Value, Value]:
    """Return the known background if it has pixels, else :func:`_background`."""
    if known is None:
        return _background(g, picture, own)
    colors, defocus = known

    def estimated() -> Value:
        hidden, behind = _background(g, picture, own)
        return g.concat([hidden, behind.reshape(-1, 1)], 1)

    def given() -> Value:
        behind = g.minimum(defocus.reshape(-1), picture.defocus)
        return g.concat([g.maximum(colors, 0).reshape(-1, 3), behind.reshape(-1, 1)], 1)

    layer = g.branch(colors.size(0) > 0, given, estimated)
    return layer.cut(1, 0, 3), layer.cut(1, 3, 4).reshape(-1)


def _with_lines(
    g: Graph, mean: Value, members: list[Value], lengths: list[Value], edge_colors: list[Value]
) -> Value:
    """Return the occluded colours (N, 3) with lines that continue between two sides of an occluder.

    The background is interpolated along the row, column or diagonal on which both sides differ least. The
    farther the sides, the more the mean prevails.

    Args:
        g: Open graph.
        mean: Mean colours of the background, (N, 3).
        members: For each direction 1 where it meets the background, (N,).
        lengths: Distance in pixels in each direction, (N,).
        edge_colors: Colour that each direction meets, (N, 3).
    """
    total, nearest = mean.cut(1, 0, 1) * 0 + _EPSILON, mean.cut(1, 0, 1) * 0 + 1e9
    line = mean * _EPSILON
    for first in range(0, len(_DIRECTIONS), 2):
        a, b = edge_colors[first], edge_colors[first + 1]
        near, far = (lengths[i].reshape(-1, 1) for i in (first, first + 1))
        exists = (members[first] * members[first + 1]).reshape(-1, 1)
        apart = g.maximum(near + far, 1)
        square = ((a - b) * (a - b)).sum(1).reshape(-1, 1)
        level = ((a + b) * (a + b)).sum(1).reshape(-1, 1) * _LINE_CONTRAST**2 + _EPSILON
        weight = exists / (apart * apart * (square + level))
        line = line + (a * far + b * near) / apart * weight
        total = total + weight
        nearest = g.where(exists > 0, g.minimum(nearest, g.minimum(near, far)), nearest)
    fading = g.op("Exp", nearest * (-1 / _FADING_DISTANCE_PX))
    return mean + (line / total - mean) * fading


def _edge_mean(
    g: Graph,
    picture: Picture,
    own: Value,
    place: tuple[Value, Value],
    direction: tuple[int, int],
    count: Value,
    depth: Value,
) -> tuple[Value, Value, Value]:
    """Return colour (N, 3) and defocus (N,) of the surface that a direction meets, from 3x3 samples.

    The third value is the colour of the pixel that it meets, (N, 3).
    """
    steps = count.astype(np.int64)
    spacing = g.maximum(g.round(count * _SAMPLE_SPACING).astype(np.int64), 1)
    row, column = place[0] + steps * direction[0], place[1] + steps * direction[1]
    edge = picture.index(row, column)
    total, depth_sum, color_sum = count * 0 + _EPSILON, depth * _EPSILON, own.take(edge) * _EPSILON
    downs, rights = (
        g.constant(offset.ravel() + sign)
        for offset, sign in zip(np.mgrid[-1:2, -1:2], direction, strict=True)
    )

    def add(
        sample: Value, total: Value, depth_sum: Value, color_sum: Value
    ) -> tuple[list[Value], list[Value]]:
        at = picture.index(row + spacing * downs.take(sample), column + spacing * rights.take(sample))
        defocus = picture.defocus.take(at)
        member = (abs(defocus - depth) <= DISCONTINUITY_THRESHOLD).astype(np.float32)
        color_sum = color_sum + member.reshape(-1, 1) * own.take(at)
        return [total + member, depth_sum + member * defocus, color_sum], []

    total, depth_sum, color_sum = g.loop(add, [total, depth_sum, color_sum], times=g.sizes(9))
    return color_sum / total.reshape(-1, 1), depth_sum / total, own.take(edge)


def split_layers(
    g: Graph, image: Value, defocus: Value, background: tuple[Value, Value] | None = None
) -> GraphLayers:
    """Return the layers of a picture.

    Args:
        g: Open graph.
        image: Scene-linear picture, (3, H, W), float32.
        defocus: Signed blur radius in pixels, (H, W), float32.
        background: Known colours (H, W, 3) and defocus (H, W) of what the picture occludes, those of the
            picture elsewhere; of no pixels if they are unknown.
    """
    picture = Picture(g, image, defocus)
    mixed = unmix(g, picture)
    side = mixed.is_front.reshape(-1, 1)
    own = write_rows(g, picture.colors, mixed.places, g.where(side, mixed.front, mixed.back))
    hidden, behind = _known_or_estimated(g, picture, own, background)
    last_color = g.where(side, hidden.take(mixed.places), mixed.back)
    last_depth = g.where(mixed.is_front, behind.take(mixed.places), mixed.far)
    ones = picture.defocus * 0 + 1
    return GraphLayers(
        colors=(
            write_rows(g, picture.colors, mixed.places, mixed.front),
            write_rows(g, hidden, mixed.places, last_color),
        ),
        defocus=(
            write_rows(g, picture.defocus, mixed.places, mixed.near),
            write_rows(g, behind, mixed.places, last_depth),
        ),
        coverage=write_rows(g, ones, mixed.places, mixed.coverage),
    )
