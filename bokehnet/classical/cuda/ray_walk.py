"""Rays of one pixel, one at a time, for compilers without vectors.

The algorithm and the order of all sums are those of :mod:`bokehnet.classical.layered.march.intersection` and
``ray_marching``, which trace eight rays at once and document it. :func:`make_march` compiles it: with
``cuda.jit`` for a device, with the ``njit`` of numba in tests.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from bokehnet.classical.layered.boundaries.pixel_boundaries import LEVELS, PER_SLOPE, STEPS
from bokehnet.classical.layered.depth_discontinuities import DISCONTINUITY_THRESHOLD
from bokehnet.classical.layered.march.defocus_bins import BINS, TILE
from bokehnet.classical.layered.march.intersection import BELOW_ONE, CLOSE, LOOKS, SHORT, STEEPEST
from bokehnet.classical.layered.march.ray_accumulators import FILTERED_RADIUS, PLAIN
from bokehnet.classical.layered.march.ray_marching import SETS, scramble

__all__ = ["GROUP_RAYS", "make_march"]

GROUP_RAYS = 8
"""Rays per group on a smooth surface: if the fixed-point iteration of one ray fails, all of them march."""

_F = np.float32
_THRESHOLD = _F(DISCONTINUITY_THRESHOLD)
_ZERO, _HALF, _ONE, _NEVER = _F(0), _F(0.5), _F(1), _F(-1e30)
_SIDE, _PER_SIDE, _LAST_BIN = _F(TILE), _F(1 / TILE), BINS - 1
_LARGE = _F(FILTERED_RADIUS**2)


def make_march(jit: Callable[[Callable[..., Any]], Any]) -> Any:
    """Compile the function that renders the rays of one pixel.

    Args:
        jit: Decorator that makes a function callable from other compiled functions.

    Returns:
        ``march_pixel(x, y, colors, cells, tiles, runs, count, smooth, points, chances, weights, pattern,
        sums, totals, looks, before, sent)``: it adds the rays number ``before`` to ``sent`` of the
        pixel to its means ``sums`` (GROUPS, PLAIN). ``colors`` and ``cells`` are those of the march;
        ``tiles`` is ``(held, low, bins per pixel)``; ``runs`` is (n, 2), with ``count`` valid rows;
        ``pattern`` is ``(variants, seed, above, cats_eye, shift_x, shift_y)``; ``totals`` and ``looks`` are
        buffers for sums (GROUPS, PLAIN) and for row, column and defocus of eight iterates, (3, GROUP_RAYS).
    """
    hashed = jit(scramble.function)

    @jit
    def clamp(value: Any, last: Any) -> Any:
        return min(max(value, _ZERO), last)

    @jit
    def coverage(code: Any, x: Any, y: Any) -> Any:
        whole = code * _F(LEVELS * STEPS * STEPS)
        upper = _F(math.floor(whole * _F(1.0 / STEPS)))
        level = _F(math.floor(upper * _F(1.0 / STEPS)))
        across = upper - level * _F(STEPS) - _F(STEPS // 2)
        along = whole - upper * _F(STEPS) - _F(STEPS // 2)
        slope = (across * x + along * y) * _F(1.0 / PER_SLOPE)
        return (level + _HALF) * _F(1.0 / LEVELS) + slope

    @jit
    def holds(held: Any, row: Any, column: Any, first: Any, last: Any) -> Any:
        """Return whether a tile contains one of the bins ``first`` to ``last``."""
        row = min(max(row, 0), held.shape[0] - 1)
        column = min(max(column, 0), held.shape[1] - 1)
        low, high = int(clamp(first, _F(_LAST_BIN))), int(clamp(last, _F(_LAST_BIN)))
        all_bins = np.uint64(0xFFFFFFFFFFFFFFFF)
        mask = (all_bins << np.uint64(low)) & (all_bins >> np.uint64(_LAST_BIN - high))
        return (held[row, column] & mask) != np.uint64(0)

    @jit
    def look(cells: Any, x: Any, y: Any, u: Any, v: Any, depth: Any) -> Any:
        """Iterate the intersection of a ray; return whether it still moves, row, column and defocus."""
        column = clamp(_F(math.floor(x + _HALF - u * depth)), _F(cells.shape[1] - 1))
        row = clamp(_F(math.floor(y + _HALF - v * depth)), _F(cells.shape[0] - 1))
        surface_defocus = cells[int(row), int(column), 0, 0]
        moving = max(abs(u), abs(v)) * abs(surface_defocus - depth) > CLOSE
        return moving, int(row), int(column), surface_defocus

    @jit
    def walk(
        cells: Any, tiles: Any, runs: Any, count: Any, x: Any, y: Any, u: Any, v: Any, chance: Any
    ) -> Any:
        """Return row, column, layer (-1 for none) and defocus of the first surface that a ray meets."""
        height, width, layers = cells.shape[0], cells.shape[1], cells.shape[2]
        held, low, scale = tiles
        last_x, last_y = _F(width - 1), _F(height - 1)
        right, down = u > _ZERO, v > _ZERO
        step_x, step_y = _ONE if right else -_ONE, _ONE if down else -_ONE
        gain_x, gain_y = _ONE / max(abs(u), STEEPEST), _ONE / max(abs(v), STEEPEST)
        tile_gain_x, tile_gain_y = _SIDE * gain_x, _SIDE * gain_y
        for run in range(count):
            front, length = _F(runs[run, 0]), _F(runs[run, 0] - runs[run, 1])
            is_long = runs[run, 0] - runs[run, 1] >= SHORT
            place_x, place_y = _HALF - u * front, _HALF - v * front
            column, row = _F(math.floor(place_x)), _F(math.floor(place_y))
            part_x, part_y = place_x - column, place_y - row
            column, row = x + column, y + row
            tile_x, tile_y = _F(math.floor(column * _PER_SIDE)), _F(math.floor(row * _PER_SIDE))
            part_x, part_y = column - _SIDE * tile_x + part_x, row - _SIDE * tile_y + part_y
            tile_to_x, tile_to_y = length, length
            if is_long:
                tile_to_x = (_SIDE - part_x if right else part_x) * gain_x
                tile_to_y = (_SIDE - part_y if down else part_y) * gain_y
            below, passed, marching = _NEVER, _ZERO, True
            while marching:
                seeking = is_long
                while seeking:
                    end = min(min(tile_to_x, tile_to_y), length)
                    first, last = (front - end - low) * scale, (front - passed - low) * scale
                    if holds(held, int(tile_y), int(tile_x), first, last):
                        break
                    below, passed = _NEVER, end
                    if end >= length:
                        marching = seeking = False
                    elif tile_to_x < tile_to_y:
                        tile_x += step_x
                        tile_to_x += tile_gain_x
                    else:
                        tile_y += step_y
                        tile_to_y += tile_gain_y
                if not marching:
                    break
                end = min(min(tile_to_x, tile_to_y), length)
                start, within = front - passed, end - passed
                place_x, place_y = _HALF - u * start, _HALF - v * start
                column, row = _F(math.floor(place_x)), _F(math.floor(place_y))
                place_x, place_y = place_x - column, place_y - row
                to_x = (_ONE - place_x if right else place_x) * gain_x
                to_y = (_ONE - place_y if down else place_y) * gain_y
                column, row = x + column, y + row
                entry, walking = start, True
                while walking:
                    advance = min(min(to_x, to_y), within)
                    leave = start - advance
                    inside_x, inside_y = int(clamp(column, last_x)), int(clamp(row, last_y))
                    nearest_below = _NEVER
                    for layer in range(layers):
                        depth = cells[inside_y, inside_x, layer, 0]
                        cover = cells[inside_y, inside_x, layer, 1]
                        if depth < leave:
                            nearest_below = max(nearest_below, depth)
                            continue
                        is_partial = cover > _ZERO and cover < _ONE
                        if entry < depth and (is_partial or depth - below > _THRESHOLD):
                            continue
                        if is_partial:
                            away_x = x + _HALF - u * depth - column - _HALF
                            away_y = y + _HALF - v * depth - row - _HALF
                            cover = max(coverage(cover, away_x, away_y), _ZERO)
                        if chance < cover:
                            return inside_y, inside_x, layer, depth
                        if is_partial:
                            chance = min((chance - cover) / (_ONE - cover), BELOW_ONE)
                    below, entry = nearest_below, leave
                    walking = bool(advance < within)
                    if to_x < to_y:
                        column += step_x
                        to_x += gain_x
                    else:
                        row += step_y
                        to_y += gain_y
                marching, passed = bool(end < length), end
                if tile_to_x < tile_to_y:
                    tile_x += step_x
                    tile_to_x += tile_gain_x
                else:
                    tile_y += step_y
                    tile_to_y += tile_gain_y
        return 0, 0, -1, _ZERO

    @jit
    def add(totals: Any, light: Any, depth: Any, weight: Any, unseen: Any) -> None:
        """Add the light and the weight of a ray to the totals of its group."""
        blur = depth * depth
        group = 1
        if depth > _ZERO:
            group = 0
        elif blur >= _LARGE:
            group = 2
        if blur < _LARGE:
            group = 1
        for c in range(3):
            totals[group, c] += weight * light[c]
        totals[group, 3] += weight
        if group == 1:
            brightness = _F(1 / 3) * (light[0] + light[1] + light[2])
            totals[group, 4] += weight * brightness * brightness
        else:
            totals[group, 4] += weight / _F(math.sqrt(max(blur, _LARGE)))
        totals[group, 5] += unseen

    @jit
    def march_pixel(
        column: Any,
        line: Any,
        colors: Any,
        cells: Any,
        tiles: Any,
        runs: Any,
        count: Any,
        smooth: Any,
        points: Any,
        chances: Any,
        weights: Any,
        pattern: Any,
        sums: Any,
        totals: Any,
        looks: Any,
        before: Any,
        sent: Any,
    ) -> None:
        variants, seed, above, cats_eye, shift_x, shift_y = pattern
        random_bits = hashed(column, line + above, seed)
        point_set = int(random_bits % np.uint64(variants)) * SETS + ((line + above) % 3) * 3 + column % 3
        first_chance = _F(random_bits / 4294967296.0)
        x, y = _F(column), _F(line)
        right, bottom = _F(cells.shape[1]), _F(cells.shape[0])
        for group in range(totals.shape[0]):
            for c in range(PLAIN):
                totals[group, c] = _ZERO
        for start in range(before, sent, GROUP_RAYS):
            has_converged = False
            if smooth:
                for lane in range(GROUP_RAYS):
                    looks[2, lane] = cells[line, column, 0, 0]
                for _ in range(LOOKS):
                    has_converged = True
                    for lane in range(GROUP_RAYS):
                        k = start + lane
                        u, v = points[0, point_set, k], points[1, point_set, k]
                        moving, row, place, surface_defocus = look(cells, x, y, u, v, looks[2, lane])
                        looks[0, lane], looks[1, lane], looks[2, lane] = _F(row), _F(place), surface_defocus
                        if moving:
                            has_converged = False
                    if has_converged:
                        break
            for lane in range(GROUP_RAYS):
                k = start + lane
                u, v = points[0, point_set, k], points[1, point_set, k]
                if has_converged:
                    row, place, layer, depth = int(looks[0, lane]), int(looks[1, lane]), 0, looks[2, lane]
                else:
                    chance = first_chance + chances[k]
                    chance = chance - _F(math.floor(chance))
                    row, place, layer, depth = walk(cells, tiles, runs, count, x, y, u, v, chance)
                w = _ZERO
                if layer >= 0:
                    w = weights[0, point_set, k] if depth > _ZERO else weights[1, point_set, k]
                if cats_eye > 0:
                    away_x, away_y = u - _F(shift_x), v - _F(shift_y)
                    if away_x * away_x + away_y * away_y > _ONE:
                        w = _ZERO
                layer = max(layer, 0)
                unseen = w if layer > 0 else _ZERO
                to_x, to_y = x + _HALF - u * depth, y + _HALF - v * depth
                if min(min(to_x, to_y), min(right - to_x, bottom - to_y)) < _ZERO:
                    unseen = w
                add(totals, colors[row, place, layer], depth, w, unseen)
        old_weight, new_weight = _F(before / sent), _F(1.0 / sent)
        for group in range(totals.shape[0]):
            for c in range(PLAIN):
                sums[group, c] = old_weight * sums[group, c] + new_weight * totals[group, c]

    return march_pixel
