"""Unmixing of the pixels at depth edges as ONNX operators.

The operators are those of :mod:`bokehnet.classical.layered.boundaries.unmixing`, with its iterations and the
location of edges.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from bokehnet.classical.layered.boundaries.unmixing import MIN_FILTER_WEIGHT, PRIOR
from bokehnet.classical.layered.depth_discontinuities import DISCONTINUITY_THRESHOLD
from bokehnet.onnx_file.builder import Graph, Value
from bokehnet.optics.pixels.pixel_filter import DEFAULT_FILTER

__all__ = ["MixedPixels", "Picture", "unmix", "write_rows"]

_EPSILON = 1e-9

# Upper bound of a variance that nothing limits.
_NO_LIMIT = 1e30


class Picture:
    """Flat picture (H W, 3) and defocus (H W,), read at rows and columns that are clipped to the border."""

    def __init__(self, g: Graph, image: Value, defocus: Value) -> None:
        self.g, self.height, self.width = g, defocus.size(0), defocus.size(1)
        self.colors, self.defocus = image.transpose(1, 2, 0).reshape(-1, 3), defocus.reshape(-1)

    def index(self, row: Value, column: Value) -> Value:
        """Return the index of pixels, int64."""
        g = self.g
        row = g.minimum(g.maximum(row, 0), self.height - 1)
        return row * self.width + g.minimum(g.maximum(column, 0), self.width - 1)


class MixedPixels(NamedTuple):
    """Mixed pixels: index, defocus and colours of both surfaces, coverage, and whose the pixel's depth is."""

    places: Value
    near: Value
    far: Value
    front: Value
    back: Value
    coverage: Value
    is_front: Value


def _surfaces(g: Graph, picture: Picture, index: Value) -> tuple[Value, Value, Value, Value]:
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


class _Surfaces(NamedTuple):
    """Both surfaces of mixed pixels: colours (N, 3), coverage (N, 1) by the nearer."""

    front: Value
    back: Value
    coverage: Value


class _Evidence(NamedTuple):
    """Constants of the unmixing: place, own colour, defocus of both surfaces, and tolerance of membership."""

    place: Value
    pixel: Value
    near: Value
    far: Value
    tolerance: Value


def _window(picture: Picture, index: Value, reach: int) -> tuple[Callable[[Value], Value], np.ndarray]:
    """Return a function that returns the neighbours of a number, and the offsets of all numbers, (2, N)."""
    offsets = np.mgrid[-reach : reach + 1, -reach : reach + 1].reshape(2, -1)
    rows, columns = (picture.g.constant(axis) for axis in offsets)
    row, column = index // picture.width, index % picture.width

    def at(number: Value) -> Value:
        return picture.index(row + rows.take(number), column + columns.take(number))

    return at, offsets


def _variance(g: Graph, moments: Value) -> tuple[Value, Value]:
    """Return mean (N, 3) and variance (N, 1) of sums of colours, their squares, and weights, (N, 7)."""
    means = moments / g.maximum(moments.cut(1, 6, 7), _EPSILON)
    color = means.cut(1, 0, 3)
    return color, g.maximum((means.cut(1, 3, 6) - color * color).mean(1).reshape(-1, 1), 0)


def _surface_means(
    g: Graph, picture: Picture, is_mixed: Value, known: _Evidence
) -> list[tuple[Value, Value, Value]]:
    """Return mean colour (N, 3), variance (N, 1) and its upper bound of each surface around its pixels."""
    at, offsets = _window(picture, known.place, PRIOR.window_px)
    weights = g.constant(np.exp(-(offsets**2).sum(0) / PRIOR.window_variance).astype(np.float32))
    mixed_weight = g.where(is_mixed, g.constant(PRIOR.mixed_weight, np.float32), g.constant(1, np.float32))
    is_pure = (~is_mixed).astype(np.float32)

    def add(iteration: Value, *sums: Value) -> tuple[list[Value], list[Value]]:
        place = at(iteration)
        color, defocus = picture.colors.take(place), picture.defocus.take(place)
        moments = g.concat([color, color * color, color.cut(1, 0, 1) * 0 + 1], 1)
        weight, pure = mixed_weight.take(place) * weights.take(iteration), is_pure.take(place)
        result = []
        for number, surface in enumerate((known.near, known.far)):
            member = (abs(defocus - surface) <= known.tolerance.reshape(-1)).astype(np.float32)
            result.append(sums[2 * number] + moments * (member * weight).reshape(-1, 1))
            result.append(sums[2 * number + 1] + moments * (member * pure).reshape(-1, 1))
        return result, []

    zeros = g.zeros(np.float32, known.place.size(0), 7)
    sums = g.loop(add, [zeros] * 4, times=g.sizes(offsets.shape[1]))
    means = [_variance(g, total) for total in (sums[0], sums[2])]
    limits = [_variance(g, total)[1] * PRIOR.max_variance_ratio for total in (sums[1], sums[3])]
    count = g.minimum(sums[1].cut(1, 6, 7), sums[3].cut(1, 6, 7))
    limits = [g.where(count >= PRIOR.min_pure_pixels, limit, _NO_LIMIT) for limit in limits]
    return [(*mean, limit) for mean, limit in zip(means, limits, strict=True)]


def _unmix_pixels(
    g: Graph, pixel: Value, start: _Surfaces, variances: tuple[Value, Value], sigma: float
) -> _Surfaces:
    """Return the most probable colours and coverage, from means and an expected coverage.

    The formulas are those of :mod:`bokehnet.classical.layered.boundaries.unmixing`.
    """
    front, back, coverage = start
    square = ((front * front).sum(1) + (back * back).sum(1)).reshape(-1, 1) / 3
    floor = square * PRIOR.min_relative_sigma**2 + PRIOR.min_sigma**2
    front_variance, back_variance = (variance + floor for variance in variances)

    def gains(coverage: Value) -> tuple[Value, Value, Value]:
        front_gain, back_gain = coverage * front_variance, (1 - coverage) * back_variance
        return front_gain, back_gain, coverage * front_gain + (1 - coverage) * back_gain

    shift = sigma**2
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
    front, back = front + front_gain * error, back + back_gain * error
    is_dark_front = (front < 0) & (coverage < 1)
    is_dark_back = (back < 0) & (coverage > 0) & ~is_dark_front
    rest_front = pixel / g.maximum(coverage, _EPSILON)
    rest_back = pixel / g.maximum(1 - coverage, _EPSILON)
    clipped = g.where(is_dark_front, 0.0, g.where(is_dark_back, rest_front, front))
    back = g.where(is_dark_front, rest_back, g.where(is_dark_back, 0.0, back))
    return _Surfaces(g.maximum(clipped, 0), g.maximum(back, 0), coverage)


class _Iterations(NamedTuple):
    """Number of iterations, deviation of the coverage, and largest variance (N, 1) of both surfaces."""

    times: int
    sigma: float
    limits: tuple[Value, Value]


def _iterate(
    g: Graph, picture: Picture, known: _Evidence, state: _Surfaces, expected: Value, settings: _Iterations
) -> _Surfaces:
    """Unmix again several times, from the unmixed colours of the 3x3 pixels around.

    Args:
        g: Open graph.
        picture: Picture.
        known: Constants of the mixed pixels.
        state: Surfaces of the previous iteration.
        expected: Coverage from the position of the edges, (N, 1).
        settings: Number of iterations, deviation of the coverage, and largest variances.
    """
    at, offsets = _window(picture, known.place, 1)
    weights = g.constant(np.exp(-(offsets**2).sum(0) / PRIOR.neighbour_variance).astype(np.float32))
    # Pure pixels are the near side of themselves, with the coverage whose weight is 1.
    pure = picture.defocus.reshape(-1, 1)
    whole = pure * 0 + (1 - PRIOR.min_weight) ** 0.5
    base = g.concat([picture.colors, picture.colors, pure, pure, whole], 1)
    depths = [known.near.reshape(-1, 1), known.far.reshape(-1, 1)]
    tolerance = known.tolerance

    def unmix(_: Value, *state: Value) -> tuple[list[Value], list[Value]]:
        front, back, coverage = state
        own = g.concat([front, back, *depths, coverage], 1)
        table = write_rows(g, base, known.place, own)

        def add(number: Value, *sums: Value) -> tuple[list[Value], list[Value]]:
            other = table.take(at(number))
            near, far, share = (other.cut(1, i, i + 1) for i in (6, 7, 8))
            result = []
            for total, depth in zip(sums, depths, strict=True):
                to_near, to_far = abs(near - depth), abs(far - depth)
                is_near = to_near <= to_far
                covered = g.where(is_near, share, 1 - share)
                member = g.minimum(to_near, to_far) <= tolerance
                weight = (covered * covered + PRIOR.min_weight) * weights.take(number)
                weight = weight * member.astype(np.float32)
                color = g.where(is_near, other.cut(1, 0, 3), other.cut(1, 3, 6))
                result.append(total + g.concat([color, color * color, weight * 0 + 1], 1) * weight)
            return result, []

        zeros = g.zeros(np.float32, known.place.size(0), 7)
        means = [_variance(g, total) for total in g.loop(add, [zeros, zeros], times=g.sizes(9))]
        variances = g.minimum(means[0][1], settings.limits[0]), g.minimum(means[1][1], settings.limits[1])
        start = _Surfaces(means[0][0], means[1][0], expected)
        return list(_unmix_pixels(g, known.pixel, start, variances, settings.sigma)), []

    return _Surfaces(*g.loop(unmix, list(state), times=g.sizes(settings.times)))


def _edge_slope(coverage: Value) -> Value:
    return (coverage * (1 - coverage) * 4).clip(PRIOR.min_edge_slope)


def _locate_edges(g: Graph, picture: Picture, known: _Evidence, initial: Value, state: _Surfaces) -> Value:
    """Return the coverage (N, 1) from the edge position common to the mixed pixels around."""
    at, offsets = _window(picture, known.place, PRIOR.edge_window_px)
    weights = np.exp(-(offsets**2).sum(0) / PRIOR.edge_window_variance).astype(np.float32)
    weights = g.constant(weights)
    difference = state.front - state.back
    contrast = (difference * difference).sum(1).reshape(-1, 1)
    contrast = contrast / (contrast + PRIOR.edge_contrast)
    slope = _edge_slope(initial)
    depths = [known.near.reshape(-1, 1), known.far.reshape(-1, 1)]
    own = g.concat([*depths, contrast * slope * (state.coverage - initial), contrast * slope * slope], 1)
    base = g.zeros(np.float32, picture.defocus.size(0), 4)
    base = base + g.constant(np.array([[1e9, 1e9, 0, 0]]), np.float32)
    table = write_rows(g, base, known.place, own)

    def add(number: Value, shift: Value, total: Value) -> tuple[list[Value], list[Value]]:
        other = table.take(at(number))
        is_near = abs(other.cut(1, 0, 1) - depths[0]) <= known.tolerance
        is_far = abs(other.cut(1, 1, 2) - depths[1]) <= known.tolerance
        weight = (is_near & is_far).astype(np.float32) * weights.take(number)
        return [shift + weight * other.cut(1, 2, 3), total + weight * other.cut(1, 3, 4)], []

    start = [initial * 0, initial * 0 + PRIOR.edge_prior_weight]
    shift, total = g.loop(add, start, times=g.sizes(offsets.shape[1]))
    return (initial + slope * shift / total).clip(0, 1)


def unmix(g: Graph, picture: Picture) -> MixedPixels:
    """Return the mixed pixels, unmixed as in :mod:`bokehnet.classical.layered.boundaries.unmixing`."""
    reach = len(DEFAULT_FILTER.weights()) // 2
    batch = picture.defocus.reshape(1, 1, picture.height, picture.width)
    window = {"kernel_shape": [2 * reach + 1] * 2, "pads": [reach] * 4}
    highest = g.op("MaxPool", batch, **window).reshape(-1)
    lowest = -g.op("MaxPool", -batch, **window).reshape(-1)
    step = g.maximum(highest - picture.defocus, picture.defocus - lowest)
    is_mixed = step > DISCONTINUITY_THRESHOLD
    index = g.op("NonZero", is_mixed, dtype=np.int64).reshape(-1)
    near, far, initial, is_front = _surfaces(g, picture, index)
    initial = initial.reshape(-1, 1)
    tolerance = g.minimum((near - far) * 0.5, DISCONTINUITY_THRESHOLD).reshape(-1, 1)
    known = _Evidence(index, picture.colors.take(index), near, far, tolerance)
    (front, *front_spread), (back, *back_spread) = _surface_means(g, picture, is_mixed, known)
    limits = front_spread[1], back_spread[1]
    variances = g.minimum(front_spread[0], limits[0]), g.minimum(back_spread[0], limits[1])
    start = _Surfaces(front, back, initial)
    state = _unmix_pixels(g, known.pixel, start, variances, PRIOR.coverage_sigma)
    settings = _Iterations(PRIOR.iterations, PRIOR.coverage_sigma, limits)
    state = _iterate(g, picture, known, state, initial, settings)
    located = _locate_edges(g, picture, known, initial, state)
    settings = _Iterations(PRIOR.located_iterations, PRIOR.located_sigma, limits)
    front, back, coverage = _iterate(g, picture, known, state, located, settings)
    return MixedPixels(index, near, far, front, back, coverage.reshape(-1), is_front)


def write_rows(g: Graph, target: Value, index: Value, values: Value) -> Value:
    """Return the flat array with ``values`` at ``index``; no index repeats."""
    return g.op("ScatterND", target, index.reshape(-1, 1), values)
