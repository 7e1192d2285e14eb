"""Thin things that a map has lost between two pieces that it still has: wires, twigs, blades of grass.

Networks, low resolution and erosion wear thin things away; of a fence they leave the crossings. Beside
every piece that stands nearer than what is around it, lines of the picture are followed away from it. One
that keeps its colours all along, stands out from both sides all along, and ends at a piece of the same
disparity is one thing with both: it takes their disparity, as wide as the picture shows it.

Where many were found, as of a net, others around of their colours are believed sooner: light and shade may
cross them, and they may leave the picture. What these restore makes others likely in turn.

Twigs, blades and the wires at the rim of a net end openly: no piece lies at their other end. They are
believed if the piece that they lead away from is as thin, or if they have the colours of others around.

Lines of a background may also lead from one near thing to another. They seldom look like these things, and
seldom keep their colours and their width.

Source: the idea of following lines by a profile across them is common in the tracing of vessels and roads, as
in Aylward and Bullitt, "Initialization, noise, singularities, and scale in height ridge traversal for tubular
object centerline extraction", IEEE Transactions on Medical Imaging 2002. What counts as a line is ours.
"""

import math

import numpy as np
from numba import prange

from bokehnet.classical.parallel import parallel_region
from bokehnet.depth_repair.stages.edge_sharpening import extremes
from bokehnet.depth_repair.stages.line_profile import (
    SIDE,
    STRIDE,
    contrast_across,
    difference,
    half_width,
    heading,
    look_across,
    ranked,
    sample,
    turned,
    unlike,
)
from bokehnet.kernels import njit
from bokehnet.optics.encoding import encode

__all__ = ["restore_lost_lines"]

# Pixels from a near piece at which lines are looked for: at least, and at most.
_NEAREST, _FARTHEST = 2, 4

# Steps along a line at most, and at least.
_MOST, _LEAST = 80, 5

# Turns between steps that are tried to either side, radians each; those at the beginning.
_TURNS, _TURN, _FIRST_TURNS, _FIRST_TURN = 3, 0.12, 6, 0.17

# Steps ahead by which a turn is judged; those at the beginning.
_AHEAD, _FIRST_AHEAD = 3, 5

# Steps without the line that are put up with, one after the other: something may cross it.
_GAPS = 4

# Pixels ahead at which a piece of the same disparity ends the line.
_END = 7

# Squared differences of encoded colours, all channels together: of a step that is not the line's, of a line
# and a piece that are not one thing, of a line and its surroundings at least.
_GAP, _OTHER, _CONTRAST = 0.02, 0.04, 0.03

# Pixels from the rim of a piece within which its own disparity is found: repaired rims may be soft.
_RIM = 7

# Pixels inside a piece over which the line goes on, and squared difference from which on it does not.
_INSIDE = 6
_OTHER_LINE = 0.04

# Least contrast over what changes along the line; of those that are likely, which light and shade may cross;
# and of these if they are straight.
_RATIO, _LIKELY_RATIO, _STRAIGHT_RATIO = 20.0, 4.0, 2.5

# Radius in pixels of a circle around the end of a piece, and the places on it.
_RADIUS = 8.0
_CIRCLE = 48

# Half the width of surroundings, pixels; how sparsely they are looked at; the share of them that is restored
# from which on lines are likely; and how often at most what was found makes others likely.
_AROUND, _SPARSE, _MANY, _ROUNDS = 68, 4, 0.03, 8

# Share of the line beside which there is nothing near.
_FREE = 0.75

# Least length over the width, of any line and of those that are likely.
_LONG, _LIKELY_LONG = 2.0, 1.2

# Largest deviation of the width, pixels, likewise; least of the distance of the ends, over the length: of any
# line, and of one that is straight.
_ROUGHNESS, _LIKELY_ROUGHNESS, _STRAIGHT_ROUGHNESS = 1.4, 2.0, 2.5
_STRAIGHTNESS, _STRAIGHT = 0.9, 0.98

# Pixels by which a line is laid narrower than it looks, as several may be laid over one another.
_OVERLAP = 0.25

# Share of the steps into a piece beside which there is nothing near, if it is thin.
_THIN = 0.75


@njit(cache=True)
def _disparity_at(disparity, y, x):  # type: ignore[no-untyped-def]
    """Disparity of the pixel at a place, NaN outside the map."""
    row, column = int(y + 0.5), int(x + 0.5)
    inside = 0 <= row < disparity.shape[0] and 0 <= column < disparity.shape[1]
    return disparity[row, column] if inside else np.nan


@njit(cache=True)
def _end(disparity, depth, least, y, x, down, right):  # type: ignore[no-untyped-def]
    """Pixels ahead at which the map has that disparity again, -1 for none."""
    for ahead in range(_END):
        if abs(_disparity_at(disparity, y + ahead * down, x + ahead * right) - depth) < least:
            return ahead
    return -1


@njit(cache=True)
def _follow(picture, disparity, least, y, x, depth, angle, likely, open_ends, points):  # type: ignore[no-untyped-def]
    """Follow a line to a piece of that disparity, or to an open end if there may be one.

    Lines that are ``likely`` may leave the picture.

    Returns:
        How many of ``points`` (N, 2) are set, 0 for no line; how much it changes; whether its end is open.
    """
    kept, profile = np.empty((3, 3)), np.empty((3, 3))
    look_across(picture, y, x, math.sin(angle), math.cos(angle), kept)
    change, sure, gaps = 0.0, 0.0, 0
    for count in range(1, _MOST + 1):
        angle, _ = turned(picture, y, x, angle, _TURNS, _TURN, _AHEAD, kept, profile)
        down, right = math.sin(angle), math.cos(angle)
        y, x = y + STRIDE * down, x + STRIDE * right
        there = _disparity_at(disparity, y, x)
        leaves = math.isnan(there)
        if leaves or there > depth + least:
            is_open = not (likely and leaves)
            is_end = count > _LEAST and (open_ends or not is_open)
            return (count - 1, change / count, is_open) if is_end else (0, 0.0, False)
        look_across(picture, y, x, down, right, profile)
        apart = unlike(profile, kept)
        change += apart
        gaps = gaps + 1 if apart > _GAP else 0
        if gaps > _GAPS:
            count -= gaps
            return (count, sure / count, True) if open_ends and count > _LEAST else (0, 0.0, False)
        if gaps == 0:
            sure = change
            for k in range(3):
                for c in range(3):
                    kept[k, c] += 0.07 * (profile[k, c] - kept[k, c])
        points[count - 1, 0], points[count - 1, 1] = y, x
        ahead = _end(disparity, depth, least, y, x, down, right) if count >= _LEAST else -1
        if ahead >= 0:
            for step in range(ahead):
                points[count + step, 0], points[count + step, 1] = y + step * down, x + step * right
            return count + ahead, change / count, False
    return 0, 0.0, False


@njit(cache=True)
def _change_inside(picture, y, x, down, right, kept, profile):  # type: ignore[no-untyped-def]
    """By how much the line changes on its way into a piece."""
    change = 0.0
    for step in range(_INSIDE):
        reach = step + 1.0
        look_across(picture, y + reach * down, x + reach * right, down, right, profile)
        change += unlike(profile, kept) / _INSIDE
    return change


@njit(cache=True)
def _stands_free(disparity, farthest, y, x, down, right):  # type: ignore[no-untyped-def]
    """Whether what is beside a line on both sides is farther away than that."""
    for side in range(-SIDE, SIDE + 1, 2 * SIDE):
        if _disparity_at(disparity, y + side * right, x - side * down) > farthest:
            return False
    return True


@njit(cache=True)
def _is_thin(disparity, farthest, y, x, down, right):  # type: ignore[no-untyped-def]
    """Whether a piece is thin ahead: near, with nothing near beside it."""
    thin = 0
    for step in range(1, _INSIDE + 1):
        ahead, aside = y + step * down, x + step * right
        if _disparity_at(disparity, ahead, aside) > farthest:
            thin += _stands_free(disparity, farthest, ahead, aside, down, right)
    return thin >= _THIN * _INSIDE


@njit(cache=True)
def _is_line(picture, disparity, farthest, points, count, change, color, likely):  # type: ignore[no-untyped-def]
    """Whether what was followed keeps its colours and its width, and stands out from both sides.

    Unless it is NaN, ``color`` is what it has to have, too. If it is ``likely``, it is believed sooner.
    """
    contrasts, widths, free = np.empty(count), np.empty(count), 0
    mean, square = np.zeros(3), np.zeros(3)
    length = 0.0
    for i in range(count):
        y, x = points[i]
        down, right = heading(points, count, i)
        free += _stands_free(disparity, farthest, y, x, down, right)
        contrasts[i] = contrast_across(picture, y, x, down, right)
        widths[i] = half_width(picture, y, x, down, right, 1)
        widths[i] += half_width(picture, y, x, down, right, -1)
        for c in range(3):
            value = sample(picture, y, x, c)
            mean[c] += value / count
            square[c] += value * value / count
        if i > 0:
            length += math.sqrt((y - points[i - 1, 0]) ** 2 + (x - points[i - 1, 1]) ** 2)
    other = 0.0
    for c in range(3):
        change += max(0.0, square[c] - mean[c] * mean[c])
        other += (mean[c] - color[c]) ** 2
    if other > _OTHER:
        return False
    contrast = ranked(contrasts, count // 10)
    apart = math.sqrt((points[count - 1, 0] - points[0, 0]) ** 2 + (points[count - 1, 1] - points[0, 1]) ** 2)
    if likely and apart > _STRAIGHT * length:
        ratio, least, roughness = _STRAIGHT_RATIO, _LIKELY_LONG, _STRAIGHT_ROUGHNESS
    elif likely:
        ratio, least, roughness = _LIKELY_RATIO, _LIKELY_LONG, _LIKELY_ROUGHNESS
    else:
        ratio, least, roughness = _RATIO, _LONG, _ROUGHNESS
    stands_out = contrast > _CONTRAST and contrast > ratio * change and free > _FREE * count
    is_long = length > least * widths.mean() and apart > _STRAIGHTNESS * length
    return stands_out and is_long and widths.std() < roughness


@njit(cache=True)
def _is_end(disparity, farthest, y, x):  # type: ignore[no-untyped-def]
    """Whether a near piece ends there, or is large: a circle around it crosses it once at most."""
    crossed, inside = 0, False
    for i in range(_CIRCLE + 1):
        angle = 2.0 * math.pi * i / _CIRCLE
        v, u = int(y + _RADIUS * math.sin(angle) + 0.5), int(x + _RADIUS * math.cos(angle) + 0.5)
        v, u = min(max(v, 0), disparity.shape[0] - 1), min(max(u, 0), disparity.shape[1] - 1)
        near = disparity[v, u] > farthest
        crossed += near and not inside and i > 0
        inside = near
    return crossed <= 1


@njit(cache=True)
def _depth_inside(disparity, y, x):  # type: ignore[no-untyped-def]
    """Disparity of a piece at whose rim, which may be soft, a pixel lies."""
    height, width = disparity.shape
    most = disparity[y, x]
    for v in range(max(0, y - _RIM), min(height, y + _RIM + 1)):
        for u in range(max(0, x - _RIM), min(width, x + _RIM + 1)):
            most = max(most, disparity[v, u])
    return most


@njit(cache=True)
def _line_from(picture, disparity, least, place, color, open_ends, points):  # type: ignore[no-untyped-def]
    """Find the line that leads away from a near piece; points (N, 2) on it, and how many: 0 for none.

    A line of the ``color`` of those that were found around, (3,), is believed sooner. If that is NaN, the
    piece has to end there, and the line to go on in the pieces at both its ends. Of a line with an open end
    the piece has to be thin, or the colour right.
    """
    y, x, v, u = place
    likely = not math.isnan(color[0])
    if difference(picture, y, x, v, u) > _OTHER:
        return 0
    if not likely and not _is_end(disparity, disparity[v, u] - least, v, u):
        return 0
    profile, none = np.empty((3, 3)), np.full((3, 3), np.nan)
    angle = math.atan2(y - v, x - u)
    angle, change = turned(picture, y, x, angle, _FIRST_TURNS, _FIRST_TURN, _FIRST_AHEAD, none, profile)
    if change > _GAP or contrast_across(picture, y, x, math.sin(angle), math.cos(angle)) < _CONTRAST:
        return 0
    depth = _depth_inside(disparity, v, u)
    count, change, is_open = _follow(
        picture, disparity, least, float(y), float(x), depth, angle, likely, open_ends, points
    )
    is_sure = likely and not is_open
    if count == 0 or not _is_line(picture, disparity, depth - least, points, count, change, color, is_sure):
        return 0
    if is_sure:
        return count
    kept = np.empty((3, 3))
    down, right = math.sin(angle), math.cos(angle)
    look_across(picture, y, x, down, right, kept)
    apart = math.sqrt((y - v) * (y - v) + (x - u) * (x - u))
    y, x = y - apart * down, x - apart * right
    if _change_inside(picture, y, x, -down, -right, kept[::-1], profile) > _OTHER_LINE:
        return 0
    if is_open:
        return count if likely or _is_thin(disparity, depth - least, y, x, -down, -right) else 0
    y, x = points[count - 1]
    down, right = heading(points, count, count - 1)
    return count if _change_inside(picture, y, x, down, right, kept, profile) <= _OTHER_LINE else 0


@njit(cache=True, parallel=True)
def _find_places(disparity, least, ys, xs, places, found):  # type: ignore[no-untyped-def]
    """Set places beside near pieces, and the nearest pixel there: two rows and columns each, (N, 4)."""
    height, width = disparity.shape
    for i in prange(len(ys)):
        y, x = ys[i], xs[i]
        nearest = 2 * _FARTHEST * _FARTHEST
        for v in range(max(0, y - _FARTHEST), min(height, y + _FARTHEST + 1)):
            for u in range(max(0, x - _FARTHEST), min(width, x + _FARTHEST + 1)):
                apart = (v - y) * (v - y) + (u - x) * (u - x)
                if apart < nearest and disparity[v, u] > disparity[y, x] + least:
                    nearest = apart
                    places[i, 0], places[i, 1], places[i, 2], places[i, 3] = y, x, v, u
        found[i] = _NEAREST * _NEAREST < nearest <= _FARTHEST * _FARTHEST


@njit(cache=True, parallel=True)
def _are_likely(picture, restored, places, found, colors):  # type: ignore[no-untyped-def]
    """Mark the places around which much is restored, and set its mean colours, (N, 3)."""
    height, width = restored.shape
    for i in prange(len(places)):
        y, x = places[i, 0], places[i, 1]
        seen = many = 0
        total = np.zeros(3)
        for v in range(max(0, y - _AROUND), min(height, y + _AROUND + 1), _SPARSE):
            for u in range(max(0, x - _AROUND), min(width, x + _AROUND + 1), _SPARSE):
                seen += 1
                if restored[v, u]:
                    many += 1
                    for c in range(3):
                        total[c] += picture[v, u, c]
        found[i] = many >= _MANY * seen
        for c in range(3):
            colors[i, c] = total[c] / max(many, 1)


@njit(cache=True, parallel=True)
def _find_lines(picture, disparity, least, places, colors, open_ends, found):  # type: ignore[no-untyped-def]
    """Mark the places from which lines lead."""
    for i in prange(len(places)):
        points = np.empty((_MOST + _END, 2))
        found[i] = _line_from(picture, disparity, least, places[i], colors[i], open_ends, points) > 0


@njit(cache=True)
def _lay_lines(picture, disparity, least, places, colors, open_ends, result):  # type: ignore[no-untyped-def]
    """Write the lines that lead from there, as wide as they are."""
    height, width = disparity.shape
    points, sides = np.empty((_MOST + _END, 2)), np.empty((2, _MOST + _END))
    for number in range(len(places)):
        place = places[number]
        count = _line_from(picture, disparity, least, place, colors[number], open_ends, points)
        depth = _depth_inside(disparity, place[2], place[3])
        for i in range(count):
            down, right = heading(points, count, i)
            for side in range(2):
                sides[side, i] = half_width(picture, points[i, 0], points[i, 1], down, right, 2 * side - 1)
        for i in range(count):
            down, right = heading(points, count, i)
            first, last = max(0, i - 5), min(count, i + 6)
            before = ranked(sides[0, first:last], (last - first) // 2) - _OVERLAP
            after = ranked(sides[1, first:last], (last - first) // 2) - _OVERLAP
            reach = int(max(before, after)) + 2
            row, column = int(points[i, 0]), int(points[i, 1])
            for y in range(max(0, row - reach), min(height, row + reach + 1)):
                for x in range(max(0, column - reach), min(width, column + reach + 1)):
                    v, u = y - points[i, 0], x - points[i, 1]
                    if abs(v * down + u * right) <= STRIDE and -before <= v * right - u * down <= after:
                        result[y, x] = max(result[y, x], depth)


def restore_lost_lines(
    image: np.ndarray, disparity: np.ndarray, least: float, spread: bool = True
) -> np.ndarray:
    """Give lines of the picture that lead from one near piece to another of its disparity that disparity.

    Where many are found, as in what is left of a net, others around are believed sooner, and so on.

    Args:
        image: All-in-focus picture, scene-linear, not negative, (H, W, 3), float32.
        disparity: (H, W), float32, rising towards the camera.
        least: Difference of disparity from which on two pixels belong to two surfaces.
        spread: Whether what was found makes others likely, and lines may have open ends. In maps that were
            soft, and have got back what blur had hidden, that makes lines of what is none.

    Returns:
        A new map (H, W), nowhere farther away than the given one.
    """
    result = disparity.copy()
    if min(disparity.shape) < 2:
        return result
    ys, xs = np.nonzero(extremes(disparity, _FARTHEST)[1] > disparity + least)
    picture = encode(np.minimum(image, 1.0)).astype(np.float32, copy=False)
    places, found = np.empty((len(ys), 4), np.int64), np.empty(len(ys), np.bool_)
    with parallel_region:
        _find_places(disparity, least, ys, xs, places, found)
    every = places[found]
    _lay(picture, disparity, least, every, np.full((len(every), 3), np.nan), spread, result)
    before = 0
    for _ in range(_ROUNDS if spread else 0):
        restored = result != disparity
        many = int(restored.sum())
        if many == before:  # nothing was found, or nothing more
            break
        before = many
        found, colors = np.empty(len(every), np.bool_), np.empty((len(every), 3))
        with parallel_region:
            _are_likely(picture, restored, every, found, colors)
        _lay(picture, disparity, least, every[found], colors[found], spread, result)
    return result


def _lay(
    picture: np.ndarray,
    disparity: np.ndarray,
    least: float,
    places: np.ndarray,
    colors: np.ndarray,
    open_ends: bool,
    result: np.ndarray,
) -> None:
    """Write the lines that lead from some places (N, 4), of colours (N, 3), into ``result``."""
    found = np.empty(len(places), np.bool_)
    with parallel_region:
        _find_lines(picture, disparity, least, places, colors, open_ends, found)
        _lay_lines(picture, disparity, least, places[found], colors[found], open_ends, result)
