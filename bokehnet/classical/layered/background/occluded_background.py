"""What stands behind each foreground: a background, filled from the surroundings that lie farther away."""

import math
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import prange

from bokehnet.classical.base import check_inputs
from bokehnet.classical.highlight_detection import are_lights, light_limit
from bokehnet.classical.layered.background.exemplar_inpainting import FARTHEST, fill_with_look_alikes
from bokehnet.classical.layered.background.inpainting_order import hidden_rings
from bokehnet.classical.layered.background.structure_transport import carry_lines_on
from bokehnet.classical.layered.depth_discontinuities import (
    DISCONTINUITY_THRESHOLD,
    STEP_TILE,
    are_one_surface,
    tiles_with_steps,
)
from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit

__all__ = ["occluded_background"]

# Ways in which a hidden pixel looks for the surface that goes on behind it: rows, columns.
_WAYS = np.array([(0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)])

# Spacing of the samples that a hidden pixel averages, in parts of its distance from the edge.
_SPACING = 0.25

# Half the width of the window over which what is hidden is averaged.
_SMOOTH = 2

# Distance from the edge, in pixels, at which lines and texture count 1 / e: the farther, the less they are
# sure to go on.
_FADING = 16.0

# Lines are at most this many times as bright as the mean around: what is brighter is a lamp, and ends.
_BRIGHTER = 2.5


@njit(cache=True)
def _step(defocus, steps, y, x, v, u, length):  # type: ignore[no-untyped-def]
    """Steps from (y, x) by way of its neighbour (v, u) to the surface that goes on behind it, 0 for none.

    A ray that passes an edge at defocus f falls at most f - b pixels behind it before it meets b.
    """
    height, width = defocus.shape
    if not (0 <= v < height and 0 <= u < width):
        return 0
    if defocus[v, u] < defocus[y, x] - DISCONTINUITY_THRESHOLD:
        return 1
    count = steps[v, u] + 1
    if count == 1 or count > 65535:
        return 0
    gap = defocus[y, x] - defocus[y + count * (v - y), x + count * (u - x)]
    return count if gap > DISCONTINUITY_THRESHOLD and count * length <= gap + 2.0 else 0


@njit(cache=True)
def _carry_into_tile(defocus, steps, row, column, down, right):  # type: ignore[no-untyped-def]
    """Count the steps of one way in a tile; whether any lead anywhere."""
    height, width = defocus.shape
    length = math.sqrt(down * down + right * right)
    top, left = row * STEP_TILE, column * STEP_TILE
    bottom, last = min(height, top + STEP_TILE), min(width, left + STEP_TILE)
    found = False
    for line in range(bottom - top):
        y = bottom - 1 - line if down > 0 else top + line
        for place in range(last - left):
            x = last - 1 - place if right > 0 else left + place
            count = _step(defocus, steps, y, x, y + down, x + right, length)
            if count > 0:
                steps[y, x] = count
                found = True
    return found


@njit(cache=True, parallel=True)
def _carry_inwards(defocus, stepped, steps, reached):  # type: ignore[no-untyped-def]
    """Count, per way, the steps from each pixel to the surface that goes on behind it, (ways, H, W).

    Marks the tiles that a way reaches, (ways, rows, columns); only these and those beside them are looked at.
    """
    rows, columns = stepped.shape
    for way in prange(len(_WAYS)):
        down, right = _WAYS[way]
        for line in range(rows):
            row = rows - 1 - line if down > 0 else line
            for place in range(columns):
                column = columns - 1 - place if right > 0 else place
                v, u = min(max(row + down, 0), rows - 1), min(max(column + right, 0), columns - 1)
                before = reached[way, v, u] or reached[way, v, column] or reached[way, row, u]
                if before or stepped[row, column]:
                    reached[way, row, column] = _carry_into_tile(
                        defocus, steps[way], row, column, down, right
                    )


@njit(cache=True)
def _choose(depths, distances):  # type: ignore[no-untyped-def]
    """Number of the way that leads to the surface which most, and the nearest, ways lead to; -1 for none."""
    best, chosen = 0.0, -1
    for i in range(len(depths)):
        if distances[i] == 0.0:
            continue
        weight = 0.0
        for j in range(len(depths)):
            apart = max(distances[i], distances[j])
            if distances[j] > 0.0 and are_one_surface(depths[i], depths[j], apart):
                weight += 1.0 / (distances[j] * distances[j])
        if weight > best:
            best, chosen = weight, i
    return chosen


@njit(cache=True, parallel=True)
def _fill(image, defocus, lights, steps, reached, colors, depths, nearest):  # type: ignore[no-untyped-def]
    """Mean of what all ways to one surface lead to, the nearer the more; and the shortest of all ways."""
    height, width = defocus.shape
    ways = len(_WAYS)
    for y in prange(height):
        found, distances = np.zeros(ways), np.zeros(ways)
        for x in range(width):
            if not reached[y // STEP_TILE, x // STEP_TILE]:
                continue
            for way in range(ways):
                count = np.int64(steps[way, y, x])
                down, right = _WAYS[way]
                distances[way] = count * math.sqrt(down * down + right * right)
                found[way] = defocus[y + count * down, x + count * right]
            chosen = _choose(found, distances)
            if chosen < 0:
                continue
            nearest[y, x] = np.inf
            for way in range(ways):
                if distances[way] > 0.0:
                    nearest[y, x] = min(nearest[y, x], distances[way])
            total = depth = red = green = blue = 0.0
            for way in range(ways):
                apart = max(distances[way], distances[chosen])
                if distances[way] == 0.0 or not are_one_surface(found[way], found[chosen], apart):
                    continue
                count = np.int64(steps[way, y, x])
                spacing = max(1, int(round(count * _SPACING)))
                down, right = _WAYS[way]
                a, b = y + count * down, x + count * right
                share = 1e-9  # of the edge's own pixel, for surfaces that nothing else shows
                sum_depth = share * defocus[a, b]
                sum_red, sum_green = share * image[a, b, 0], share * image[a, b, 1]
                sum_blue = share * image[a, b, 2]
                for i in range(-1, 2):
                    for j in range(-1, 2):
                        v, u = a + spacing * (down + i), b + spacing * (right + j)
                        if not (0 <= v < height and 0 <= u < width):
                            continue
                        if abs(defocus[v, u] - defocus[a, b]) > DISCONTINUITY_THRESHOLD:
                            continue
                        w = 1e-3 if lights[v, u] else 1.0
                        share += w
                        sum_depth += w * defocus[v, u]
                        sum_red += w * image[v, u, 0]
                        sum_green += w * image[v, u, 1]
                        sum_blue += w * image[v, u, 2]
                w = 1.0 / (distances[way] * distances[way])
                total += w
                depth += w / share * sum_depth
                red += w / share * sum_red
                green += w / share * sum_green
                blue += w / share * sum_blue
            colors[y, x, 0], colors[y, x, 1], colors[y, x, 2] = red / total, green / total, blue / total
            depths[y, x] = min(depth / total, defocus[y, x])


@njit(cache=True, parallel=True)
def _smooth(ys, xs, lights, distances, colors, depths, smooth_colors, smooth_depths):  # type: ignore[no-untyped-def]
    """Average what is hidden, (N), over what of its surface is told around it: single ways leave streaks."""
    height, width = depths.shape
    for i in prange(len(ys)):
        y, x = ys[i], xs[i]
        weight = depth = red = green = blue = 0.0
        for v in range(max(0, y - _SMOOTH), min(height, y + _SMOOTH + 1)):
            for u in range(max(0, x - _SMOOTH), min(width, x + _SMOOTH + 1)):
                told = distances[v, u] > 0 or not lights[v, u]
                if told and abs(depths[v, u] - depths[y, x]) <= DISCONTINUITY_THRESHOLD:
                    weight += 1.0
                    depth += depths[v, u]
                    red += colors[v, u, 0]
                    green += colors[v, u, 1]
                    blue += colors[v, u, 2]
        smooth_colors[i, 0], smooth_colors[i, 1] = red / weight, green / weight
        smooth_colors[i, 2] = blue / weight
        smooth_depths[i] = depth / weight


@njit(cache=True, parallel=True)
def _write(ys, xs, defocus, smooth_colors, smooth_depths, colors, depths):  # type: ignore[no-untyped-def]
    """Set what is hidden, (N), nowhere in front of what hides it."""
    for i in prange(len(ys)):
        y, x = ys[i], xs[i]
        depths[y, x] = min(smooth_depths[i], defocus[y, x])
        for c in range(3):
            colors[y, x, c] = smooth_colors[i, c]


@njit(cache=True, parallel=True)
def _fade_in(ys, xs, distances, lines, look_alikes, colors):  # type: ignore[no-untyped-def]
    """Let what is hidden, (N), go over from the mean of two guesses at its edge to ``colors`` inside."""
    for i in prange(len(ys)):
        y, x = ys[i], xs[i]
        share = math.exp(-distances[y, x] / _FADING)
        for c in range(3):
            guess = lines[y, x, c]
            if distances[y, x] <= FARTHEST:
                guess = 0.5 * (guess + look_alikes[y, x, c])
            colors[y, x, c] += share * (guess - colors[y, x, c])


@njit(cache=True)
def _scale_down(color, limit):  # type: ignore[no-untyped-def]
    """Scale a colour, (3,) in place, down to ``limit`` where it is brighter."""
    limit, brightest = max(limit, 0.0), max(color[0], color[1], color[2])
    if brightest > limit:
        for c in range(3):
            color[c] *= limit / brightest


@njit(cache=True, parallel=True)
def _dim(ys, xs, limit, colors):  # type: ignore[no-untyped-def]
    """Scale what is hidden, (N), down to ``limit``, (H, W), where it is brighter."""
    for i in prange(len(ys)):
        _scale_down(colors[ys[i], xs[i]], limit[ys[i], xs[i]])


@njit(cache=True, parallel=True)
def _dim_lines(ys, xs, means, lines):  # type: ignore[no-untyped-def]
    """Scale lines, at (N) places, down to so many times ``means``, (H, W, 3)."""
    for i in prange(len(ys)):
        mean = means[ys[i], xs[i]]
        _scale_down(lines[ys[i], xs[i]], _BRIGHTER * max(mean[0], mean[1], mean[2]))


def occluded_background(
    image: npt.NDArray[np.floating[Any]],
    defocus: npt.NDArray[np.floating[Any]],
    max_coc_radius: int | None = None,
    wanted: npt.NDArray[np.bool_] | None = None,
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Guess what stands behind each foreground, as far inwards from its edge as rays can see.

    Along rows, columns and diagonals each pixel looks for the first surface that goes on behind it. Of those
    found, the one that most and the nearest ways lead to is carried on, so that a pole behind a blade of
    grass stays a pole; its colour and defocus are means over all ways to it, weighted by the inverse squares
    of their lengths, so that what is hidden goes over from one side to the other. Each way brings an average
    over samples that lie the wider apart the longer it is, since what is farther inside is known less.
    Lights are not carried on: one behind the edge says nothing of another. Near the edge lines of the surface
    go on (:mod:`bokehnet.classical.layered.background.structure_transport`) but where they are far brighter
    than the mean, as the rims of lamps are, and its texture
    (:mod:`bokehnet.classical.layered.background.exemplar_inpainting`): the mean of both.

    Args:
        image: All-in-focus picture, scene-linear, (H, W, 3).
        defocus: Signed blur radius in pixels, (H, W), + in front of focus.
        max_coc_radius: Half-width in pixels of the surroundings that a light outshines; default: the largest
            radius.
        wanted: Pixels that count, (H, W); behind others only the means are found. Default: all count.

    Returns:
        Colours (H, W, 3) and defocus (H, W). Where nothing is hidden they equal the inputs.

    Raises:
        ShapeError: Not (H, W, 3) and (H, W) of one size.
        ParameterError: NaN or infinity in either.

    Source:
        Shepard, "A two-dimensional interpolation function for irregularly-spaced data", 1968, for the
        weights.
    """
    image, defocus = check_inputs(image, defocus)
    colors, depths = image.copy(), defocus.copy()
    limit = light_limit(
        image, math.ceil(float(np.abs(defocus).max())) if max_coc_radius is None else max_coc_radius
    )
    lights = are_lights(image, limit)
    steps = np.zeros((len(_WAYS), *defocus.shape), np.uint16)
    distances = np.zeros(defocus.shape, defocus.dtype)
    stepped = tiles_with_steps(defocus, 1)
    reached = np.zeros((len(_WAYS), *stepped.shape), np.bool_)
    with parallel_region:
        _carry_inwards(defocus, stepped, steps, reached)
        _fill(image, defocus, lights, steps, reached.any(0), colors, depths, distances)
    del steps
    if wanted is not None:
        distances[~wanted] = 0
    hidden = hidden_rings(distances)
    ys, xs = hidden.ys, hidden.xs
    if not len(ys):
        return colors, depths
    smooth_colors, smooth_depths = np.empty((len(ys), 3), colors.dtype), np.empty(len(ys), depths.dtype)
    with parallel_region:
        _dim(ys, xs, limit, colors)
        _smooth(ys, xs, lights, distances, colors, depths, smooth_colors, smooth_depths)
        _write(ys, xs, defocus, smooth_colors, smooth_depths, colors, depths)
        del smooth_colors, smooth_depths
        lines = carry_lines_on(image, defocus, lights, depths, hidden, colors)
        _dim_lines(ys, xs, colors, lines)
        look_alikes = fill_with_look_alikes(image, defocus, lights, depths, distances, hidden, lines)
        _fade_in(ys, xs, distances, lines, look_alikes, colors)
        _dim(ys, xs, limit, colors)
    return colors, depths
