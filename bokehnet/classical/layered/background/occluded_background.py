"""Occluded background of each foreground, filled from the farther surroundings."""

import math
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import prange

from bokehnet.classical.base import check_inputs
from bokehnet.classical.highlight_detection import are_lights, light_limit
from bokehnet.classical.layered.background.exemplar_inpainting import MAX_TEXTURE_DISTANCE_PX, inpaint_texture
from bokehnet.classical.layered.background.inpainting_order import occluded_rings
from bokehnet.classical.layered.background.structure_transport import continue_lines
from bokehnet.classical.layered.background.surface_boundaries import smooth_boundaries, write_occluded
from bokehnet.classical.layered.depth_discontinuities import (
    DISCONTINUITY_THRESHOLD,
    STEP_TILE,
    are_one_surface,
    tiles_with_steps,
)
from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit

__all__ = ["occluded_background"]

# Directions in which an occluded pixel searches for the surface that continues behind it: rows, columns.
_DIRECTIONS = np.array([(0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)])

# Spacing of the samples that an occluded pixel averages, as a fraction of its distance from the edge.
_SAMPLE_SPACING = 0.25

# Half-width of the window over which the occluded background is averaged, samples; their spacing over the
# distance from the edge, at least a pixel; and the number of passes.
_SMOOTHING_REACH, _SMOOTHING_SPACING, _SMOOTHING_PASSES = 2, 1 / 12, 2

# Distance from the edge, in pixels, at which lines and texture have the weight 1 / e: the farther, the less
# certain they are to continue.
_FADING_DISTANCE_PX = 16.0

# Distance from the edge, pixels, beyond which lines have less than 1 / 20 of the weight and are left out.
_MAX_LINE_DISTANCE_PX = int(3 * _FADING_DISTANCE_PX)

# Blur radius of the occluded background, pixels, above which lines are left out: nothing of them would show.
_MAX_INPAINTED_RADIUS_PX = 16.0

# Distance, in pixels beyond the disc of an occluded pixel, from which smaller layers read it.
_READING_MARGIN_PX = 16

# Upper bound of the brightness of lines over the mean around them: brighter lines are lamps, which end.
_MAX_LINE_BRIGHTNESS = 2.5


@njit(cache=True)
def _count_steps(defocus, steps, y, x, v, u, length):
    """Return the steps from (y, x) via its neighbour (v, u) to the surface that continues, 0 if none.

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
def _search_tile(defocus, steps, row, column, down, right):
    """Count the steps of one direction in a tile; return whether any search succeeds."""
    height, width = defocus.shape
    length = math.sqrt(down * down + right * right)
    top, left = row * STEP_TILE, column * STEP_TILE
    bottom, last = min(height, top + STEP_TILE), min(width, left + STEP_TILE)
    reached = False
    for line in range(bottom - top):
        y = bottom - 1 - line if down > 0 else top + line
        for index in range(last - left):
            x = last - 1 - index if right > 0 else left + index
            count = _count_steps(defocus, steps, y, x, y + down, x + right, length)
            if count > 0:
                steps[y, x] = count
                reached = True
    return reached


@njit(cache=True, parallel=True)
def _search_directions(defocus, stepped, steps, reached):
    """Count, per direction, the steps to the surface that continues behind a pixel, (directions, H, W).

    Marks the tiles that a direction reaches, (directions, rows, columns); only these and adjacent ones are
    searched.
    """
    rows, columns = stepped.shape
    for direction in prange(len(_DIRECTIONS)):
        down, right = _DIRECTIONS[direction]
        for line in range(rows):
            row = rows - 1 - line if down > 0 else line
            for index in range(columns):
                column = columns - 1 - index if right > 0 else index
                v, u = min(max(row + down, 0), rows - 1), min(max(column + right, 0), columns - 1)
                adjacent = (
                    reached[direction, v, u] or reached[direction, v, column] or reached[direction, row, u]
                )
                if adjacent or stepped[row, column]:
                    reached[direction, row, column] = _search_tile(
                        defocus, steps[direction], row, column, down, right
                    )


@njit(cache=True)
def _select_surface(depths, distances):
    """Return the index of the direction with the most and nearest support for its surface; -1 if none."""
    best_weight, best_index = 0.0, -1
    for i in range(len(depths)):
        if distances[i] == 0.0:
            continue
        weight = 0.0
        for j in range(len(depths)):
            apart = max(distances[i], distances[j])
            if distances[j] > 0.0 and are_one_surface(depths[i], depths[j], apart):
                weight += 1.0 / (distances[j] * distances[j])
        if weight > best_weight:
            best_weight, best_index = weight, i
    return best_index


@njit(cache=True, parallel=True)
def _fill(image, defocus, lights, steps, reached, colors, depths, nearest):
    """Set the mean over all directions to one surface, the nearer the more; and the shortest distance."""
    height, width = defocus.shape
    directions = len(_DIRECTIONS)
    for y in prange(height):
        found_depths, distances = np.zeros(directions), np.zeros(directions)
        for x in range(width):
            if not reached[y // STEP_TILE, x // STEP_TILE]:
                continue
            for direction in range(directions):
                count = np.int64(steps[direction, y, x])
                down, right = _DIRECTIONS[direction]
                distances[direction] = count * math.sqrt(down * down + right * right)
                found_depths[direction] = defocus[y + count * down, x + count * right]
            selected = _select_surface(found_depths, distances)
            if selected < 0:
                continue
            nearest[y, x] = np.inf
            for direction in range(directions):
                if distances[direction] > 0.0:
                    nearest[y, x] = min(nearest[y, x], distances[direction])
            total = depth = red = green = blue = 0.0
            for direction in range(directions):
                apart = max(distances[direction], distances[selected])
                if distances[direction] == 0.0 or not are_one_surface(
                    found_depths[direction], found_depths[selected], apart
                ):
                    continue
                count = np.int64(steps[direction, y, x])
                spacing = max(1, int(round(count * _SAMPLE_SPACING)))
                down, right = _DIRECTIONS[direction]
                a, b = y + count * down, x + count * right
                sample_weight = 1e-9  # weight of the edge pixel itself, for surfaces with no other pixel
                sum_depth = sample_weight * defocus[a, b]
                sum_red, sum_green = sample_weight * image[a, b, 0], sample_weight * image[a, b, 1]
                sum_blue = sample_weight * image[a, b, 2]
                for i in range(-1, 2):
                    for j in range(-1, 2):
                        v, u = a + spacing * (down + i), b + spacing * (right + j)
                        if not (0 <= v < height and 0 <= u < width):
                            continue
                        if abs(defocus[v, u] - defocus[a, b]) > DISCONTINUITY_THRESHOLD:
                            continue
                        w = 1e-3 if lights[v, u] else 1.0
                        sample_weight += w
                        sum_depth += w * defocus[v, u]
                        sum_red += w * image[v, u, 0]
                        sum_green += w * image[v, u, 1]
                        sum_blue += w * image[v, u, 2]
                w = 1.0 / (distances[direction] * distances[direction])
                total += w
                depth += w / sample_weight * sum_depth
                red += w / sample_weight * sum_red
                green += w / sample_weight * sum_green
                blue += w / sample_weight * sum_blue
            colors[y, x, 0], colors[y, x, 1], colors[y, x, 2] = red / total, green / total, blue / total
            depths[y, x] = min(depth / total, defocus[y, x])


@njit(cache=True)
def _tile_distances(mask):
    """Return the Chebyshev distance of each tile of ``STEP_TILE`` pixels from one with a set pixel, tiles."""
    height, width = mask.shape
    rows, columns = -(-height // STEP_TILE), -(-width // STEP_TILE)
    distances = np.full((rows, columns), rows + columns)
    for y in range(height):
        for x in range(width):
            if mask[y, x]:
                distances[y // STEP_TILE, x // STEP_TILE] = 0
    for sign in (1, -1):  # two passes: from the top left, then from the bottom right
        for line in range(rows):
            row = line if sign > 0 else rows - 1 - line
            for index in range(columns):
                column = index if sign > 0 else columns - 1 - index
                for down, right in ((0, -sign), (-sign, -1), (-sign, 0), (-sign, 1)):
                    v, u = row + down, column + right
                    if 0 <= v < rows and 0 <= u < columns:
                        distances[row, column] = min(distances[row, column], distances[v, u] + 1)
    return distances


@njit(cache=True, parallel=True)
def _remove_unseen(depths, tile_distances, distances):
    """Set ``distances`` to 0 where no ray of a pixel of the mask of ``tile_distances`` can arrive."""
    height, width = depths.shape
    for y in prange(height):
        for x in range(width):
            if distances[y, x] > 0:
                apart = (tile_distances[y // STEP_TILE, x // STEP_TILE] - 1) * STEP_TILE
                if apart > abs(depths[y, x]) + _READING_MARGIN_PX:
                    distances[y, x] = 0


@njit(cache=True, parallel=True)
def _smooth(ys, xs, defocus, lights, distances, colors, depths, smooth_colors, smooth_depths):
    """Average the occluded background over its surroundings, to remove streaks of directions.

    Near the edge these are its surface; farther in, where the choice of a surface is uncertain, all of it.

    Args:
        ys: Rows of the occluded pixels, (N,).
        xs: Their columns, (N,).
        defocus: Defocus of the occluders, (H, W), pixels.
        lights: Lights of the picture, which do not count, (H, W).
        distances: Distance of occluded pixels from the edge of the occluder, (H, W), pixels; 0 elsewhere.
        colors: Occluded background, (H, W, 3).
        depths: Its defocus, (H, W).
        smooth_colors: Output, (N, 3).
        smooth_depths: Output, (N,).
    """
    height, width = depths.shape
    for i in prange(len(ys)):
        y, x = ys[i], xs[i]
        spacing = max(1, int(distances[y, x] * _SMOOTHING_SPACING))
        weight = depth = red = green = blue = 0.0
        for down in range(-_SMOOTHING_REACH, _SMOOTHING_REACH + 1):
            for right in range(-_SMOOTHING_REACH, _SMOOTHING_REACH + 1):
                v, u = y + spacing * down, x + spacing * right
                if not (0 <= v < height and 0 <= u < width):
                    continue
                if not (distances[v, u] > 0 or not lights[v, u]):
                    continue
                alike = abs(depths[v, u] - depths[y, x]) <= DISCONTINUITY_THRESHOLD
                if alike or (spacing > 1 and depths[v, u] < defocus[y, x] - DISCONTINUITY_THRESHOLD):
                    weight += 1.0
                    depth += depths[v, u]
                    red += colors[v, u, 0]
                    green += colors[v, u, 1]
                    blue += colors[v, u, 2]
        smooth_colors[i, 0], smooth_colors[i, 1] = red / weight, green / weight
        smooth_colors[i, 2] = blue / weight
        smooth_depths[i] = depth / weight


@njit(cache=True, parallel=True)
def _blend_inpainted(ys, xs, distances, lines, textures, colors):
    """Blend the occluded background, (N), from the mean of two estimates at the edge to ``colors`` inside."""
    for i in prange(len(ys)):
        y, x = ys[i], xs[i]
        weight = math.exp(-distances[y, x] / _FADING_DISTANCE_PX)
        for c in range(3):
            estimate = lines[y, x, c]
            if distances[y, x] <= MAX_TEXTURE_DISTANCE_PX:
                estimate = 0.5 * (estimate + textures[y, x, c])
            colors[y, x, c] += weight * (estimate - colors[y, x, c])


@njit(cache=True)
def _scale_down(color, limit):
    """Scale a color, (3,) in place, down to ``limit`` if it is brighter."""
    limit, brightest = max(limit, 0.0), max(color[0], color[1], color[2])
    if brightest > limit:
        for c in range(3):
            color[c] *= limit / brightest


@njit(cache=True, parallel=True)
def _limit_brightness(ys, xs, limit, colors):
    """Scale the occluded background, (N), down to ``limit``, (H, W), where it is brighter."""
    for i in prange(len(ys)):
        _scale_down(colors[ys[i], xs[i]], limit[ys[i], xs[i]])


@njit(cache=True, parallel=True)
def _limit_lines(ys, xs, means, lines):
    """Scale lines, at (N) positions, down to a multiple of ``means``, (H, W, 3)."""
    for i in prange(len(ys)):
        mean = means[ys[i], xs[i]]
        _scale_down(lines[ys[i], xs[i]], _MAX_LINE_BRIGHTNESS * max(mean[0], mean[1], mean[2]))


def occluded_background(
    image: npt.NDArray[np.floating[Any]],
    defocus: npt.NDArray[np.floating[Any]],
    max_coc_radius: int | None = None,
    inpainted: npt.NDArray[np.bool_] | None = None,
    rays_mask: npt.NDArray[np.bool_] | None = None,
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Estimate the background behind each foreground, as far inwards from its edge as rays can see.

    Along rows, columns and diagonals each pixel searches for the first surface that continues behind it. The
    one with the most and nearest directions is continued, so that a pole behind a blade of grass stays a
    pole; its color and defocus are means over all directions to it, weighted by the inverse squares of the
    distances, so that the background blends from one side to the other. Each direction contributes an average
    over samples whose spacing grows with the distance, since the interior is less certain; and the whole is
    smoothed over windows that grow likewise, near the edge within a surface, farther in over all of them.
    Lights are not continued: one next to the edge does not predict another. Near the edge the background is
    the mean of two estimates: continued lines of the surface
    (:mod:`bokehnet.classical.layered.background.structure_transport`), unless they are far brighter than the
    mean, as the rims of lamps are, and its texture
    (:mod:`bokehnet.classical.layered.background.exemplar_inpainting`).

    Args:
        image: All-in-focus picture, scene-linear, (H, W, 3).
        defocus: Signed blur radius in pixels, (H, W), + in front of focus.
        max_coc_radius: Half-width in pixels of the surroundings that a light must exceed; default: the
            largest radius.
        inpainted: Pixels to inpaint, (H, W); behind others only the means are computed. Default: all.
        rays_mask: Pixels that send rays, (H, W): only what these can reach is inpainted. Default: all.

    Returns:
        Colors (H, W, 3) and defocus (H, W). Where nothing is occluded they equal the inputs.

    Raises:
        ShapeError: The arrays are not (H, W, 3) and (H, W) of the same size.
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
    steps = np.zeros((len(_DIRECTIONS), *defocus.shape), np.uint16)
    distances = np.zeros(defocus.shape, defocus.dtype)
    stepped = tiles_with_steps(defocus, 1)
    reached = np.zeros((len(_DIRECTIONS), *stepped.shape), np.bool_)
    with parallel_region:
        _search_directions(defocus, stepped, steps, reached)
        _fill(image, defocus, lights, steps, reached.any(0), colors, depths, distances)
    del steps
    if inpainted is not None:
        distances[~inpainted] = 0
    if rays_mask is not None:
        with parallel_region:
            _remove_unseen(depths, _tile_distances(rays_mask), distances)
    occluded = occluded_rings(distances)
    ys, xs = occluded.ys, occluded.xs
    if not len(ys):
        return colors, depths
    smooth_colors, smooth_depths = np.empty((len(ys), 3), colors.dtype), np.empty(len(ys), depths.dtype)
    with parallel_region:
        smooth_boundaries(ys, xs, defocus, distances, colors, depths)
        _limit_brightness(ys, xs, limit, colors)
        for _ in range(_SMOOTHING_PASSES):
            _smooth(ys, xs, defocus, lights, distances, colors, depths, smooth_colors, smooth_depths)
            write_occluded(ys, xs, defocus, smooth_colors, smooth_depths, colors, depths)
        del smooth_colors, smooth_depths
        near = occluded.within(_MAX_LINE_DISTANCE_PX)
        near = near.select(np.abs(depths[near.ys, near.xs]) <= _MAX_INPAINTED_RADIUS_PX)
        ys, xs = near.ys, near.xs
        lines = continue_lines(image, defocus, lights, depths, near, colors)
        _limit_lines(ys, xs, colors, lines)
        textures = inpaint_texture(image, defocus, lights, depths, distances, near, lines)
        _blend_inpainted(ys, xs, distances, lines, textures, colors)
        _limit_brightness(ys, xs, limit, colors)
    return colors, depths
