"""Exemplar-based inpainting of the texture of an occluded background.

Occluded pixels are filled from the edge inwards. Each is compared, by its known surroundings, with visible
pixels of its own surface: those that continue the sources of its filled neighbours, and random ones around
it. Its color is their mean, weighted by similarity.

Source: Criminisi, Perez and Toyama, "Region filling and object removal by exemplar-based image inpainting",
IEEE Transactions on Image Processing 2004, for filling from patches; Barnes, Shechtman, Finkelstein and
Goldman, "PatchMatch: a randomized correspondence algorithm for structural image editing", SIGGRAPH 2009, for
the search; Buades, Coll and Morel, "A non-local algorithm for image denoising", CVPR 2005, for the mean.
The restriction to pixels of the occluded surface is ours.
"""

import math

import numpy as np
from numba import prange

from bokehnet.classical.layered.background.inpainting_order import OccludedRings
from bokehnet.classical.layered.background.structure_transport import tiles_around
from bokehnet.classical.layered.depth_discontinuities import (
    DISCONTINUITY_THRESHOLD,
    STEP_TILE,
    are_one_surface,
)
from bokehnet.classical.simd.float8 import LANES, abs8, broadcast8, less8, load8, select8, sum8
from bokehnet.kernels import njit

__all__ = ["MAX_TEXTURE_DISTANCE_PX", "inpaint_texture"]

# Radius of the patches, and of the neighbours whose sources are propagated, pixels.
_PATCH_RADIUS_PX, _PROPAGATION_RADIUS_PX = 3, 2

# Rows of a patch, of eight pixels each, the last of which does not count; and the values in all of them.
_PATCH_ROWS, _PATCH_SIZE = 2 * _PATCH_RADIUS_PX + 1, (2 * _PATCH_RADIUS_PX + 1) * LANES

# Number of random candidates, and the search radius: distances from the edge, plus pixels.
_RANDOM_CANDIDATES, _SEARCH_DISTANCES, _SEARCH_MARGIN_PX = 40, 2.0, 12.0

# Search radii of the candidates around the best one, pixels.
_REFINEMENT_RADII_PX = (
    6.0,
    6.0,
    6.0,
    6.0,
    6.0,
    6.0,
    3.0,
    3.0,
    3.0,
    3.0,
    3.0,
    3.0,
    1.6,
    1.6,
    1.6,
    1.6,
    1.6,
    1.6,
)

# Weight of filled pixels over that of visible ones, and the minimum known fraction of a patch.
_FILLED_WEIGHT, _MIN_KNOWN_FRACTION = 0.7, 0.6

# Squared difference, of the square root of light, above the smallest one, at which a pixel has the weight
# 1 / e, and the increase of this value per smallest difference.
_SIMILARITY_SCALE, _SIMILARITY_SLACK = 2e-3, 0.5

# Distance from the edge, in whole pixels, beyond which no texture is inpainted.
MAX_TEXTURE_DISTANCE_PX = 12

# Maximum distance of a source from the nearest occluded pixel, tiles: the radius of the first search, and as
# much again for the refinement of one source into the next.
_MAX_SOURCE_DISTANCE_TILES = math.ceil(
    2 * (_SEARCH_DISTANCES * MAX_TEXTURE_DISTANCE_PX + _SEARCH_MARGIN_PX) / STEP_TILE
)

# Blur radius of the occluded surface, pixels, beyond which its texture is invisible.
_MAX_BLUR_RADIUS_PX = 10.0

_THRESHOLD = np.float32(DISCONTINUITY_THRESHOLD)

# Normalised difference above which a pixel has no weight.
_MAX_DIFFERENCE = 5.0

# Pixels per chunk of a parallel loop.
_CHUNK_PIXELS = 64


def _disc(radius: int) -> np.ndarray:
    """Return rows and columns of the pixels of a square window, the nearest first, without the centre."""
    sides = range(-radius, radius + 1)
    return np.array(sorted([(v, u) for v in sides for u in sides if (v, u) != (0, 0)], key=np.linalg.norm))


_NEIGHBOURS = _disc(_PATCH_RADIUS_PX)
_NEIGHBOUR_DISTANCES = np.sqrt((_NEIGHBOURS**2).sum(1))
_WEIGHTS = np.exp(-0.5 * (_NEIGHBOUR_DISTANCES / (0.6 * _PATCH_RADIUS_PX)) ** 2)
_PROPAGATED = int((_NEIGHBOUR_DISTANCES < _PROPAGATION_RADIUS_PX + 0.9).sum())

# Points evenly spread over a square of half side 1: multiples of the powers of the inverse plastic number
# (Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018).
_PLASTIC = 1.32471795724474602596
_CANDIDATE_OFFSETS = (
    np.arange(1, 1 + _RANDOM_CANDIDATES + len(_REFINEMENT_RADII_PX))[:, None] / (_PLASTIC, _PLASTIC**2)
) % 1


@njit(cache=True)
def _patch_distance(roots, defocus, size, v, u, patch, known):
    """Return the mean squared difference of a patch and the surface at (v, u); inf if too little is known."""
    height, width = size
    own, threshold = broadcast8(defocus[v * width + u]), broadcast8(_THRESHOLD)
    zero = broadcast8(np.float32(0))
    total, weight = zero, zero
    for row in range(_PATCH_ROWS):
        index, patch_index = (v + row - _PATCH_RADIUS_PX) * width + u - _PATCH_RADIUS_PX, row * LANES
        red = load8(roots, index) - load8(patch, _PATCH_SIZE + patch_index)
        green = load8(roots, height * width + index) - load8(patch, 2 * _PATCH_SIZE + patch_index)
        blue = load8(roots, 2 * height * width + index) - load8(patch, 3 * _PATCH_SIZE + patch_index)
        w = select8(less8(threshold, abs8(load8(defocus, index) - own)), zero, load8(patch, patch_index))
        total = total + w * (red * red + green * green + blue * blue)
        weight = weight + w
    total_weight = sum8(weight)
    return sum8(total) / total_weight if total_weight >= _MIN_KNOWN_FRACTION * known else np.inf


@njit(cache=True)
def _is_candidate(defocus, lights, active_tiles, depth, y, x, v, u):
    """Return whether (v, u) shows the surface occluded at (y, x), no light, and has a known patch."""
    height, width = defocus.shape
    if (
        not (
            _PATCH_RADIUS_PX <= v < height - _PATCH_RADIUS_PX
            and _PATCH_RADIUS_PX <= u < width + _PATCH_RADIUS_PX - LANES
        )
        or lights[v, u]
    ):
        return False
    for row in range(2):
        for column in range(2):
            corner_y = v + (2 * row - 1) * _PATCH_RADIUS_PX
            corner_x = u + (LANES - _PATCH_RADIUS_PX - 1 if column else -_PATCH_RADIUS_PX)
            if not active_tiles[corner_y // STEP_TILE, corner_x // STEP_TILE]:
                return False
    return are_one_surface(defocus[v, u], depth, math.sqrt((v - y) ** 2 + (u - x) ** 2))


@njit(cache=True)
def _fill_patch(defocus, depths, rings, lights, roots, filled, y, x, patch):
    """Set weights and square roots of known pixels around an occluded one; return the sum of weights."""
    height, width = defocus.shape
    known = 0.0
    patch[:] = 0.0
    for i in range(len(_NEIGHBOURS)):
        down, right = _NEIGHBOURS[i]
        v, u, at = y + down, x + right, (down + _PATCH_RADIUS_PX) * LANES + right + _PATCH_RADIUS_PX
        if not (0 <= v < height and 0 <= u < width):
            continue
        weight = _WEIGHTS[i]
        if are_one_surface(defocus[v, u], depths[y, x], _NEIGHBOUR_DISTANCES[i]):
            if lights[v, u]:
                continue
            for c in range(3):
                patch[(1 + c) * _PATCH_SIZE + at] = roots[c, v, u]
        elif 0 < rings[v, u] < rings[y, x] and are_one_surface(
            depths[v, u], depths[y, x], _NEIGHBOUR_DISTANCES[i]
        ):
            weight *= _FILLED_WEIGHT
            for c in range(3):
                patch[(1 + c) * _PATCH_SIZE + at] = math.sqrt(max(filled[v, u, c], 0.0))
        else:
            continue
        patch[at] = weight
        known += weight
    return known


@njit(cache=True)
def _contains(places, count, v, u):
    """Return whether a position is among the first ``count`` ones."""
    contained = False
    for i in range(count):
        contained = contained or (places[i, 0] == v and places[i, 1] == u)
    return contained


@njit(cache=True)
def _set_mean(image, places, costs, count, lowest, y, x, filled):
    """Set an occluded pixel to the mean of the candidates, weighted by similarity."""
    total = red = green = blue = 0.0
    scale = 1.0 / (_SIMILARITY_SCALE + _SIMILARITY_SLACK * lowest)
    for k in range(count):
        difference = scale * (costs[k] - lowest)
        if difference > _MAX_DIFFERENCE:
            continue
        w = math.exp(-difference)
        total += w
        red += w * image[places[k, 0], places[k, 1], 0]
        green += w * image[places[k, 0], places[k, 1], 1]
        blue += w * image[places[k, 0], places[k, 1], 2]
    filled[y, x, 0], filled[y, x, 1], filled[y, x, 2] = red / total, green / total, blue / total


@njit(cache=True, parallel=True)
def _fill(
    image,
    roots,
    active_tiles,
    defocus,
    depths,
    distances,
    lights,
    ys,
    xs,
    ends,
    rings,
    colors,
    sources,
    filled,
):
    """Set occluded pixels of ``filled``, ring by ring; ``sources``: the best match of each, -1 if none."""
    height, width = defocus.shape
    max_candidates = _PROPAGATED + _RANDOM_CANDIDATES + len(_REFINEMENT_RADII_PX)
    flat_roots, flat_defocus = roots.reshape(-1), defocus.reshape(-1)
    for ring in range(1, len(ends)):
        first, last = ends[ring - 1], ends[ring]
        for chunk in prange((last - first + _CHUNK_PIXELS - 1) // _CHUNK_PIXELS):
            patch = np.empty(4 * _PATCH_SIZE, np.float32)
            places, costs = np.empty((max_candidates, 2), np.int64), np.empty(max_candidates)
            start = first + chunk * _CHUNK_PIXELS
            for i in range(start, min(start + _CHUNK_PIXELS, last)):
                y, x = ys[i], xs[i]
                sources[y, x, 0] = -1
                for c in range(3):
                    filled[y, x, c] = colors[y, x, c]
                if abs(depths[y, x]) > _MAX_BLUR_RADIUS_PX:
                    continue
                known = _fill_patch(defocus, depths, rings, lights, roots, filled, y, x, patch)
                if known == 0.0:
                    continue
                reach = _SEARCH_DISTANCES * distances[y, x] + _SEARCH_MARGIN_PX
                shift_y, shift_x = 4096.0 * colors[y, x, 0], 4096.0 * colors[y, x, 1]
                count, best, lowest = 0, -1, np.inf
                for k in range(max_candidates):
                    if k < _PROPAGATED:
                        down, right = _NEIGHBOURS[k]
                        v, u = y + down, x + right
                        if not (0 <= v < height and 0 <= u < width):
                            continue
                        if not (0 < rings[v, u] < ring) or sources[v, u, 0] < 0:
                            continue
                        v, u = sources[v, u, 0] - down, sources[v, u, 1] - right
                        if _contains(places, count, v, u):
                            continue
                    else:
                        centre_y, centre_x, radius = y, x, reach
                        if k >= _PROPAGATED + _RANDOM_CANDIDATES:
                            if best < 0:
                                break
                            centre_y, centre_x = places[best]
                            radius = _REFINEMENT_RADII_PX[k - _PROPAGATED - _RANDOM_CANDIDATES]
                        down, right = (
                            _CANDIDATE_OFFSETS[k - _PROPAGATED, 0] + shift_y,
                            _CANDIDATE_OFFSETS[k - _PROPAGATED, 1] + shift_x,
                        )
                        v = centre_y + int(math.floor((2.0 * (down - math.floor(down)) - 1.0) * radius + 0.5))
                        u = centre_x + int(
                            math.floor((2.0 * (right - math.floor(right)) - 1.0) * radius + 0.5)
                        )
                    if not _is_candidate(defocus, lights, active_tiles, depths[y, x], y, x, v, u):
                        continue
                    cost = _patch_distance(flat_roots, flat_defocus, (height, width), v, u, patch, known)
                    if cost == np.inf:
                        continue
                    places[count, 0], places[count, 1], costs[count] = v, u, cost
                    if cost < lowest:
                        best, lowest = count, cost
                    count += 1
                if best >= 0:
                    sources[y, x, 0], sources[y, x, 1] = places[best]
                    _set_mean(image, places, costs, count, lowest, y, x, filled)


@njit(cache=True, parallel=True)
def _roots(image, active_tiles, roots):
    """Fill ``roots`` with the square roots of light in tiles, (3, H, W)."""
    for y in prange(image.shape[0]):
        for x in range(image.shape[1]):
            if active_tiles[y // STEP_TILE, x // STEP_TILE]:
                for c in range(3):
                    roots[c, y, x] = math.sqrt(max(image[y, x, c], 0.0))


def inpaint_texture(
    image: np.ndarray,
    defocus: np.ndarray,
    lights: np.ndarray,
    depths: np.ndarray,
    distances: np.ndarray,
    hidden: OccludedRings,
    colors: np.ndarray,
) -> np.ndarray:
    """Fill occluded pixels with visible ones of their surface that have similar surroundings.

    Args:
        image: Visible picture, scene-linear, (H, W, 3) float32.
        defocus: Defocus of the visible picture, signed blur radius in pixels, (H, W) float32.
        lights: Visible pixels that are not continued, (H, W) bool.
        depths: Defocus of the occluded background, (H, W) float32.
        distances: Distance from the nearest edge of the occluder, pixels, (H, W) float32; 0 where nothing is
            occluded.
        hidden: The occluded pixels, sorted by distance.
        colors: Fallback colors, (H, W, 3) float32.

    Returns:
        Colors, (H, W, 3) float32, set for occluded pixels up to ``MAX_TEXTURE_DISTANCE_PX`` from the edge;
        those of ``colors`` without a match.
    """
    roots, filled = np.empty((3, *defocus.shape), image.dtype), np.empty_like(image)
    sources = np.empty((*defocus.shape, 2), np.int32)
    near = hidden.ends[min(MAX_TEXTURE_DISTANCE_PX, len(hidden.ends) - 1)]
    active_tiles = np.zeros([-(-size // STEP_TILE) for size in defocus.shape], np.bool_)
    tiles_around(hidden.ys[:near], hidden.xs[:near], _MAX_SOURCE_DISTANCE_TILES, active_tiles)
    _roots(image, active_tiles, roots)
    _fill(
        *(image, roots, active_tiles, defocus, depths, distances, lights),
        *(
            hidden.ys,
            hidden.xs,
            hidden.ends[: MAX_TEXTURE_DISTANCE_PX + 1],
            hidden.rings,
            colors,
            sources,
            filled,
        ),
    )
    return filled
