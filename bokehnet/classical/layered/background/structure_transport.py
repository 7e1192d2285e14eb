"""Continuation of the lines of a background behind an occluder: fences, bricks, horizons, letters.

Occluded pixels are filled from the edge inwards. Each becomes a mean of pixels of its own surface that are
visible or already filled; where the surface shows lines, pixels along them have more weight.

Source: Bornemann and März, "Fast image inpainting based on coherence transport", Journal of Mathematical
Imaging and Vision 2007, for the order and the weights; Weickert, "Coherence-enhancing diffusion filtering",
International Journal of Computer Vision 1999, for coherence. The propagation of the structure tensor by
filled pixels is ours.
"""

import math

import numpy as np
from numba import prange

from bokehnet.classical.layered.background.inpainting_order import OccludedRings
from bokehnet.classical.layered.depth_discontinuities import STEP_TILE, are_one_surface
from bokehnet.kernels import njit

__all__ = ["continue_lines", "tiles_around"]

# Half-width of the window for colors and directions, pixels.
_WINDOW_REACH_PX = 3

# Decrease of the weights across a line, at the edge of the window: exp(-s^2 / 2).
_SHARPNESS = 12.0

# Squared contrast of neighbours, of the square root of light, from which on lines have full weight.
_LINE_CONTRAST = 3e-4

# Weights of a light, and of a pixel next to a step, where surfaces mix, over that of others.
_LIGHT_WEIGHT, _STEP_WEIGHT = 1e-3, 0.1

# Lower bound of all weights.
_MIN_WEIGHT = 1e-9


# Rows and columns to the pixels of a window, and their distances.
_NEIGHBOURS = np.array(
    [
        (v, u)
        for v in range(-_WINDOW_REACH_PX, _WINDOW_REACH_PX + 1)
        for u in range(-_WINDOW_REACH_PX, _WINDOW_REACH_PX + 1)
        if (v, u) != (0, 0)
    ]
)
_NEIGHBOUR_DISTANCES = np.sqrt((_NEIGHBOURS**2).sum(1))

# Pixels per chunk of a parallel loop.
_CHUNK_PIXELS = 256


@njit(cache=True, parallel=True)
def _brightness(image, active_tiles, result):
    """Fill ``result`` with the mean of the square roots of light in tiles and one pixel around them."""
    for y in prange(result.shape[0]):
        for x in range(result.shape[1]):
            v, u = min(y + 1, result.shape[0] - 1) // STEP_TILE, min(x + 1, result.shape[1] - 1) // STEP_TILE
            top, left = max(y - 1, 0) // STEP_TILE, max(x - 1, 0) // STEP_TILE
            if not (
                active_tiles[top, left] or active_tiles[top, u] or active_tiles[v, left] or active_tiles[v, u]
            ):
                continue
            red, green = math.sqrt(max(image[y, x, 0], 0.0)), math.sqrt(max(image[y, x, 1], 0.0))
            result[y, x] = (red + green + math.sqrt(max(image[y, x, 2], 0.0))) / 3.0


@njit(cache=True, parallel=True)
def _structure(brightness, defocus, lights, active_tiles, tensors):
    """Fill outer products of the gradient, (H, W, 3): xx, xy, yy; xx is -1 next to lights and other surfaces.

    Only ``active_tiles`` are set.
    """
    height, width = brightness.shape
    for y in prange(height):
        for x in range(width):
            if not active_tiles[y // STEP_TILE, x // STEP_TILE]:
                continue
            tensors[y, x, 0] = -1.0
            if not (0 < y < height - 1 and 0 < x < width - 1):
                continue
            is_uniform = not lights[y, x]
            for offset in range(-1, 2, 2):
                is_uniform = is_uniform and not lights[y + offset, x] and not lights[y, x + offset]
                is_uniform = is_uniform and are_one_surface(defocus[y + offset, x], defocus[y, x], 1.0)
                is_uniform = is_uniform and are_one_surface(defocus[y, x + offset], defocus[y, x], 1.0)
            if is_uniform:
                right = 0.5 * (brightness[y, x + 1] - brightness[y, x - 1])
                down = 0.5 * (brightness[y + 1, x] - brightness[y - 1, x])
                tensors[y, x, 0] = right * right
                tensors[y, x, 1] = right * down
                tensors[y, x, 2] = down * down


@njit(cache=True)
def tiles_around(ys, xs, reach, tiles):
    """Mark the tiles of pixels, and those up to ``reach`` tiles away, in (rows, columns)."""
    for i in range(len(ys)):
        row, column = ys[i] // STEP_TILE, xs[i] // STEP_TILE
        if i > 0 and row == ys[i - 1] // STEP_TILE and column == xs[i - 1] // STEP_TILE:
            continue
        for v in range(max(0, row - reach), min(tiles.shape[0], row + reach + 1)):
            for u in range(max(0, column - reach), min(tiles.shape[1], column + reach + 1)):
                tiles[v, u] = True


@njit(cache=True)
def _source_kind(seen, behind, ring, rings, apart, depth):
    """Return whether a pixel shows a surface (1), occludes it but is already filled (2), or neither (0)."""
    if are_one_surface(seen, depth, apart):
        return 1
    return 2 if 0 < ring < rings and are_one_surface(behind, depth, apart) else 0


@njit(cache=True)
def _find_sources(defocus, depths, rings, y, x, kinds):
    """Set the kind of source of each neighbour of an occluded pixel, by :func:`_source_kind`."""
    height, width = defocus.shape
    for i in range(len(_NEIGHBOURS)):
        v, u = y + _NEIGHBOURS[i, 0], x + _NEIGHBOURS[i, 1]
        kinds[i] = 0
        if 0 <= v < height and 0 <= u < width:
            ring, own = rings[v, u], rings[y, x]
            kinds[i] = _source_kind(
                defocus[v, u], depths[v, u], ring, own, _NEIGHBOUR_DISTANCES[i], depths[y, x]
            )


@njit(cache=True)
def _direction(kinds, tensors, carried, y, x):
    """Return the mean structure tensor around an occluded pixel."""
    xx = xy = yy = total = 0.0
    for i in range(len(_NEIGHBOURS)):
        v, u = y + _NEIGHBOURS[i, 0], x + _NEIGHBOURS[i, 1]
        if kinds[i] == 0 or (kinds[i] == 1 and tensors[v, u, 0] < 0.0):
            continue
        known = tensors if kinds[i] == 1 else carried
        weight = 1.0 / _NEIGHBOUR_DISTANCES[i]
        total += weight
        xx += weight * known[v, u, 0]
        xy += weight * known[v, u, 1]
        yy += weight * known[v, u, 2]
    if total > 0.0:
        xx, xy, yy = xx / total, xy / total, yy / total
    return xx, xy, yy


@njit(cache=True)
def _mean_along(image, kinds, lights, tensors, xx, xy, yy, colors, y, x):
    """Set an occluded pixel to the mean of its sources, weighted along the line."""
    spread = math.sqrt((xx - yy) * (xx - yy) + 4.0 * xy * xy)  # difference of the eigenvalues
    coherence = spread / (xx + yy + 1e-12)
    sharpness = _SHARPNESS / _WINDOW_REACH_PX * coherence * coherence * min(1.0, spread / _LINE_CONTRAST)
    angle = 0.5 * math.atan2(2.0 * xy, xx - yy)
    across_x, across_y = sharpness * math.cos(angle), sharpness * math.sin(angle)
    total = red = green = blue = 0.0
    for i in range(len(_NEIGHBOURS)):
        if kinds[i] == 0:
            continue
        down, right = _NEIGHBOURS[i]
        v, u, away = y + down, x + right, across_x * right + across_y * down
        weight = math.exp(-0.5 * away * away) / _NEIGHBOUR_DISTANCES[i]
        if kinds[i] == 1:
            if lights[v, u]:
                weight *= _LIGHT_WEIGHT
            elif tensors[v, u, 0] < 0.0:
                weight *= _STEP_WEIGHT
        weight += _MIN_WEIGHT
        known = image if kinds[i] == 1 else colors
        red += weight * known[v, u, 0]
        green += weight * known[v, u, 1]
        blue += weight * known[v, u, 2]
        total += weight
    if total > 0.0:
        colors[y, x, 0], colors[y, x, 1], colors[y, x, 2] = red / total, green / total, blue / total


@njit(cache=True, parallel=True)
def _fill(image, defocus, depths, rings, lights, tensors, ys, xs, ends, means, colors, carried):
    """Set occluded pixels, ring by ring, to the mean along their line, or to ``means`` without a source."""
    for ring in range(1, len(ends)):
        first, last = ends[ring - 1], ends[ring]
        for chunk in prange((last - first + _CHUNK_PIXELS - 1) // _CHUNK_PIXELS):
            kinds = np.empty(len(_NEIGHBOURS), np.uint8)
            start = first + chunk * _CHUNK_PIXELS
            for i in range(start, min(start + _CHUNK_PIXELS, last)):
                y, x = ys[i], xs[i]
                _find_sources(defocus, depths, rings, y, x, kinds)
                xx, xy, yy = _direction(kinds, tensors, carried, y, x)
                carried[y, x, 0], carried[y, x, 1], carried[y, x, 2] = xx, xy, yy
                for c in range(3):
                    colors[y, x, c] = means[y, x, c]
                _mean_along(image, kinds, lights, tensors, xx, xy, yy, colors, y, x)


def continue_lines(
    image: np.ndarray,
    defocus: np.ndarray,
    lights: np.ndarray,
    depths: np.ndarray,
    hidden: OccludedRings,
    means: np.ndarray,
) -> np.ndarray:
    """Fill occluded pixels with the lines of their surface.

    Args:
        image: Visible picture, scene-linear, (H, W, 3) float32.
        defocus: Defocus of the visible picture, signed blur radius in pixels, (H, W) float32.
        lights: Visible pixels that are not continued, (H, W) bool.
        depths: Defocus of the occluded background, (H, W) float32.
        hidden: Occluded pixels.
        means: Means of the surroundings, (H, W, 3) float32, for pixels without a visible source.

    Returns:
        Colors, (H, W, 3) float32, set for occluded pixels.
    """
    ys, xs, ends, rings = hidden
    brightness, tensors = np.empty(rings.shape, image.dtype), np.empty_like(image)
    tiles = tuple(-(-size // STEP_TILE) for size in image.shape[:2])
    active_tiles = np.zeros(tiles, np.bool_)
    tiles_around(ys, xs, 1, active_tiles)
    _brightness(image, active_tiles, brightness)
    _structure(brightness, defocus, lights, active_tiles, tensors)
    lines, carried = np.empty_like(image), np.empty_like(image)  # set and read at occluded pixels only
    _fill(image, defocus, depths, rings, lights, tensors, ys, xs, ends, means, lines, carried)
    return lines
