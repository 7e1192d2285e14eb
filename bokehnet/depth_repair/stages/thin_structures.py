"""Thin structures: restore wires, twigs and blades of grass of which a map has kept only pieces.

Networks, low resolution and erosion remove thin structures; of a fence only the crossings remain.

Method: ridge traversal by cross-section profiles, as in vessel and road tracing (Aylward and Bullitt,
"Initialization, noise, singularities, and scale in height ridge traversal for tubular object centerline
extraction", IEEE Transactions on Medical Imaging 2002). The acceptance criteria are ours:

1. A seed is a pixel next to a piece: a region nearer than its surroundings.
2. A line is traced from the seed away from the piece, in the direction of least change of its profile.
3. A line with constant colours and with contrast on both sides that ends at a piece of the same disparity
   belongs to both. It gets their disparity in the width that the picture shows.
4. Where many lines were restored, as in a net, the criteria for lines of the same colours nearby are relaxed
   once: light and shadow may cross them, and they may leave the picture.
5. Twigs, blades and wires at the border of a net have an open end, without a piece. They are accepted if the
   piece at their start is equally thin, or if they have the colours of restored lines nearby.

Lines of a background can connect two near objects, too, but rarely have the colours of these objects and
rarely keep their colours.

In: the picture, scene-linear (H, W, 3), and the map (H, W), any unit, rising towards the camera. Out: the map
in the same unit, nowhere farther away.
"""

import math

import numpy as np
from numba import prange

from bokehnet.arrays.box_mean import box_mean
from bokehnet.arrays.square_windows import reduce_windows
from bokehnet.classical.parallel import parallel_region
from bokehnet.depth_repair.config import (
    BLOCK_PX,
    FIRST_STEPS_AHEAD,
    FIRST_TURNS,
    LIKELY_CONTRAST_RATIO,
    LINE_COLOR_DIFFERENCE,
    LINE_INSET_PX,
    LINE_STEP_PX,
    MAX_SEED_DISTANCE_PX,
    MIN_CONTRAST_RATIO,
    MIN_RESTORED,
    NEAR_PX,
    NEIGHBOURHOOD_PX,
    STEPS_AHEAD,
    TURNS,
)
from bokehnet.depth_repair.stages.line_profile import (
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


@njit(cache=True)
def _disparity_at(disparity, y, x):  # type: ignore[no-untyped-def]
    """Return the disparity of the pixel at a position, NaN outside the map."""
    row, column = math.floor(y + 0.5), math.floor(x + 0.5)
    inside = 0 <= row < disparity.shape[0] and 0 <= column < disparity.shape[1]
    return disparity[row, column] if inside else np.nan


@njit(cache=True)
def _distance_to_end(disparity, depth, min_height, y, x, down, right):  # type: ignore[no-untyped-def]
    """Return the distance ahead at which the map has the disparity ``depth`` again, pixels, or -1."""
    for ahead in range(BLOCK_PX):
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
    change = 0.0
    for count in range(len(points) - BLOCK_PX):
        angle, _ = steer(picture, y, x, angle, TURNS, STEPS_AHEAD, reference, profile)
        down, right = math.sin(angle), math.cos(angle)
        y, x = y + LINE_STEP_PX * down, x + LINE_STEP_PX * right
        value_ahead = _disparity_at(disparity, y, x)
        leaves = math.isnan(value_ahead)
        if leaves or value_ahead > depth + min_height:
            return count, change / max(count, 1), not (likely and leaves)
        sample_profile(picture, y, x, down, right, profile)
        profile_change = profile_difference(profile, reference)
        if profile_change > LINE_COLOR_DIFFERENCE:
            return count, change / max(count, 1), True
        change += profile_change
        ahead = _distance_to_end(disparity, depth, min_height, y, x, down, right)
        for step in range(max(ahead, 0) + 1):
            points[count + step, 0], points[count + step, 1] = y + step * down, x + step * right
        if ahead >= 0:
            return count + 1 + ahead, change / (count + 1), False
    return 0, 0.0, False


@njit(cache=True)
def _change_inside(picture, y, x, down, right, reference, profile):  # type: ignore[no-untyped-def]
    """Return the mean change of the profile of a line on its way into a piece."""
    change = 0.0
    for step in range(BLOCK_PX):
        reach = step + 1.0
        sample_profile(picture, y + reach * down, x + reach * right, down, right, profile)
        change += profile_difference(profile, reference) / BLOCK_PX
    return change


@njit(cache=True)
def _is_thin(disparity, max_disparity, y, x, down, right):  # type: ignore[no-untyped-def]
    """Return whether a piece is thin ahead: near, without near surfaces on both sides."""
    for step in range(1, BLOCK_PX + 1):
        for side in range(-BLOCK_PX, BLOCK_PX + 1, BLOCK_PX):
            v, u = y + step * down + side * right, x + step * right - side * down
            if (_disparity_at(disparity, v, u) > max_disparity) != (side == 0):
                return False
    return True


@njit(cache=True)
def _is_line(picture, points, count, change, color, likely):  # type: ignore[no-untyped-def]
    """Return whether a trace has constant colours, and contrast on both sides.

    Unless it is NaN, ``color`` must match its mean colour. The criteria are relaxed for likely lines.
    """
    contrasts = np.empty(count)
    mean, square = np.zeros(3), np.zeros(3)
    for i in range(count):
        y, x = points[i]
        down, right = tangent(points, count, i)
        contrasts[i] = line_contrast(picture, y, x, down, right)
        for c in range(3):
            value = interpolate(picture, y, x, c)
            mean[c] += value / count
            square[c] += value * value / count
    color_difference = 0.0
    for c in range(3):
        change += max(0.0, square[c] - mean[c] * mean[c])
        color_difference += (mean[c] - color[c]) ** 2
    if color_difference > LINE_COLOR_DIFFERENCE:
        return False
    contrast = order_statistic(contrasts, count // 10)
    ratio = LIKELY_CONTRAST_RATIO if likely else MIN_CONTRAST_RATIO
    return contrast > max(LINE_COLOR_DIFFERENCE, ratio * change)


@njit(cache=True)
def _depth_inside(disparity, y, x):  # type: ignore[no-untyped-def]
    """Return the disparity of a piece from a pixel at its border, which may be soft."""
    height, width = disparity.shape
    nearest_disparity = disparity[y, x]
    for v in range(max(0, y - BLOCK_PX), min(height, y + BLOCK_PX + 1)):
        for u in range(max(0, x - BLOCK_PX), min(width, x + BLOCK_PX + 1)):
            nearest_disparity = max(nearest_disparity, disparity[v, u])
    return nearest_disparity


@njit(cache=True)
def _trace_from_seed(picture, disparity, min_height, seed, color, points):  # type: ignore[no-untyped-def]
    """Trace the line from a seed away from its piece into ``points`` (N, 2); return their number, 0 for none.

    A line with the ``color`` (3,) of restored lines nearby is likely. If ``color`` is NaN, the line must
    continue inside the pieces at both ends. A line with an open end needs a thin piece or a matching colour.
    """
    y, x, v, u = seed
    likely = not math.isnan(color[0])
    if color_difference_at(picture, y, x, v, u) > LINE_COLOR_DIFFERENCE:
        return 0
    profile, unset = np.empty((3, 3)), np.full((3, 3), np.nan)
    angle = math.atan2(y - v, x - u)
    angle, change = steer(picture, y, x, angle, FIRST_TURNS, FIRST_STEPS_AHEAD, unset, profile)
    if (
        change > LINE_COLOR_DIFFERENCE
        or line_contrast(picture, y, x, math.sin(angle), math.cos(angle)) < LINE_COLOR_DIFFERENCE
    ):
        return 0
    depth = _depth_inside(disparity, v, u)
    count, change, is_open = _trace(
        picture, disparity, min_height, float(y), float(x), depth, angle, likely, points
    )
    is_confirmed = likely and not is_open
    if count == 0 or not _is_line(picture, points, count, change, color, is_confirmed):
        return 0
    if is_confirmed:
        return count
    reference = np.empty((3, 3))
    down, right = tangent(points, count, 0)
    sample_profile(picture, y, x, down, right, reference)
    distance = math.sqrt((y - v) * (y - v) + (x - u) * (x - u))
    y, x = y - distance * down, x - distance * right
    if _change_inside(picture, y, x, -down, -right, reference[::-1], profile) > LINE_COLOR_DIFFERENCE:
        return 0
    if is_open:
        return count if likely or _is_thin(disparity, depth - min_height, y, x, -down, -right) else 0
    y, x = points[count - 1]
    down, right = tangent(points, count, count - 1)
    return (
        count
        if _change_inside(picture, y, x, down, right, reference, profile) <= LINE_COLOR_DIFFERENCE
        else 0
    )


@njit(cache=True, parallel=True)
def _find_seeds(disparity, min_height, ys, xs, seeds, is_marked):  # type: ignore[no-untyped-def]
    """Fill ``seeds`` (N, 4) with row and column of each seed and of the nearest pixel of its piece."""
    height, width = disparity.shape
    for i in prange(len(ys)):
        y, x = ys[i], xs[i]
        nearest_squared = 2 * MAX_SEED_DISTANCE_PX * MAX_SEED_DISTANCE_PX
        for v in range(max(0, y - MAX_SEED_DISTANCE_PX), min(height, y + MAX_SEED_DISTANCE_PX + 1)):
            for u in range(max(0, x - MAX_SEED_DISTANCE_PX), min(width, x + MAX_SEED_DISTANCE_PX + 1)):
                distance_squared = (v - y) * (v - y) + (u - x) * (u - x)
                if distance_squared < nearest_squared and disparity[v, u] > disparity[y, x] + min_height:
                    nearest_squared = distance_squared
                    seeds[i, 0], seeds[i, 1], seeds[i, 2], seeds[i, 3] = y, x, v, u
        is_marked[i] = NEAR_PX * NEAR_PX < nearest_squared <= MAX_SEED_DISTANCE_PX * MAX_SEED_DISTANCE_PX


@njit(cache=True, parallel=True)
def _mark_lines(picture, disparity, min_height, seeds, colors, is_marked):  # type: ignore[no-untyped-def]
    """Mark seeds at which a line starts."""
    max_points = disparity.shape[0] + disparity.shape[1]
    for i in prange(len(seeds)):
        points = np.empty((max_points, 2))
        is_marked[i] = _trace_from_seed(picture, disparity, min_height, seeds[i], colors[i], points) > 0


@njit(cache=True)
def _draw_lines(picture, disparity, min_height, seeds, colors, result):  # type: ignore[no-untyped-def]
    """Draw the lines that start at the seeds into ``result``, in the width that the picture shows."""
    height, width = disparity.shape
    points, sides = np.empty((height + width, 2)), np.empty((2, height + width))
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
            first, last = max(0, i - BLOCK_PX // 2), min(count, i + BLOCK_PX // 2 + 1)
            width_before = order_statistic(sides[0, first:last], (last - first) // 2) - LINE_INSET_PX
            width_after = order_statistic(sides[1, first:last], (last - first) // 2) - LINE_INSET_PX
            reach = int(max(width_before, width_after)) + 2
            row, column = int(points[i, 0]), int(points[i, 1])
            for y in range(max(0, row - reach), min(height, row + reach + 1)):
                for x in range(max(0, column - reach), min(width, column + reach + 1)):
                    v, u = y - points[i, 0], x - points[i, 1]
                    if (
                        abs(v * down + u * right) <= LINE_STEP_PX
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
    nearest = reduce_windows(disparity, MAX_SEED_DISTANCE_PX, np.maximum)
    ys, xs = np.nonzero(nearest > disparity + min_height)
    picture = encode(np.minimum(image, 1.0)).astype(np.float32, copy=False)
    seeds, is_marked = np.empty((len(ys), 4), np.int64), np.empty(len(ys), np.bool_)
    with parallel_region:
        _find_seeds(disparity, min_height, ys, xs, seeds, is_marked)
    seeds = seeds[is_marked]
    _draw(picture, disparity, min_height, seeds, np.full((len(seeds), 3), np.nan), result)
    restored = np.asarray(result != disparity, np.float32)
    if restored.any():
        rows, columns = seeds[:, 0], seeds[:, 1]
        fraction = box_mean(restored, NEIGHBOURHOOD_PX)[rows, columns]
        sums = [
            box_mean(restored * channel, NEIGHBOURHOOD_PX)[rows, columns]
            for channel in picture.transpose(2, 0, 1)
        ]
        likely = fraction >= MIN_RESTORED
        colors = np.stack(sums, 1, dtype=np.float64)[likely] / fraction[likely, None]
        _draw(picture, disparity, min_height, seeds[likely], colors, result)
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
