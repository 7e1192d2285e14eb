"""Texture of a background carried on behind what hides it: means of seen pixels that look alike around.

Hidden pixels are filled from the edge inwards. Each is compared, by what is known around it, with seen pixels
of its own surface: those that continue what its filled neighbours took, and some spread about it. Its
colour is the mean of these, the more alike the more.

Source: Criminisi, Perez and Toyama, "Region filling and object removal by exemplar-based image inpainting",
IEEE Transactions on Image Processing 2004, for filling from patches; Barnes, Shechtman, Finkelstein and
Goldman, "PatchMatch: a randomized correspondence algorithm for structural image editing", SIGGRAPH 2009, for
where is looked; Buades, Coll and Morel, "A non-local algorithm for image denoising", CVPR 2005, for the mean.
That only pixels of the hidden surface are looked at is ours.
"""

import math

import numpy as np
from numba import prange

from bokehnet.classical.layered.background.inpainting_order import HiddenRings
from bokehnet.classical.layered.depth_discontinuities import DISCONTINUITY_THRESHOLD, are_one_surface
from bokehnet.classical.simd.float8 import LANES, abs8, broadcast8, less8, load8, select8, sum8
from bokehnet.kernels import njit

__all__ = ["FARTHEST", "fill_with_look_alikes"]

# Radius of what is compared, and of the neighbours that hand on what they took.
_REACH, _BESIDE = 3, 2

# Rows that are compared, of eight pixels, the last of which does not count; and numbers in all of them.
_SIDE, _PLANE = 2 * _REACH + 1, (2 * _REACH + 1) * LANES

# Places looked at within that many distances from the edge, and pixels more.
_PLACES, _FAR, _FARTHER = 40, 2.0, 12.0

# Places looked at around the best of them, nearer and nearer.
_NEARER = (6.0, 6.0, 6.0, 6.0, 6.0, 6.0, 3.0, 3.0, 3.0, 3.0, 3.0, 3.0, 1.6, 1.6, 1.6, 1.6, 1.6, 1.6)

# Weight of filled pixels over that of seen ones, and the least share of what is compared that must be there.
_FILLED, _KNOWN = 0.7, 0.6

# Squared difference, of the square root of light, over the least one, at which a pixel counts 1 / e, and
# what is added to it in parts of the least one.
_UNLIKE, _SLACK = 2e-3, 0.5

# Distance from the edge, in whole pixels, beyond which nothing is looked for.
FARTHEST = 12

# Blur radius of the hidden surface, pixels, beyond which nobody sees its texture.
_MOST_BLURRED = 10.0

_THRESHOLD = np.float32(DISCONTINUITY_THRESHOLD)

# Of these, how many make a pixel count for nothing.
_APART_ENOUGH = 5.0

# Pixels that are filled one after the other.
_CHUNK = 64


def _disc(radius: int) -> np.ndarray:
    """Rows and columns of the pixels within a radius, the nearest first, without the middle."""
    sides = range(-radius, radius + 1)
    return np.array(sorted([(v, u) for v in sides for u in sides if (v, u) != (0, 0)], key=np.linalg.norm))


_NEIGHBOURS = _disc(_REACH)
_APART = np.sqrt((_NEIGHBOURS**2).sum(1))
_WEIGHTS = np.exp(-0.5 * (_APART / (0.6 * _REACH)) ** 2)
_TAKEN = int((_APART < _BESIDE + 0.9).sum())

# Places evenly spread over a square of half side 1: multiples of the powers of the plastic number's inverse
# (Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018).
_PLASTIC = 1.32471795724474602596
_SPREAD = (np.arange(1, 1 + _PLACES + len(_NEARER))[:, None] / (_PLASTIC, _PLASTIC**2)) % 1


@njit(cache=True)
def _unlikeness(roots, defocus, size, v, u, patch, known):  # type: ignore[no-untyped-def]
    """Mean squared difference of a patch from what of its surface surrounds (v, u); inf if that is little."""
    height, width = size
    own, far = broadcast8(defocus[v * width + u]), broadcast8(_THRESHOLD)
    zero = broadcast8(np.float32(0))
    total, weight = zero, zero
    for row in range(_SIDE):
        place, at = (v + row - _REACH) * width + u - _REACH, row * LANES
        red = load8(roots, place) - load8(patch, _PLANE + at)
        green = load8(roots, height * width + place) - load8(patch, 2 * _PLANE + at)
        blue = load8(roots, 2 * height * width + place) - load8(patch, 3 * _PLANE + at)
        w = select8(less8(far, abs8(load8(defocus, place) - own)), zero, load8(patch, at))
        total = total + w * (red * red + green * green + blue * blue)
        weight = weight + w
    found = sum8(weight)
    return sum8(total) / found if found >= _KNOWN * known else np.inf


@njit(cache=True)
def _can_show(defocus, lights, depth, y, x, v, u):  # type: ignore[no-untyped-def]
    """Whether (v, u) shows what is hidden at (y, x), no light, with all that is compared in the picture."""
    height, width = defocus.shape
    if not (_REACH <= v < height - _REACH and _REACH <= u < width + _REACH - LANES) or lights[v, u]:
        return False
    return are_one_surface(defocus[v, u], depth, math.sqrt((v - y) ** 2 + (u - x) ** 2))


@njit(cache=True)
def _fill_patch(defocus, depths, rings, lights, roots, filled, y, x, patch):  # type: ignore[no-untyped-def]
    """Set weights and roots of what is known around a hidden pixel; the sum of the weights."""
    height, width = defocus.shape
    known = 0.0
    patch[:] = 0.0
    for i in range(len(_NEIGHBOURS)):
        down, right = _NEIGHBOURS[i]
        v, u, at = y + down, x + right, (down + _REACH) * LANES + right + _REACH
        if not (0 <= v < height and 0 <= u < width):
            continue
        weight = _WEIGHTS[i]
        if are_one_surface(defocus[v, u], depths[y, x], _APART[i]):
            if lights[v, u]:
                continue
            for c in range(3):
                patch[(1 + c) * _PLANE + at] = roots[c, v, u]
        elif 0 < rings[v, u] < rings[y, x] and are_one_surface(depths[v, u], depths[y, x], _APART[i]):
            weight *= _FILLED
            for c in range(3):
                patch[(1 + c) * _PLANE + at] = math.sqrt(max(filled[v, u, c], 0.0))
        else:
            continue
        patch[at] = weight
        known += weight
    return known


@njit(cache=True)
def _holds(places, count, v, u):  # type: ignore[no-untyped-def]
    """Whether a place is among the first ones."""
    found = False
    for i in range(count):
        found = found or (places[i, 0] == v and places[i, 1] == u)
    return found


@njit(cache=True)
def _mean_of(image, places, costs, count, least, y, x, filled):  # type: ignore[no-untyped-def]
    """Set a hidden pixel to the mean of the places, the more alike the more."""
    total = red = green = blue = 0.0
    scale = 1.0 / (_UNLIKE + _SLACK * least)
    for k in range(count):
        apart = scale * (costs[k] - least)
        if apart > _APART_ENOUGH:
            continue
        w = math.exp(-apart)
        total += w
        red += w * image[places[k, 0], places[k, 1], 0]
        green += w * image[places[k, 0], places[k, 1], 1]
        blue += w * image[places[k, 0], places[k, 1], 2]
    filled[y, x, 0], filled[y, x, 1], filled[y, x, 2] = red / total, green / total, blue / total


@njit(cache=True, parallel=True)
def _fill(  # type: ignore[no-untyped-def]
    image, roots, defocus, depths, distances, lights, ys, xs, ends, rings, colors, sources, filled
):
    """Set hidden pixels of ``filled``, ring by ring; ``sources``: what each is most like, -1 for nothing."""
    height, width = defocus.shape
    most = _TAKEN + _PLACES + len(_NEARER)
    flat_roots, flat_defocus = roots.reshape(-1), defocus.reshape(-1)
    for ring in range(1, len(ends)):
        first, last = ends[ring - 1], ends[ring]
        for chunk in prange((last - first + _CHUNK - 1) // _CHUNK):
            patch = np.empty(4 * _PLANE, np.float32)
            places, costs = np.empty((most, 2), np.int64), np.empty(most)
            start = first + chunk * _CHUNK
            for i in range(start, min(start + _CHUNK, last)):
                y, x = ys[i], xs[i]
                sources[y, x, 0] = -1
                for c in range(3):
                    filled[y, x, c] = colors[y, x, c]
                if abs(depths[y, x]) > _MOST_BLURRED:
                    continue
                known = _fill_patch(defocus, depths, rings, lights, roots, filled, y, x, patch)
                if known == 0.0:
                    continue
                reach = _FAR * distances[y, x] + _FARTHER
                shift_y, shift_x = 4096.0 * colors[y, x, 0], 4096.0 * colors[y, x, 1]
                count, best, least = 0, -1, np.inf
                for k in range(most):
                    if k < _TAKEN:
                        down, right = _NEIGHBOURS[k]
                        v, u = y + down, x + right
                        if not (0 <= v < height and 0 <= u < width):
                            continue
                        if not (0 < rings[v, u] < ring) or sources[v, u, 0] < 0:
                            continue
                        v, u = sources[v, u, 0] - down, sources[v, u, 1] - right
                        if _holds(places, count, v, u):
                            continue
                    else:
                        about_y, about_x, wide = y, x, reach
                        if k >= _TAKEN + _PLACES:
                            if best < 0:
                                break
                            about_y, about_x = places[best]
                            wide = _NEARER[k - _TAKEN - _PLACES]
                        down, right = _SPREAD[k - _TAKEN, 0] + shift_y, _SPREAD[k - _TAKEN, 1] + shift_x
                        v = about_y + int(math.floor((2.0 * (down - math.floor(down)) - 1.0) * wide + 0.5))
                        u = about_x + int(math.floor((2.0 * (right - math.floor(right)) - 1.0) * wide + 0.5))
                    if not _can_show(defocus, lights, depths[y, x], y, x, v, u):
                        continue
                    cost = _unlikeness(flat_roots, flat_defocus, (height, width), v, u, patch, known)
                    if cost == np.inf:
                        continue
                    places[count, 0], places[count, 1], costs[count] = v, u, cost
                    if cost < least:
                        best, least = count, cost
                    count += 1
                if best >= 0:
                    sources[y, x, 0], sources[y, x, 1] = places[best]
                    _mean_of(image, places, costs, count, least, y, x, filled)


@njit(cache=True, parallel=True)
def _roots(image, roots):  # type: ignore[no-untyped-def]
    """Square roots of light, (3, H, W)."""
    for y in prange(image.shape[0]):
        for x in range(image.shape[1]):
            for c in range(3):
                roots[c, y, x] = math.sqrt(max(image[y, x, c], 0.0))


def fill_with_look_alikes(
    image: np.ndarray,
    defocus: np.ndarray,
    lights: np.ndarray,
    depths: np.ndarray,
    distances: np.ndarray,
    hidden: HiddenRings,
    colors: np.ndarray,
) -> np.ndarray:
    """Fill hidden pixels with seen ones of their surface that look alike around.

    Args:
        image: What is seen, scene-linear, (H, W, 3) float32.
        defocus: Of what is seen, signed blur radius in pixels, (H, W) float32.
        lights: Seen pixels that are not carried on, (H, W) bool.
        depths: Defocus of what is hidden, (H, W) float32.
        distances: From the nearest edge of what hides it, pixels, (H, W) float32; 0 where nothing is hidden.
        hidden: The same, sorted.
        colors: Another guess, (H, W, 3) float32.

    Returns:
        Colours, (H, W, 3) float32, set where something is hidden at most ``FARTHEST`` from the edge; to those
        of ``colors`` without look-alikes.
    """
    roots, filled = np.empty((3, *defocus.shape), image.dtype), np.empty_like(image)
    sources = np.empty((*defocus.shape, 2), np.int32)
    _roots(image, roots)
    _fill(
        *(image, roots, defocus, depths, distances, lights),
        *(hidden.ys, hidden.xs, hidden.ends[: FARTHEST + 1], hidden.rings, colors, sources, filled),
    )
    return filled
