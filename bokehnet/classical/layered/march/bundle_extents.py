"""Upper bounds of the deviation of the rays of an aberrated lens, by field position and defocus.

A ray is over the position ``p - E - s A`` at the defocus s. Bounds of |E| and |A| alone add up to several
times the true value: where the rims of the lens vignette, towards the corners, or where aberration and
defocus have opposite signs, discs are small.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numba import prange

from bokehnet.classical.layered.march.aberrated_rays import LensTable, collapse, keep_within, send_rays
from bokehnet.classical.parallel import parallel_region
from bokehnet.classical.simd.float8 import LANES, broadcast8, load8, store8
from bokehnet.kernels import njit
from bokehnet.optics.aberrations.aberration_map import UNTILTED_AXES

__all__ = [
    "BUNDLE",
    "LEVELS",
    "SharpLimits",
    "bundle_extents",
    "extent_at",
    "reach_by_rings",
    "ring_of",
    "sharp_limits",
    "stray_map",
]

# Rays of a bundle: consecutive points of one sequence.
BUNDLE = 2048

# Extents are sampled at levels of the defocus from minus to plus this many pixels, one pixel apart.
LEVELS = 64


@njit(cache=True, parallel=True)
def _compute_extents(points, lens, chromatic_part, directions, extents):
    """Fill ``extents``, see :func:`bundle_extents`.

    ``chromatic_part``: upper bound of the chromatic aberration, pixels. ``directions``: number of field
    directions.
    """
    rings, columns = extents.shape
    us, vs = points[0].reshape(-1), points[1].reshape(-1)
    for ring in prange(rings):
        collapsed = np.empty(lens.coefficients.shape[1:], np.float32)
        largest = np.zeros(columns)
        lanes = np.empty(4 * LANES, np.float32)
        for next_ring in range(ring, min(ring + 2, rings)):
            for direction in range(directions):
                field, angle = next_ring / max(rings - 1, 1), direction * (2.0 * math.pi / directions)
                h_x, h_y = np.float32(field * math.cos(angle)), np.float32(field * math.sin(angle))
                collapse(lens.coefficients, h_x * h_x + h_y * h_y, collapsed)
                for k in range(0, BUNDLE, LANES):
                    u, v = load8(us, k), load8(vs, k)
                    w = broadcast8(np.float32(1))
                    for rim in range(lens.vignetting_apertures.shape[0]):
                        shift, radius = lens.vignetting_apertures[rim]
                        w = keep_within(u, v, shift * h_x, shift * h_y, radius, w)
                    e_x, e_y, a_x, a_y = send_rays(collapsed, lens.tilt, u, v, h_x, h_y, load8(lens.waves, k))
                    # Vignetted rays have no extent.
                    store8(lanes, 0, w * e_x)
                    store8(lanes, LANES, w * e_y)
                    store8(lanes, 2 * LANES, w * a_x)
                    store8(lanes, 3 * LANES, w * a_y)
                    for i in range(LANES):
                        x, y, run_x, run_y = lanes[i], lanes[8 + i], lanes[16 + i], lanes[24 + i]
                        for level in range(columns - 1):
                            away_x, away_y = x + (level - LEVELS) * run_x, y + (level - LEVELS) * run_y
                            largest[level] = max(largest[level], away_x * away_x + away_y * away_y)
                        largest[columns - 1] = max(largest[columns - 1], run_x * run_x + run_y * run_y)
        for level in range(columns - 1):
            extents[ring, level] = math.sqrt(largest[level]) + chromatic_part + 1.0
        extents[ring, columns - 1] = math.sqrt(largest[columns - 1])


@njit(cache=True, forceinline=True)
def extent_at(line, defocus):
    """Return the maximum distance from a pixel of its rays at a defocus; ``line`` is the ring's, pixels."""
    level = min(max(defocus + LEVELS, 0.0), 2.0 * LEVELS)
    first = min(int(level), 2 * LEVELS - 1)
    between = line[first] + (level - first) * (line[first + 1] - line[first])
    return between + line[-1] * max(abs(defocus) - LEVELS, 0.0)


@njit(cache=True, forceinline=True)
def ring_of(h_x, h_y, extents):
    """Return the index of a field position's ring."""
    last = extents.shape[0] - 1
    return min(int(math.sqrt(h_x * h_x + h_y * h_y) * last), last)


@njit(cache=True)
def _fill_reaches(lines, defocus, reaches):
    """Fill ``reaches`` (lines, n) with :func:`extent_at` of each line and defocus."""
    for row in range(reaches.shape[0]):
        for i in range(reaches.shape[1]):
            reaches[row, i] = extent_at(lines[row], defocus[i])


@njit(cache=True, parallel=True)
def _fill_strays(nearest, farthest, lens, above, extents, strays):
    """Fill ``strays``, see :func:`stray_map`."""
    for y in prange(strays.shape[0]):
        for x in range(strays.shape[1]):
            far_x, far_y = (x - lens.column) * lens.scale, (y + above - lens.row) * lens.scale
            line = extents[ring_of(far_x, far_y, extents)]
            strays[y, x] = max(extent_at(line, nearest[y, x]), extent_at(line, farthest[y, x]))


def stray_map(
    nearest: np.ndarray, farthest: np.ndarray, lens: LensTable, extents: np.ndarray, above: int
) -> np.ndarray:
    """Return the maximum distance from a pixel of its rays at its own defocus, pixels, (H, W) float32.

    Args:
        nearest: Defocus of each pixel's nearer surface, pixels, (H, W).
        farthest: Defocus of its farther surface, pixels, (H, W).
        lens: Lens response.
        extents: From :func:`bundle_extents`.
        above: Rows of the picture above these.
    """
    strays = np.empty(nearest.shape, np.float32)
    with parallel_region:
        _fill_strays(nearest, farthest, lens, above, extents, strays)
    return strays


def bundle_extents(points: np.ndarray, lens: LensTable) -> np.ndarray:
    """Return the maximum distance from a pixel of its rays by defocus, for :func:`extent_at`.

    Rings are distances from the centre of the picture to its corner; the value of a ring covers its own and
    the next distance. The positions on a ray are linear in the defocus, so the largest distance is convex in
    it: between two levels it is at most the linear interpolation, and beyond the outer levels it grows by at
    most |A|.

    Args:
        points: Aperture coordinates, see :func:`bokehnet.classical.layered.march.ray_marching.march`.
        lens: Lens response for the rays of ``points``; the first ``BUNDLE`` are used.

    Returns:
        Pixels by ring and level, and the upper bound of |A| as the last value of each ring, (rings,
        2 * LEVELS + 2) float32.
    """
    chromatic_part = 0.0
    if lens.chromatic_aberration.shape[1]:
        strengths, maps = np.abs(lens.chromatic_aberration).max(axis=1), np.abs(lens.maps).max(axis=(0, 1))
        chromatic_part = float(strengths @ maps)
    upright = np.array_equal(lens.tilt, ((0.0, 0.0), *UNTILTED_AXES))
    extents = np.empty((len(lens.max_aberration), 2 * LEVELS + 2), np.float32)
    with parallel_region:
        _compute_extents(points, lens, chromatic_part, 1 if upright else 8, extents)
    return extents


def reach_by_rings(
    extents: np.ndarray, lens: LensTable, side: int, above: int
) -> tuple[Callable[[np.ndarray], np.ndarray], tuple[float, float, float]]:
    """Return extents for tiles whose centres are in rings, as arguments of ``occupied_bins``.

    See :func:`bokehnet.classical.layered.march.defocus_bins.occupied_bins`.

    Args:
        extents: From :func:`bundle_extents`.
        lens: Lens response.
        side: Side of the tiles, pixels.
        above: Rows of the picture above these tiles.
    """
    widest = _over_rings(extents, lens, side)

    def reach_at(defocus: np.ndarray) -> np.ndarray:
        return _reaches(widest, defocus)

    return reach_at, (lens.column, lens.row - above, lens.scale)


def _over_rings(values: np.ndarray, lens: LensTable, side: int) -> np.ndarray:
    """Return upper bounds over squares of ``side`` pixels whose centres are in a ring, (rings - 1, ...).

    ``values``: upper bounds by distance from the centre of the picture, (rings, ...).
    """
    last = len(values) - 1
    margin = math.ceil(0.5 * math.sqrt(2) * side * lens.scale * last) + 2
    rings = [slice(max(0, ring - margin), ring + margin + 1) for ring in range(last)]
    return np.stack([values[ring].max(axis=0) for ring in rings])


def _reaches(lines: np.ndarray, defocus: np.ndarray) -> np.ndarray:
    """Return :func:`extent_at` of lines (n, ...) and a defocus (m,), (n, m)."""
    reaches = np.empty((len(lines), len(defocus)))
    _fill_reaches(lines, np.ascontiguousarray(defocus, np.float64), reaches)
    return reaches


class SharpLimits(NamedTuple):
    """Surfaces that the blocks of a picture may see blurred by less than a limit.

    Rays take the lens at the field position of the pixel that sends them, not at that of the surface.

    Attributes:
        rings: Ring of each block, (rows, columns).
        radii: Blur radius of a perfect lens, of a surface that a ring may see blurred by just the limit,
            pixels, (rings,).
        reaches: Maximum distance at which a ring sees such a surface, pixels, (rings,).
    """

    rings: np.ndarray
    radii: np.ndarray
    reaches: np.ndarray


def sharp_limits(
    shape: tuple[int, int],
    limit: float,
    *,
    side: int,
    largest: float,
    extents: np.ndarray,
    lens: LensTable,
    above: int,
) -> SharpLimits:
    """Return which surfaces blocks may see blurred by less than a limit, and how far away.

    A disc of radius r before aberrations is at least r (1 - s) - e afterwards, for the bounds s and e of the
    stretch and the transverse aberration: a curved field can cancel that much of the defocus. The limits
    depend on the field position alone, so that strips have those of the whole picture.

    Args:
        shape: Number of blocks, (rows, columns).
        limit: Limit of the radius, pixels.
        side: Side of the blocks, pixels.
        largest: Largest blur radius of a perfect lens in the whole picture, pixels.
        extents: From :func:`bundle_extents`.
        lens: Lens response.
        above: Rows of the picture above these blocks.
    """
    stretch, aberration = (_over_rings(v, lens, side) for v in (lens.max_stretch, lens.max_aberration))
    with np.errstate(divide="ignore"):
        radii = (limit + aberration) / np.maximum(1.0 - stretch, 0.0)
    y, x = (side * (np.arange(count) + 0.5) - 0.5 for count in shape)
    field = lens.scale * np.hypot(y[:, None] + above - lens.row, x - lens.column)
    rings = np.minimum((field * len(stretch)).astype(np.intp), len(stretch) - 1)
    ends = np.minimum(radii, largest)
    lines = _over_rings(extents, lens, side)
    reaches = np.maximum(np.diagonal(_reaches(lines, ends)), np.diagonal(_reaches(lines, -ends)))
    return SharpLimits(rings, radii, reaches)
