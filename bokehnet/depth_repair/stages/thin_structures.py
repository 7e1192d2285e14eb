"""Thin structures: restore wires, twigs and blades of grass of which a map has kept only pieces.

Networks, low resolution and erosion remove thin structures; of a fence only the crossings remain.

Method: ridge traversal by cross-section profiles, as in vessel and road tracing (Aylward and Bullitt,
"Initialization, noise, singularities, and scale in height ridge traversal for tubular object centerline
extraction", IEEE Transactions on Medical Imaging 2002). The acceptance criteria are ours:

1. A seed is a pixel next to a piece: a region nearer than its surroundings.
2. A line is traced from the seed away from the piece, in the direction of least change of its profile.
3. A line with constant colours and width and with contrast on both sides that ends at a piece of the same
   disparity belongs to both. It gets their disparity in the width that the picture shows.
4. Where many lines were restored, as in a net, the criteria for lines of the same colours nearby are relaxed:
   light and shadow may cross them, and they may leave the picture. This repeats while it restores more.
5. Twigs, blades and wires at the border of a net have an open end, without a piece. They are accepted if the
   piece at their start is equally thin, or if they have the colours of restored lines nearby.

Lines of a background can connect two near objects, too, but rarely have the colours of these objects and
rarely keep their colours and their width.

In: the picture, scene-linear (H, W, 3), and the map (H, W), any unit, rising towards the camera. Out: the map
in the same unit, nowhere farther away.
"""

import math

import numpy as np
from numba import prange

from bokehnet.classical.parallel import parallel_region
from bokehnet.depth_repair.filters import local_extremes
from bokehnet.depth_repair.stages.line_profile import (
    CONTRAST_RADIUS_PX,
    STEP_PX,
    color_difference_at,
    half_width,
    interpolate,
    line_contrast,
    order_statistic,
    profile_difference,
    sample_profile,
    steer,
    tangent,
)
from bokehnet.kernels import njit
from bokehnet.optics.encoding import encode

__all__ = ["restore_thin_structures"]

# Minimum and maximum distance of a seed from a piece, pixels.
_MIN_SEED_DISTANCE_PX, _MAX_SEED_DISTANCE_PX = 2, 4

# Maximum and minimum number of steps along a line.
_MAX_STEPS, _MIN_STEPS = 80, 5

# Turns per step: number of candidates on each side and their spacing, radians; the same at the start.
_TURNS, _TURN_RAD, _FIRST_TURNS, _FIRST_TURN_RAD = 3, 0.12, 6, 0.17

# Number of steps ahead by which turns are compared; the same at the start.
_LOOKAHEAD_STEPS, _FIRST_LOOKAHEAD_STEPS = 3, 5

# Maximum number of consecutive steps with another profile: something may occlude the line.
_MAX_GAP_STEPS = 4

# Maximum distance ahead at which a piece of the same disparity ends the line, pixels.
_END_DISTANCE_PX = 7

# Squared differences of encoded colours, summed over channels: maximum change of the profile in a step that
# is no gap; maximum difference of a line and its piece; minimum contrast of a line and its surroundings.
_MAX_PROFILE_CHANGE, _MAX_COLOR_DIFFERENCE, _MIN_CONTRAST = 0.02, 0.04, 0.03

# Half width of the window for the disparity of a piece, pixels: the border of a repaired piece may be soft.
_PIECE_RADIUS_PX = 7

# Number of pixels over which a line must continue inside a piece, and maximum mean change of its profile
# there.
_INSIDE_PX = 6
_MAX_CHANGE_INSIDE = 0.04

# Minimum ratio of the contrast and the change along a line; of likely lines, which light and shadow may
# cross; of likely straight lines.
_MIN_CONTRAST_RATIO, _LIKELY_CONTRAST_RATIO, _STRAIGHT_CONTRAST_RATIO = 20.0, 4.0, 2.5

# Circle around the end of a piece: radius, pixels, and number of samples.
_CIRCLE_RADIUS_PX = 8.0
_CIRCLE_SAMPLES = 48

# Likely lines: half width of the neighbourhood and sampling stride, pixels; minimum restored fraction of the
# neighbourhood; maximum number of rounds.
_NEIGHBOURHOOD_RADIUS_PX, _NEIGHBOURHOOD_STRIDE_PX, _MIN_RESTORED, _MAX_ROUNDS = 68, 4, 0.03, 8

# Minimum fraction of the points of a line without near surfaces on both sides.
_MIN_FREE = 0.75

# Minimum ratio of length and mean width, of any line and of likely lines.
_MIN_ELONGATION, _LIKELY_ELONGATION = 2.0, 1.2

# Maximum standard deviation of the width, pixels, of any, of likely and of likely straight lines; minimum
# ratio of the distance of the ends and the length, of any and of straight lines.
_MAX_ROUGHNESS_PX, _LIKELY_ROUGHNESS_PX, _STRAIGHT_ROUGHNESS_PX = 1.4, 2.0, 2.5
_MIN_STRAIGHTNESS, _STRAIGHT = 0.9, 0.98

# Reduction of each half width when a line is drawn, pixels, because several traces may overlap.
_INSET_PX = 0.25

# Minimum fraction of the steps into a thin piece without near surfaces on both sides.
_MIN_THIN = 0.75


@njit(cache=True)
def _disparity_at(disparity, y, x):  # type: ignore[no-untyped-def]
    """Return the disparity of the pixel at a position, NaN outside the map."""
    row, column = int(y + 0.5), int(x + 0.5)
    inside = 0 <= row < disparity.shape[0] and 0 <= column < disparity.shape[1]
    return disparity[row, column] if inside else np.nan


@njit(cache=True)
def _distance_to_end(disparity, depth, min_height, y, x, down, right):  # type: ignore[no-untyped-def]
    """Return the distance ahead at which the map has the disparity ``depth`` again, pixels, or -1."""
    for ahead in range(_END_DISTANCE_PX):
        if abs(_disparity_at(disparity, y + ahead * down, x + ahead * right) - depth) < min_height:
            return ahead
    return -1


@njit(cache=True)
def _trace(picture, disparity, min_height, y, x, depth, angle, likely, points):  # type: ignore[no-untyped-def]
    """Trace a line to a piece with the disparity ``depth``, or to an open end.

    Likely lines may leave the picture.

    Returns:
        Number of ``points`` (N, 2) that are set, 0 for no line; mean change of the profile; True if the end
        is open.
    """
    reference, profile = np.empty((3, 3)), np.empty((3, 3))
    sample_profile(picture, y, x, math.sin(angle), math.cos(angle), reference)
    change, change_on_line, gaps = 0.0, 0.0, 0
    for count in range(1, _MAX_STEPS + 1):
        angle, _ = steer(picture, y, x, angle, _TURNS, _TURN_RAD, _LOOKAHEAD_STEPS, reference, profile)
        down, right = math.sin(angle), math.cos(angle)
        y, x = y + STEP_PX * down, x + STEP_PX * right
        value_ahead = _disparity_at(disparity, y, x)
        leaves = math.isnan(value_ahead)
        if leaves or value_ahead > depth + min_height:
            is_open = not (likely and leaves)
            return (count - 1, change / count, is_open) if count > _MIN_STEPS else (0, 0.0, False)
        sample_profile(picture, y, x, down, right, profile)
        profile_change = profile_difference(profile, reference)
        change += profile_change
        gaps = gaps + 1 if profile_change > _MAX_PROFILE_CHANGE else 0
        if gaps > _MAX_GAP_STEPS:
            count -= gaps
            return (count, change_on_line / count, True) if count > _MIN_STEPS else (0, 0.0, False)
        if gaps == 0:
            change_on_line = change
            for k in range(3):
                for c in range(3):
                    reference[k, c] += 0.07 * (profile[k, c] - reference[k, c])
        points[count - 1, 0], points[count - 1, 1] = y, x
        ahead = (
            _distance_to_end(disparity, depth, min_height, y, x, down, right) if count >= _MIN_STEPS else -1
        )
        if ahead >= 0:
            for step in range(ahead):
                points[count + step, 0], points[count + step, 1] = y + step * down, x + step * right
            return count + ahead, change / count, False
    return 0, 0.0, False


@njit(cache=True)
def _change_inside(picture, y, x, down, right, reference, profile):  # type: ignore[no-untyped-def]
    """Return the mean change of the profile of a line on its way into a piece."""
    change = 0.0
    for step in range(_INSIDE_PX):
        reach = step + 1.0
        sample_profile(picture, y + reach * down, x + reach * right, down, right, profile)
        change += profile_difference(profile, reference) / _INSIDE_PX
    return change


@njit(cache=True)
def _is_isolated(disparity, max_disparity, y, x, down, right):  # type: ignore[no-untyped-def]
    """Return whether the surfaces on both sides of a line are no nearer than ``max_disparity``."""
    for side in range(-CONTRAST_RADIUS_PX, CONTRAST_RADIUS_PX + 1, 2 * CONTRAST_RADIUS_PX):
        if _disparity_at(disparity, y + side * right, x - side * down) > max_disparity:
            return False
    return True


@njit(cache=True)
def _is_thin(disparity, max_disparity, y, x, down, right):  # type: ignore[no-untyped-def]
    """Return whether a piece is thin ahead: near, without near surfaces on both sides."""
    thin = 0
    for step in range(1, _INSIDE_PX + 1):
        ahead, aside = y + step * down, x + step * right
        if _disparity_at(disparity, ahead, aside) > max_disparity:
            thin += _is_isolated(disparity, max_disparity, ahead, aside, down, right)
    return thin >= _MIN_THIN * _INSIDE_PX


@njit(cache=True)
def _is_line(picture, disparity, max_disparity, points, count, change, color, likely):  # type: ignore[no-untyped-def]
    """Return whether a trace has constant colours and width, and contrast on both sides.

    Unless it is NaN, ``color`` must match its mean colour. The criteria are relaxed for likely lines.
    """
    contrasts, widths, isolated = np.empty(count), np.empty(count), 0
    mean, square = np.zeros(3), np.zeros(3)
    length = 0.0
    for i in range(count):
        y, x = points[i]
        down, right = tangent(points, count, i)
        isolated += _is_isolated(disparity, max_disparity, y, x, down, right)
        contrasts[i] = line_contrast(picture, y, x, down, right)
        widths[i] = half_width(picture, y, x, down, right, 1)
        widths[i] += half_width(picture, y, x, down, right, -1)
        for c in range(3):
            value = interpolate(picture, y, x, c)
            mean[c] += value / count
            square[c] += value * value / count
        if i > 0:
            length += math.sqrt((y - points[i - 1, 0]) ** 2 + (x - points[i - 1, 1]) ** 2)
    color_difference = 0.0
    for c in range(3):
        change += max(0.0, square[c] - mean[c] * mean[c])
        color_difference += (mean[c] - color[c]) ** 2
    if color_difference > _MAX_COLOR_DIFFERENCE:
        return False
    contrast = order_statistic(contrasts, count // 10)
    end_distance = math.sqrt(
        (points[count - 1, 0] - points[0, 0]) ** 2 + (points[count - 1, 1] - points[0, 1]) ** 2
    )
    if likely and end_distance > _STRAIGHT * length:
        ratio, elongation, roughness = _STRAIGHT_CONTRAST_RATIO, _LIKELY_ELONGATION, _STRAIGHT_ROUGHNESS_PX
    elif likely:
        ratio, elongation, roughness = _LIKELY_CONTRAST_RATIO, _LIKELY_ELONGATION, _LIKELY_ROUGHNESS_PX
    else:
        ratio, elongation, roughness = _MIN_CONTRAST_RATIO, _MIN_ELONGATION, _MAX_ROUGHNESS_PX
    has_contrast = contrast > _MIN_CONTRAST and contrast > ratio * change and isolated > _MIN_FREE * count
    is_long = length > elongation * widths.mean() and end_distance > _MIN_STRAIGHTNESS * length
    return has_contrast and is_long and widths.std() < roughness


@njit(cache=True)
def _ends_at(disparity, max_disparity, y, x):  # type: ignore[no-untyped-def]
    """Return whether a piece ends here or is large: a circle around the position crosses it at most once."""
    crossings, inside = 0, False
    for i in range(_CIRCLE_SAMPLES + 1):
        angle = 2.0 * math.pi * i / _CIRCLE_SAMPLES
        v, u = (
            int(y + _CIRCLE_RADIUS_PX * math.sin(angle) + 0.5),
            int(x + _CIRCLE_RADIUS_PX * math.cos(angle) + 0.5),
        )
        v, u = min(max(v, 0), disparity.shape[0] - 1), min(max(u, 0), disparity.shape[1] - 1)
        near = disparity[v, u] > max_disparity
        crossings += near and not inside and i > 0
        inside = near
    return crossings <= 1


@njit(cache=True)
def _depth_inside(disparity, y, x):  # type: ignore[no-untyped-def]
    """Return the disparity of a piece from a pixel at its border, which may be soft."""
    height, width = disparity.shape
    nearest_disparity = disparity[y, x]
    for v in range(max(0, y - _PIECE_RADIUS_PX), min(height, y + _PIECE_RADIUS_PX + 1)):
        for u in range(max(0, x - _PIECE_RADIUS_PX), min(width, x + _PIECE_RADIUS_PX + 1)):
            nearest_disparity = max(nearest_disparity, disparity[v, u])
    return nearest_disparity


@njit(cache=True)
def _trace_from_seed(picture, disparity, min_height, seed, color, points):  # type: ignore[no-untyped-def]
    """Trace the line from a seed away from its piece into ``points`` (N, 2); return their number, 0 for none.

    A line with the ``color`` (3,) of restored lines nearby is likely. If ``color`` is NaN, the piece must end
    at the seed, and the line must continue inside the pieces at both ends. A line with an open end needs a
    thin piece or a matching colour.
    """
    y, x, v, u = seed
    likely = not math.isnan(color[0])
    if color_difference_at(picture, y, x, v, u) > _MAX_COLOR_DIFFERENCE:
        return 0
    if not likely and not _ends_at(disparity, disparity[v, u] - min_height, v, u):
        return 0
    profile, unset = np.empty((3, 3)), np.full((3, 3), np.nan)
    angle = math.atan2(y - v, x - u)
    angle, change = steer(
        picture, y, x, angle, _FIRST_TURNS, _FIRST_TURN_RAD, _FIRST_LOOKAHEAD_STEPS, unset, profile
    )
    if (
        change > _MAX_PROFILE_CHANGE
        or line_contrast(picture, y, x, math.sin(angle), math.cos(angle)) < _MIN_CONTRAST
    ):
        return 0
    depth = _depth_inside(disparity, v, u)
    count, change, is_open = _trace(
        picture, disparity, min_height, float(y), float(x), depth, angle, likely, points
    )
    is_confirmed = likely and not is_open
    if count == 0 or not _is_line(
        picture, disparity, depth - min_height, points, count, change, color, is_confirmed
    ):
        return 0
    if is_confirmed:
        return count
    reference = np.empty((3, 3))
    down, right = math.sin(angle), math.cos(angle)
    sample_profile(picture, y, x, down, right, reference)
    distance = math.sqrt((y - v) * (y - v) + (x - u) * (x - u))
    y, x = y - distance * down, x - distance * right
    if _change_inside(picture, y, x, -down, -right, reference[::-1], profile) > _MAX_CHANGE_INSIDE:
        return 0
    if is_open:
        return count if likely or _is_thin(disparity, depth - min_height, y, x, -down, -right) else 0
    y, x = points[count - 1]
    down, right = tangent(points, count, count - 1)
    return (
        count if _change_inside(picture, y, x, down, right, reference, profile) <= _MAX_CHANGE_INSIDE else 0
    )


@njit(cache=True, parallel=True)
def _find_seeds(disparity, min_height, ys, xs, seeds, is_marked):  # type: ignore[no-untyped-def]
    """Fill ``seeds`` (N, 4) with row and column of each seed and of the nearest pixel of its piece."""
    height, width = disparity.shape
    for i in prange(len(ys)):
        y, x = ys[i], xs[i]
        nearest_squared = 2 * _MAX_SEED_DISTANCE_PX * _MAX_SEED_DISTANCE_PX
        for v in range(max(0, y - _MAX_SEED_DISTANCE_PX), min(height, y + _MAX_SEED_DISTANCE_PX + 1)):
            for u in range(max(0, x - _MAX_SEED_DISTANCE_PX), min(width, x + _MAX_SEED_DISTANCE_PX + 1)):
                distance_squared = (v - y) * (v - y) + (u - x) * (u - x)
                if distance_squared < nearest_squared and disparity[v, u] > disparity[y, x] + min_height:
                    nearest_squared = distance_squared
                    seeds[i, 0], seeds[i, 1], seeds[i, 2], seeds[i, 3] = y, x, v, u
        is_marked[i] = (
            _MIN_SEED_DISTANCE_PX * _MIN_SEED_DISTANCE_PX
            < nearest_squared
            <= _MAX_SEED_DISTANCE_PX * _MAX_SEED_DISTANCE_PX
        )


@njit(cache=True, parallel=True)
def _mark_likely(picture, restored, seeds, is_marked, colors):  # type: ignore[no-untyped-def]
    """Mark seeds with many restored pixels nearby, and fill ``colors`` (N, 3) with their mean colours."""
    height, width = restored.shape
    for i in prange(len(seeds)):
        y, x = seeds[i, 0], seeds[i, 1]
        sampled_count = restored_count = 0
        total = np.zeros(3)
        for v in range(
            max(0, y - _NEIGHBOURHOOD_RADIUS_PX),
            min(height, y + _NEIGHBOURHOOD_RADIUS_PX + 1),
            _NEIGHBOURHOOD_STRIDE_PX,
        ):
            for u in range(
                max(0, x - _NEIGHBOURHOOD_RADIUS_PX),
                min(width, x + _NEIGHBOURHOOD_RADIUS_PX + 1),
                _NEIGHBOURHOOD_STRIDE_PX,
            ):
                sampled_count += 1
                if restored[v, u]:
                    restored_count += 1
                    for c in range(3):
                        total[c] += picture[v, u, c]
        is_marked[i] = restored_count >= _MIN_RESTORED * sampled_count
        for c in range(3):
            colors[i, c] = total[c] / max(restored_count, 1)


@njit(cache=True, parallel=True)
def _mark_lines(picture, disparity, min_height, seeds, colors, is_marked):  # type: ignore[no-untyped-def]
    """Mark seeds at which a line starts."""
    for i in prange(len(seeds)):
        points = np.empty((_MAX_STEPS + _END_DISTANCE_PX, 2))
        is_marked[i] = _trace_from_seed(picture, disparity, min_height, seeds[i], colors[i], points) > 0


@njit(cache=True)
def _draw_lines(picture, disparity, min_height, seeds, colors, result):  # type: ignore[no-untyped-def]
    """Draw the lines that start at the seeds into ``result``, in the width that the picture shows."""
    height, width = disparity.shape
    points, sides = np.empty((_MAX_STEPS + _END_DISTANCE_PX, 2)), np.empty((2, _MAX_STEPS + _END_DISTANCE_PX))
    for number in range(len(seeds)):
        seed = seeds[number]
        count = _trace_from_seed(picture, disparity, min_height, seed, colors[number], points)
        depth = _depth_inside(disparity, seed[2], seed[3])
        for i in range(count):
            down, right = tangent(points, count, i)
            for side in range(2):
                sides[side, i] = half_width(picture, points[i, 0], points[i, 1], down, right, 2 * side - 1)
        for i in range(count):
            down, right = tangent(points, count, i)
            first, last = max(0, i - 5), min(count, i + 6)
            width_before = order_statistic(sides[0, first:last], (last - first) // 2) - _INSET_PX
            width_after = order_statistic(sides[1, first:last], (last - first) // 2) - _INSET_PX
            reach = int(max(width_before, width_after)) + 2
            row, column = int(points[i, 0]), int(points[i, 1])
            for y in range(max(0, row - reach), min(height, row + reach + 1)):
                for x in range(max(0, column - reach), min(width, column + reach + 1)):
                    v, u = y - points[i, 0], x - points[i, 1]
                    if (
                        abs(v * down + u * right) <= STEP_PX
                        and -width_before <= v * right - u * down <= width_after
                    ):
                        result[y, x] = max(result[y, x], depth)


def restore_thin_structures(image: np.ndarray, disparity: np.ndarray, min_height: float) -> np.ndarray:
    """Return the map with thin structures of the picture restored between pieces of equal disparity.

    Args:
        image: All-in-focus picture, scene-linear, not negative, (H, W, 3), float32.
        disparity: Map, (H, W), float32, any unit, rising towards the camera.
        min_height: Minimum height of a depth edge, in the unit of the map.

    Returns:
        New map, (H, W), nowhere farther away than the input.
    """
    result = disparity.copy()
    if min(disparity.shape) < 2:
        return result
    ys, xs = np.nonzero(local_extremes(disparity, _MAX_SEED_DISTANCE_PX)[1] > disparity + min_height)
    picture = encode(np.minimum(image, 1.0)).astype(np.float32, copy=False)
    seeds, is_marked = np.empty((len(ys), 4), np.int64), np.empty(len(ys), np.bool_)
    with parallel_region:
        _find_seeds(disparity, min_height, ys, xs, seeds, is_marked)
    all_seeds = seeds[is_marked]
    _draw(picture, disparity, min_height, all_seeds, np.full((len(all_seeds), 3), np.nan), result)
    previous_count = 0
    for _ in range(_MAX_ROUNDS):
        restored = result != disparity
        restored_count = int(restored.sum())
        if restored_count == previous_count:  # no further line was restored
            break
        previous_count = restored_count
        is_marked, colors = np.empty(len(all_seeds), np.bool_), np.empty((len(all_seeds), 3))
        with parallel_region:
            _mark_likely(picture, restored, all_seeds, is_marked, colors)
        _draw(picture, disparity, min_height, all_seeds[is_marked], colors[is_marked], result)
    return result


def _draw(
    picture: np.ndarray,
    disparity: np.ndarray,
    min_height: float,
    seeds: np.ndarray,
    colors: np.ndarray,
    result: np.ndarray,
) -> None:
    """Draw the lines from seeds (N, 4) with expected colours (N, 3) into ``result``."""
    is_marked = np.empty(len(seeds), np.bool_)
    with parallel_region:
        _mark_lines(picture, disparity, min_height, seeds, colors, is_marked)
        _draw_lines(picture, disparity, min_height, seeds[is_marked], colors[is_marked], result)
