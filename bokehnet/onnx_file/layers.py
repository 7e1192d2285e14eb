"""Layers of a picture as ONNX operators: unmixed pixels at depth edges, and the occluded background.

Simpler than :mod:`bokehnet.classical.layered`: pixels are unmixed once from the means of their surfaces in a
window, without iterations and without location of the edges; the background is the mean that eight
directions find, without continued lines and exemplars; soft steps of the defocus are not sharpened, lights
are not treated apart, and there is no third layer.
"""

from typing import NamedTuple

import numpy as np

from bokehnet.classical.layered.boundaries.unmixing import MIN_FILTER_WEIGHT, PRIOR
from bokehnet.classical.layered.depth_discontinuities import DISCONTINUITY_THRESHOLD
from bokehnet.onnx_file.builder import Graph, Value
from bokehnet.optics.pixels.pixel_filter import DEFAULT_FILTER

__all__ = ["GraphLayers", "split_layers"]

# Directions in which the background is searched, rows and columns, and the number of doublings of the step.
_DIRECTIONS = ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1))
_DOUBLINGS = 7

# Spacing of the samples that a direction averages, as a fraction of its length.
_SAMPLE_SPACING = 0.25

# Change of the defocus per pixel up to which two directions meet one surface.
_MAX_SLOPE = 0.1

_EPSILON = 1e-9


class GraphLayers(NamedTuple):
    """First and second layer: colours (H W, 3), defocus (H W,); coverage of the first (H W,)."""

    colors: tuple[Value, Value]
    defocus: tuple[Value, Value]
    coverage: Value


class _Picture:
    """Flat picture (H W, 3) and defocus (H W,), read at rows and columns that are clipped to the border."""

    def __init__(self, g: Graph, image: Value, defocus: Value) -> None:
        self.g, self.height, self.width = g, defocus.size(0), defocus.size(1)
        self.colors, self.defocus = image.transpose(1, 2, 0).reshape(-1, 3), defocus.reshape(-1)

    def index(self, row: Value, column: Value) -> Value:
        """Return the index of pixels, int64."""
        g = self.g
        row = g.minimum(g.maximum(row, 0), self.height - 1)
        return row * self.width + g.minimum(g.maximum(column, 0), self.width - 1)


class _Mixed(NamedTuple):
    """Mixed pixels: index, defocus and colours of both surfaces, coverage, and whose the pixel's depth is."""

    places: Value
    near: Value
    far: Value
    front: Value
    back: Value
    coverage: Value
    is_front: Value


def _surfaces(g: Graph, picture: _Picture, index: Value) -> tuple[Value, Value, Value, Value]:
    """Return near and far defocus, coverage by the nearer, and whether that is the pixel's own, (N,)."""
    weights = np.maximum(DEFAULT_FILTER.weights(), MIN_FILTER_WEIGHT)
    reach = len(weights) // 2
    row, column = index // picture.width, index % picture.width
    own = picture.defocus.take(index)
    near, far = own, own
    sums = [own * 0 for _ in range(3)]
    for i in range(-reach, reach + 1):
        for j in range(-reach, reach + 1):
            weight = float(weights[i + reach] * weights[j + reach])
            defocus = picture.defocus.take(picture.index(row + i, column + j))
            before, behind = (
                (defocus > own + DISCONTINUITY_THRESHOLD),
                (defocus < own - DISCONTINUITY_THRESHOLD),
            )
            near = g.where(before, g.maximum(near, defocus), near)
            far = g.where(behind, g.minimum(far, defocus), far)
            for number, mask in enumerate((before, behind, ~(before | behind))):
                sums[number] = sums[number] + mask.astype(np.float32) * weight
    near_weight, far_weight, own_weight = sums
    is_back = near_weight >= far_weight
    by_near, by_own = near_weight / (near_weight + own_weight), own_weight / (far_weight + own_weight)
    coverage = g.where(is_back, by_near, by_own)
    return g.where(is_back, near, own), g.where(is_back, own, far), coverage, ~is_back


def _surface_means(
    g: Graph, picture: _Picture, mixed_weight: Value, index: Value, surfaces: tuple[Value, Value]
) -> list[tuple[Value, Value]]:
    """Return mean colour (N, 3) and variance (N, 1) of each surface in the window around its pixels."""
    reach = PRIOR.window_px
    offsets = np.mgrid[-reach : reach + 1, -reach : reach + 1].reshape(2, -1)
    window = np.exp(-(offsets**2).sum(0) / PRIOR.window_variance).astype(np.float32)
    rows, columns, weights = g.constant(offsets[0]), g.constant(offsets[1]), g.constant(window)
    row, column = index // picture.width, index % picture.width
    tolerance = (surfaces[0] - surfaces[1]) * 0.5
    tolerance = g.minimum(tolerance, DISCONTINUITY_THRESHOLD)

    def add(iteration: Value, *sums: Value) -> tuple[list[Value], list[Value]]:
        at = picture.index(row + rows.take(iteration), column + columns.take(iteration))
        color, defocus = picture.colors.take(at), picture.defocus.take(at)
        moments = g.concat([color, color * color, color.cut(1, 0, 1) * 0 + 1], 1)
        weight = mixed_weight.take(at) * weights.take(iteration)
        result = []
        for total, surface in zip(sums, surfaces, strict=True):
            member = (abs(defocus - surface) <= tolerance).astype(np.float32)
            result.append(total + moments * (member * weight).reshape(-1, 1))
        return result, []

    zeros = g.zeros(np.float32, index.size(0), 7)
    sums = g.loop(add, [zeros, zeros], times=g.sizes(offsets.shape[1]))
    means = []
    for total in sums:
        moments = total / g.maximum(total.cut(1, 6, 7), _EPSILON)
        color = moments.cut(1, 0, 3)
        variance = (moments.cut(1, 3, 6) - color * color).mean(1).reshape(-1, 1)
        means.append((color, g.maximum(variance, 0)))
    return means


def _unmix(g: Graph, picture: _Picture) -> _Mixed:
    """Return the mixed pixels, unmixed in closed form, see :mod:`...boundaries.unmixing`."""
    batch = picture.defocus.reshape(1, 1, picture.height, picture.width)
    window = {"kernel_shape": [3, 3], "pads": [1, 1, 1, 1]}
    highest = g.op("MaxPool", batch, **window).reshape(-1)
    lowest = -g.op("MaxPool", -batch, **window).reshape(-1)
    step = g.maximum(highest - picture.defocus, picture.defocus - lowest)
    is_mixed = step > DISCONTINUITY_THRESHOLD
    index = g.op("NonZero", is_mixed, dtype=np.int64).reshape(-1)
    near, far, initial, is_front = _surfaces(g, picture, index)
    weight = g.where(is_mixed, g.constant(PRIOR.mixed_weight, np.float32), g.constant(1, np.float32))
    (front, front_variance), (back, back_variance) = _surface_means(g, picture, weight, index, (near, far))
    pixel, coverage = picture.colors.take(index), initial.reshape(-1, 1)
    square = ((front * front).sum(1) + (back * back).sum(1)).reshape(-1, 1) / 3
    floor = square * PRIOR.min_relative_sigma**2 + PRIOR.min_sigma**2
    front_variance, back_variance = front_variance + floor, back_variance + floor

    def gains(coverage: Value) -> tuple[Value, Value, Value]:
        front_gain, back_gain = coverage * front_variance, (1 - coverage) * back_variance
        return front_gain, back_gain, coverage * front_gain + (1 - coverage) * back_gain

    shift = PRIOR.coverage_sigma**2
    front_gain, back_gain, spread = gains(coverage)
    difference = front - back
    error = pixel - coverage * front - (1 - coverage) * back
    along = (difference * error).sum(1).reshape(-1, 1)
    along = along / (spread + (difference * difference).sum(1).reshape(-1, 1) * shift)
    multiplier = (error - along * difference * shift) / spread
    front, back = front + front_gain * multiplier, back + back_gain * multiplier
    coverage = (coverage + along * shift).clip(0, 1)
    front_gain, back_gain, spread = gains(coverage)
    error = (pixel - coverage * front - (1 - coverage) * back) / spread
    front, back = g.maximum(front + front_gain * error, 0), g.maximum(back + back_gain * error, 0)
    return _Mixed(index, near, far, front, back, coverage.reshape(-1), is_front)


def _write(g: Graph, target: Value, index: Value, values: Value) -> Value:
    """Return the flat array with ``values`` at ``index``; no index repeats."""
    return g.op("ScatterND", target, index.reshape(-1, 1), values)


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


def _background(g: Graph, picture: _Picture, own: Value) -> tuple[Value, Value]:
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
    for direction, count, depth, length, weight in zip(
        _DIRECTIONS, counts, depths, lengths, inverse, strict=True
    ):
        apart = g.maximum(length, best_length)
        agrees = abs(depth - best_depth) <= apart * _MAX_SLOPE + DISCONTINUITY_THRESHOLD
        weight = weight * agrees.astype(np.float32)
        color, mean_depth = _edge_mean(g, picture, own, (row, column), direction, count, depth)
        total, depth_sum = total + weight, depth_sum + weight * mean_depth
        color_sum = color_sum + weight.reshape(-1, 1) * color
    total = g.maximum(total, _EPSILON)
    defocus = g.minimum(depth_sum / total, picture.defocus.take(index))
    colors = _write(g, own, index, color_sum / total.reshape(-1, 1))
    return colors, _write(g, picture.defocus, index, defocus)


def _edge_mean(
    g: Graph,
    picture: _Picture,
    own: Value,
    place: tuple[Value, Value],
    direction: tuple[int, int],
    count: Value,
    depth: Value,
) -> tuple[Value, Value]:
    """Return mean colour (N, 3) and defocus (N,) of the surface that a direction meets, from 3x3 samples."""
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
    return color_sum / total.reshape(-1, 1), depth_sum / total


def split_layers(g: Graph, image: Value, defocus: Value) -> GraphLayers:
    """Return the layers of a picture.

    Args:
        g: Open graph.
        image: Scene-linear picture, (3, H, W), float32.
        defocus: Signed blur radius in pixels, (H, W), float32.
    """
    picture = _Picture(g, image, defocus)
    mixed = _unmix(g, picture)
    side = mixed.is_front.reshape(-1, 1)
    own = _write(g, picture.colors, mixed.places, g.where(side, mixed.front, mixed.back))
    hidden, behind = _background(g, picture, own)
    last_color = g.where(side, hidden.take(mixed.places), mixed.back)
    last_depth = g.where(mixed.is_front, behind.take(mixed.places), mixed.far)
    ones = picture.defocus * 0 + 1
    return GraphLayers(
        colors=(
            _write(g, picture.colors, mixed.places, mixed.front),
            _write(g, hidden, mixed.places, last_color),
        ),
        defocus=(
            _write(g, picture.defocus, mixed.places, mixed.near),
            _write(g, behind, mixed.places, last_depth),
        ),
        coverage=_write(g, ones, mixed.places, mixed.coverage),
    )
