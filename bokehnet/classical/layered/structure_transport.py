"""Lines of a background carried on behind what hides it: fences, bricks, horizons, letters.

Hidden pixels are filled from the edge inwards. Each becomes a mean of pixels of its own surface that are seen
or are filled already; where the surface shows lines, those count that lie along them.

Source: Bornemann and März, "Fast image inpainting based on coherence transport", Journal of Mathematical
Imaging and Vision 2007, for the order and the weights; Weickert, "Coherence-enhancing diffusion filtering",
International Journal of Computer Vision 1999, for what coherence is. That filled pixels hand on the structure
tensor by which they were filled is ours.
"""

import math

import numpy as np
from numba import prange

from bokehnet.classical.layered.depth_discontinuities import are_one_surface
from bokehnet.kernels import njit

__all__ = ["carry_lines_on"]

# Half the width of the window from which colours and directions are taken.
_REACH = 3

# How much less pixels count across a line, at the edge of the window: exp(-s^2 / 2).
_SHARPNESS = 12.0

# Squared contrast of neighbours, of the square root of light, of lines that count in full.
_CONTRAST = 3e-4

# Weights of a light, and of a pixel beside a step, which hardly shows its surface alone, beside that of others.
_LIGHT, _BESIDE_STEP = 1e-3, 0.1

# The least of all weights.
_LEAST = 1e-9

# Distance from the edge, in pixels, at which a line counts 1 / e: the farther, the less it is sure to go on.
_FADING = 16.0


@njit(cache=True, parallel=True)
def _structure(brightness, defocus, lights, tensors):  # type: ignore[no-untyped-def]
    """Outer products of the gradient, (H, W, 3): xx, xy, yy; xx is -1 beside lights and other surfaces."""
    height, width = brightness.shape
    for y in prange(height):
        for x in range(width):
            tensors[y, x, 0] = -1.0
            if not (0 < y < height - 1 and 0 < x < width - 1):
                continue
            whole = not lights[y, x]
            for way in range(-1, 2, 2):
                whole = whole and not lights[y + way, x] and not lights[y, x + way]
                whole = whole and are_one_surface(defocus[y + way, x], defocus[y, x], 1.0)
                whole = whole and are_one_surface(defocus[y, x + way], defocus[y, x], 1.0)
            if whole:
                right = 0.5 * (brightness[y, x + 1] - brightness[y, x - 1])
                down = 0.5 * (brightness[y + 1, x] - brightness[y - 1, x])
                tensors[y, x, 0] = right * right
                tensors[y, x, 1] = right * down
                tensors[y, x, 2] = down * down


@njit(cache=True)
def _source(seen, behind, ring, rings, apart, depth):  # type: ignore[no-untyped-def]
    """Whether a pixel shows a surface (1), hides it but is filled already (2), or neither (0)."""
    if are_one_surface(seen, depth, apart):
        return 1
    return 2 if 0 < ring < rings and are_one_surface(behind, depth, apart) else 0


@njit(cache=True)
def _direction(defocus, depths, rings, tensors, carried, y, x):  # type: ignore[no-untyped-def]
    """Mean structure tensor around a hidden pixel."""
    height, width = defocus.shape
    xx = xy = yy = total = 0.0
    for v in range(max(0, y - _REACH), min(height, y + _REACH + 1)):
        for u in range(max(0, x - _REACH), min(width, x + _REACH + 1)):
            apart = math.sqrt((v - y) * (v - y) + (u - x) * (u - x))
            found = _source(defocus[v, u], depths[v, u], rings[v, u], rings[y, x], apart, depths[y, x])
            if (v == y and u == x) or found == 0 or (found == 1 and tensors[v, u, 0] < 0.0):
                continue
            weight = 1.0 / apart
            total += weight
            if found == 1:
                xx += weight * tensors[v, u, 0]
                xy += weight * tensors[v, u, 1]
                yy += weight * tensors[v, u, 2]
            else:
                xx += weight * carried[v, u, 0]
                xy += weight * carried[v, u, 1]
                yy += weight * carried[v, u, 2]
    if total > 0.0:
        xx, xy, yy = xx / total, xy / total, yy / total
    return xx, xy, yy


@njit(cache=True)
def _mean_along(image, defocus, depths, rings, lights, tensors, xx, xy, yy, colors, y, x):  # type: ignore[no-untyped-def]
    """Set a hidden pixel to the mean of its sources, those along the line first."""
    height, width = defocus.shape
    spread = math.sqrt((xx - yy) * (xx - yy) + 4.0 * xy * xy)  # of the eigenvalues
    coherence = spread / (xx + yy + 1e-12)
    sharpness = _SHARPNESS / _REACH * coherence * coherence * min(1.0, spread / _CONTRAST)
    angle = 0.5 * math.atan2(2.0 * xy, xx - yy)
    across_x, across_y = math.cos(angle), math.sin(angle)
    total = red = green = blue = 0.0
    for v in range(max(0, y - _REACH), min(height, y + _REACH + 1)):
        for u in range(max(0, x - _REACH), min(width, x + _REACH + 1)):
            if v == y and u == x:
                continue
            apart = math.sqrt((v - y) * (v - y) + (u - x) * (u - x))
            found = _source(defocus[v, u], depths[v, u], rings[v, u], rings[y, x], apart, depths[y, x])
            if found == 0:
                continue
            away = sharpness * (across_x * (u - x) + across_y * (v - y))
            weight = math.exp(-0.5 * away * away) / apart
            if found == 1:
                if lights[v, u]:
                    weight *= _LIGHT
                elif tensors[v, u, 0] < 0.0:
                    weight *= _BESIDE_STEP
                weight += _LEAST
                red += weight * image[v, u, 0]
                green += weight * image[v, u, 1]
                blue += weight * image[v, u, 2]
            else:
                weight += _LEAST
                red += weight * colors[v, u, 0]
                green += weight * colors[v, u, 1]
                blue += weight * colors[v, u, 2]
            total += weight
    if total > 0.0:
        colors[y, x, 0], colors[y, x, 1], colors[y, x, 2] = red / total, green / total, blue / total


@njit(cache=True, parallel=True)
def _fill(image, defocus, depths, rings, lights, tensors, ys, xs, ends, colors, carried):  # type: ignore[no-untyped-def]
    for ring in range(1, len(ends)):
        for i in prange(ends[ring - 1], ends[ring]):
            y, x = ys[i], xs[i]
            xx, xy, yy = _direction(defocus, depths, rings, tensors, carried, y, x)
            carried[y, x, 0], carried[y, x, 1], carried[y, x, 2] = xx, xy, yy
            _mean_along(image, defocus, depths, rings, lights, tensors, xx, xy, yy, colors, y, x)


def carry_lines_on(
    image: np.ndarray,
    defocus: np.ndarray,
    lights: np.ndarray,
    depths: np.ndarray,
    distances: np.ndarray,
    colors: np.ndarray,
) -> None:
    """Fill hidden pixels with the lines of their surface; farther inside, with what ``colors`` holds.

    Args:
        image: What is seen, scene-linear, (H, W, 3) float32.
        defocus: Of what is seen, signed blur radius in pixels, (H, W) float32.
        lights: Seen pixels that are not carried on, (H, W) bool.
        depths: Defocus of what is hidden, (H, W) float32.
        distances: From the nearest edge of what hides it, pixels, (H, W) float32; 0 where nothing is hidden.
        colors: Means of what is around, (H, W, 3) float32; overwritten where something is hidden.
    """
    rings = np.ceil(distances).astype(np.int32)
    ys, xs = np.nonzero(rings)
    if not len(ys):
        return
    order = np.argsort(rings[ys, xs], kind="stable")
    ys, xs = ys[order], xs[order]
    ends = np.searchsorted(rings[ys, xs], np.arange(1, int(rings[ys[-1], xs[-1]]) + 2))
    tensors, carried = np.empty_like(image), np.zeros_like(image)
    _structure(np.sqrt(np.maximum(image, 0)).mean(-1), defocus, lights, tensors)
    lines = colors.copy()
    _fill(image, defocus, depths, rings, lights, tensors, ys, xs, ends, lines, carried)
    share = np.exp(-distances[ys, xs] / _FADING)[:, None]
    colors[ys, xs] += share * (lines[ys, xs] - colors[ys, xs])
