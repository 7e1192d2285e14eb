"""Unmixing of pixels at depth discontinuities into their two surfaces.

Such a pixel shows ``I = a F + (1 - a) B``: F is the color of the nearer surface, of which the pixel filter
passes the coverage a, and B that of the farther one. All three are unknown, but not equally: a follows from
the step in the depth map, weighted by the pixel filter, except for the fraction of a pixel by which the true
edge can be displaced; F and B are near the means of the purer pixels of their surfaces close by, and vary as
those do. The most probable solution under these normal distributions is a least-squares problem per pixel,

    minimise (a - a0)^2 / s_a^2 + |F - F0|^2 / s_F^2 + |B - B0|^2 / s_B^2  subject to  I = a F + (1 - a) B,

linearised at the means. With ``D = F0 - B0`` and ``e = I - a0 F0 - (1 - a0) B0``, the multiplier is
``c = C^-1 e`` for ``C = s_a^2 D D^T + (a0^2 s_F^2 + (1 - a0)^2 s_B^2) 1``, which the formula of Sherman and
Morrison inverts. Residuals therefore move the edge where both sides differ much, and change the colors where
these are textured.

Neighbours determine a surface the better the more of it they show, which is unknown before they are unmixed.
All pixels are therefore unmixed again in several iterations, each from the colors of the previous iteration
in the 3x3 pixels around, weighted by the square of their coverage by the surface. This is Jacobi's iteration
for a least-squares problem that couples neighbours.

The variance of unmixed colors contains unmixing errors: light of a bright outline that is assigned to an even
wall makes the wall seem so uneven that it stays there. Where many pure pixels of both surfaces are near, the
variance of either is therefore limited to ten times theirs.

The initial coverages locate an edge to a pixel of the map. The coverages after the iterations locate it
inside the pixel, with noise. Edges are continuous, so all pixels around that show the same two surfaces
together give its displacement ``d`` towards the farther one, by least squares with a prior:

    minimise  sum w (a - a0 - g d)^2 + doubt d^2,   g = 4 a0 (1 - a0),

g is the derivative of a coverage by the position of the edge; w decreases with the distance and increases
with the difference of both colors. From then on coverages start from ``a0 + g d``, with a smaller deviation.

Light is not negative; what clipping removes is assigned to the other side, so that the two surfaces add up to
the picture.

Source: Tarantola, "Inverse problem theory", 2005, for least squares with uncertain priors; Chuang et al., "A
Bayesian approach to digital matting", CVPR 2001, for colors and coverage of two surfaces as one estimate.
Coverages that start from the map and the pixel filter are ours.
"""

from typing import NamedTuple

import numpy as np
from numba import prange

from bokehnet.classical.known_surfaces import KnownSurfaces
from bokehnet.classical.layered.boundaries.unmixing_prior import PRIOR
from bokehnet.classical.layered.depth_discontinuities import DISCONTINUITY_THRESHOLD
from bokehnet.classical.layered.slight_steps import MIN_STEP_PX, SLIGHT, half_step
from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit
from bokehnet.optics.pixels.pixel_filter import DEFAULT_FILTER, PixelFilter

__all__ = [
    "KNOWN_MIXED",
    "LIGHT_WEIGHT",
    "MIN_FILTER_WEIGHT",
    "PRIOR",
    "TIE_TOLERANCE",
    "MixedPixels",
    "mean_color",
    "unmix",
]

# Lower bound of the weights of the pixel filter, so that neighbours always separate the two surfaces.
MIN_FILTER_WEIGHT = 1e-3

# Sums that differ by no more are equal except for rounding; then the surface in front of a pixel counts.
TIE_TOLERANCE = 1e-9

# Weights of the windows, by rows and columns from the centre; those of the 3x3 pixels are flat.
_WINDOW = np.exp(-np.add.outer(*2 * [np.arange(PRIOR.window_px + 1) ** 2]) / PRIOR.window_variance)
_EDGE_WINDOW = np.exp(
    -np.add.outer(*2 * [np.arange(PRIOR.edge_window_px + 1) ** 2]) / PRIOR.edge_window_variance
)
_NEAR_WINDOW = np.exp(-np.add.outer(*2 * [np.arange(-1, 2) ** 2]).ravel() / PRIOR.neighbour_variance)

# Surface of a pixel that a neighbour shows: neither, it alone, or it as its nearer or farther one.
_UNRELATED, _PURE, _NEAR_SIDE, _FAR_SIDE = range(4)

# Weight of lights in the initial colors of a surface: a bright frame before darkness has no other pixels.
LIGHT_WEIGHT = 1e-6

# Bit of sides in addition to those of discontinuities: pixels known to be mixed; and their weight.
KNOWN_MIXED, _KNOWN_MIXED_WEIGHT = 4, 1e-3


class MixedPixels(NamedTuple):
    """Both surfaces of every pixel at a depth discontinuity.

    Attributes:
        rows: Rows of the pixels, (N,).
        columns: Columns of the pixels, (N,).
        front: Colors of the nearer surface, (N, 3).
        back: Colors of the farther surface, (N, 3).
        near: Defocus of the nearer surface, pixels, (N,).
        far: Defocus of the farther surface, pixels, (N,).
        coverage: Coverage by the nearer surface, (N,) in [0, 1].
        is_front: True if the pixel's own depth is that of the nearer surface, (N,).
    """

    rows: np.ndarray
    columns: np.ndarray
    front: np.ndarray
    back: np.ndarray
    near: np.ndarray
    far: np.ndarray
    coverage: np.ndarray
    is_front: np.ndarray

    @property
    def is_slight(self) -> np.ndarray:
        """True where the step is one of :mod:`bokehnet.classical.layered.slight_steps`, (N,) bool."""
        slight: np.ndarray = self.near - self.far <= DISCONTINUITY_THRESHOLD
        return slight


@njit(cache=True)
def _surfaces(defocus, weights, y, x, min_step):
    """Return near and far defocus of a pixel, the coverage by the nearer, and whether that is its own.

    Surfaces differ by more than ``min_step``.
    """
    height, width = defocus.shape
    reach = len(weights) // 2
    own = near = far = defocus[y, x]
    near_weight = far_weight = 0.0
    own_weight = 0.0
    for i in range(-reach, reach + 1):
        for j in range(-reach, reach + 1):
            v, u = min(max(y + i, 0), height - 1), min(max(x + j, 0), width - 1)
            weight = weights[i + reach] * weights[j + reach]
            if defocus[v, u] > own + min_step:
                near_weight += weight
                near = max(near, defocus[v, u])
            elif defocus[v, u] < own - min_step:
                far_weight += weight
                far = min(far, defocus[v, u])
            else:
                own_weight += weight
    if near_weight >= far_weight - TIE_TOLERANCE:
        return near, own, near_weight / (near_weight + own_weight), False
    return own, far, own_weight / (far_weight + own_weight), True


@njit(cache=True)
def mean_color(image, defocus, excluded, sides, y, x, depth, tolerance, color, excluded_weight=0.0):
    """Write the mean color of the surface at ``depth`` around (y, x); return its variance, -1 if none.

    Pixels within ``tolerance`` of that depth belong to it. Excluded pixels have the weight
    ``excluded_weight``.
    """
    height, width = defocus.shape
    total = square = 0.0
    color[:] = 0.0
    for v in range(max(0, y - PRIOR.window_px), min(height, y + PRIOR.window_px + 1)):
        for u in range(max(0, x - PRIOR.window_px), min(width, x + PRIOR.window_px + 1)):
            if abs(defocus[v, u] - depth) > tolerance or (excluded[v, u] and excluded_weight == 0.0):
                continue
            weight = _WINDOW[abs(v - y), abs(u - x)] * (excluded_weight if excluded[v, u] else 1.0)
            if sides[v, u] != 0:
                weight *= _KNOWN_MIXED_WEIGHT if sides[v, u] & KNOWN_MIXED else PRIOR.mixed_weight
            total += weight
            for c in range(3):
                color[c] += weight * image[v, u, c]
                square += weight * image[v, u, c] * image[v, u, c]
    if total == 0.0:
        return -1.0
    color /= total
    return max(square / total - (color * color).sum(), 0.0) / 3.0


@njit(cache=True)
def _max_variance(image, defocus, sides, y, x, depth, tolerance):
    """Return the maximum variance of unmixed pixels of the surface at ``depth``; inf if too few are pure."""
    height, width = defocus.shape
    count, square = 0, 0.0
    red = green = blue = 0.0
    for v in range(max(0, y - PRIOR.window_px), min(height, y + PRIOR.window_px + 1)):
        for u in range(max(0, x - PRIOR.window_px), min(width, x + PRIOR.window_px + 1)):
            if sides[v, u] != 0 or abs(defocus[v, u] - depth) > tolerance:
                continue
            r, g, b = np.float64(image[v, u, 0]), np.float64(image[v, u, 1]), np.float64(image[v, u, 2])
            count += 1
            red, green, blue = red + r, green + g, blue + b
            square += r * r + g * g + b * b
    if count < PRIOR.min_pure_pixels:
        return np.inf
    variance = max(square / count - (red * red + green * green + blue * blue) / count**2, 0.0) / 3.0
    return PRIOR.max_variance_ratio * variance


@njit(cache=True, parallel=True)
def _relate_neighbours(index, defocus, excluded, places, surfaces, relations):
    """Fill ``relations``, (N, 2, 9): how the 3x3 pixels around show the nearer and the farther surface."""
    height, width = defocus.shape
    for i in prange(len(places)):
        tolerance = half_step(surfaces[i, 0], surfaces[i, 1])
        for k in range(9):
            v, u = places[i, 0] + k // 3 - 1, places[i, 1] + k % 3 - 1
            for side in range(2):
                relations[i, side, k] = _UNRELATED
                if not (0 <= v < height and 0 <= u < width) or excluded[v, u]:
                    continue
                j = index[v, u]
                if j < 0:
                    if abs(defocus[v, u] - surfaces[i, side]) <= tolerance:
                        relations[i, side, k] = _PURE
                    continue
                to_near = abs(surfaces[j, 0] - surfaces[i, side])
                to_far = abs(surfaces[j, 1] - surfaces[i, side])
                if min(to_near, to_far) <= tolerance:
                    relations[i, side, k] = _NEAR_SIDE if to_near <= to_far else _FAR_SIDE


@njit(cache=True)
def _unmixed_mean(image, index, relations, colors, surfaces, y, x, color):
    """Write the mean color of unmixed 3x3 pixels, as :func:`mean_color`; ``relations``, (9,), of one side."""
    total = square = red = green = blue = 0.0
    for k in range(9):
        if relations[k] == _UNRELATED:
            continue
        v, u = y + k // 3 - 1, x + k % 3 - 1
        weight = _NEAR_WINDOW[k]
        if relations[k] == _PURE:
            r, g, b = np.float64(image[v, u, 0]), np.float64(image[v, u, 1]), np.float64(image[v, u, 2])
        else:
            i, side = index[v, u], relations[k] - _NEAR_SIDE
            coverage = 1.0 - surfaces[i, 2] if side else surfaces[i, 2]
            weight *= coverage * coverage + PRIOR.min_weight
            r, g, b = colors[i, side, 0], colors[i, side, 1], colors[i, side, 2]
        total += weight
        red, green, blue = red + weight * r, green + weight * g, blue + weight * b
        square += weight * (r * r + g * g + b * b)
    if total == 0.0:
        return -1.0
    color[0], color[1], color[2] = red / total, green / total, blue / total
    return max(square / total - (color[0] ** 2 + color[1] ** 2 + color[2] ** 2), 0.0) / 3.0


@njit(cache=True)
def _unmix_pixel(pixel, front, back, coverage, coverage_spread, front_variance, back_variance):
    """Move the means ``front`` and ``back`` to the most probable colors; return the coverage."""
    front_gain, back_gain = coverage * front_variance, (1.0 - coverage) * back_variance
    spread = coverage * front_gain + (1.0 - coverage) * back_gain
    shift = coverage_spread * coverage_spread
    along = across = 0.0
    for c in range(3):
        across += (front[c] - back[c]) ** 2
        along += (front[c] - back[c]) * (pixel[c] - coverage * front[c] - (1.0 - coverage) * back[c])
    along /= spread + shift * across
    for c in range(3):
        difference = front[c] - back[c]
        error = pixel[c] - coverage * front[c] - (1.0 - coverage) * back[c]
        multiplier = (error - shift * along * difference) / spread
        front[c] += front_gain * multiplier
        back[c] += back_gain * multiplier
    coverage = min(max(coverage + shift * along, 0.0), 1.0)
    front_gain, back_gain = coverage * front_variance, (1.0 - coverage) * back_variance
    spread = coverage * front_gain + (1.0 - coverage) * back_gain
    for c in range(3):  # exact sum, and no negative light unless the picture has some
        error = pixel[c] - coverage * front[c] - (1.0 - coverage) * back[c]
        front[c] += front_gain / spread * error
        back[c] += back_gain / spread * error
        least = min(pixel[c], 0.0)
        if front[c] < least and coverage < 1.0:
            front[c], back[c] = least, (pixel[c] - coverage * least) / (1.0 - coverage)
        elif back[c] < least and coverage > 0.0:
            front[c], back[c] = (pixel[c] - (1.0 - coverage) * least) / coverage, least
    return coverage


@njit(cache=True)
def _unmix_with_means(pixel, colors, coverage, coverage_spread, variances, limits):
    """Unmix as :func:`_unmix_pixel`, from means (2, 3) and variances up to ``limits``; below 0: no mean."""
    front_variance, back_variance = min(variances[0], limits[0]), min(variances[1], limits[1])
    least = PRIOR.min_sigma * PRIOR.min_sigma
    if front_variance < 0.0 or back_variance < 0.0:  # nothing separates the two
        colors[0], colors[1] = pixel, pixel
        front_variance = back_variance = 1.0
    for c in range(3):
        least += (
            PRIOR.min_relative_sigma
            * PRIOR.min_relative_sigma
            * (colors[0, c] ** 2 + colors[1, c] ** 2)
            / 3.0
        )
    return _unmix_pixel(
        pixel, colors[0], colors[1], coverage, coverage_spread, front_variance + least, back_variance + least
    )


@njit(cache=True, parallel=True)
def _unmix(image, defocus, weights, excluded, sides, places, known, coverages, limits, colors, surfaces):
    """Fill initial coverages, deviations (N, 2), colors (N, 2, 3), and (N, 4): near, far, coverage, side.

    The side is 1 if the pixel's own surface is the nearer one; ``limits``, (N, 2), is set to the maximum
    variance of either surface.

    ``known``, (N, 3), contains near, far and coverage where they are known; coverage is -1 elsewhere.
    """
    for i in prange(len(places)):
        y, x = places[i, 0], places[i, 1]
        min_step = MIN_STEP_PX if sides[y, x] & SLIGHT else DISCONTINUITY_THRESHOLD
        near, far, coverage, is_front = _surfaces(defocus, weights, y, x, min_step)
        deviation = PRIOR.coverage_sigma
        if known[i, 2] >= 0.0:
            near, far, coverage, deviation = known[i, 0], known[i, 1], known[i, 2], 0.0
            is_front = coverage >= 0.5
        tolerance = half_step(near, far)
        front_variance = mean_color(
            image, defocus, excluded, sides, y, x, near, tolerance, colors[i, 0], LIGHT_WEIGHT
        )
        back_variance = mean_color(
            image, defocus, excluded, sides, y, x, far, tolerance, colors[i, 1], LIGHT_WEIGHT
        )
        limits[i, 0] = _max_variance(image, defocus, sides, y, x, near, tolerance)
        limits[i, 1] = _max_variance(image, defocus, sides, y, x, far, tolerance)
        if max(limits[i, 0], limits[i, 1]) == np.inf:
            limits[i] = np.inf
        coverages[i, 0], coverages[i, 1] = coverage, deviation
        surfaces[i, 0], surfaces[i, 1], surfaces[i, 3] = near, far, is_front
        variances = front_variance, back_variance
        surfaces[i, 2] = _unmix_with_means(image[y, x], colors[i], coverage, deviation, variances, limits[i])


@njit(cache=True, parallel=True)
def _iterate(image, index, relations, places, coverages, limits, colors, surfaces, new_colors, new_surfaces):
    """Fill the new colors and surfaces from the neighbours; ``coverages`` and their deviations, (N, 2)."""
    for i in prange(len(places)):
        y, x = places[i, 0], places[i, 1]
        front_variance = _unmixed_mean(
            image, index, relations[i, 0], colors, surfaces, y, x, new_colors[i, 0]
        )
        back_variance = _unmixed_mean(image, index, relations[i, 1], colors, surfaces, y, x, new_colors[i, 1])
        new_surfaces[i] = surfaces[i]
        variances = front_variance, back_variance
        new_surfaces[i, 2] = _unmix_with_means(
            image[y, x], new_colors[i], coverages[i, 0], coverages[i, 1], variances, limits[i]
        )


@njit(cache=True)
def _edge_slope(coverage):
    """Return the derivative of a coverage by the position of its edge."""
    return max(4.0 * coverage * (1.0 - coverage), PRIOR.min_edge_slope)


@njit(cache=True, parallel=True)
def _locate_edges(index, places, initial, colors, surfaces, coverages):
    """Fill coverages and their deviations (N, 2) from the edge position common to all pixels around."""
    height, width = index.shape
    for i in prange(len(places)):
        y, x = places[i, 0], places[i, 1]
        coverages[i, 0], coverages[i, 1] = initial[i, 0], initial[i, 1]
        if initial[i, 1] == 0.0:
            continue
        shift, total, tolerance = 0.0, PRIOR.edge_prior_weight, half_step(surfaces[i, 0], surfaces[i, 1])
        for v in range(max(0, y - PRIOR.edge_window_px), min(height, y + PRIOR.edge_window_px + 1)):
            for u in range(max(0, x - PRIOR.edge_window_px), min(width, x + PRIOR.edge_window_px + 1)):
                j = index[v, u]
                if j < 0:
                    continue
                is_same_edge = True
                for side in range(2):
                    if abs(surfaces[j, side] - surfaces[i, side]) > tolerance:
                        is_same_edge = False
                if not is_same_edge:
                    continue
                difference = 0.0
                for c in range(3):
                    difference += (colors[j, 0, c] - colors[j, 1, c]) ** 2
                weight = _EDGE_WINDOW[abs(v - y), abs(u - x)]
                weight *= difference / (difference + PRIOR.edge_contrast)
                slope = _edge_slope(initial[j, 0])
                shift += weight * slope * (surfaces[j, 2] - initial[j, 0])
                total += weight * slope * slope
        coverages[i, 0] = min(max(initial[i, 0] + _edge_slope(initial[i, 0]) * shift / total, 0.0), 1.0)
        coverages[i, 1] = PRIOR.located_sigma


def unmix(
    image: np.ndarray,
    defocus: np.ndarray,
    sides: np.ndarray,
    excluded: np.ndarray,
    pixel_filter: PixelFilter = DEFAULT_FILTER,
    known: KnownSurfaces | None = None,
) -> MixedPixels:
    """Unmix the pixels at depth discontinuities into their two surfaces.

    Args:
        image: All-in-focus picture, scene-linear, (H, W, 3), float32.
        defocus: Signed blur radius in pixels, (H, W), + in front of focus, float32, with sharp steps.
        sides: From :func:`bokehnet.classical.layered.slight_steps.sides_with_slight_steps`, and
            ``KNOWN_MIXED`` where pixels are known to be mixed.
        excluded: Pixels that stay unchanged and do not influence their neighbours: lights, (H, W) bool.
        pixel_filter: Pixel filter of the picture.
        known: Pixels whose surfaces and coverage are known: only their colors are estimated.

    Returns:
        Both surfaces of all pixels of ``sides`` and ``known`` that are not excluded. They add up to the
        picture except for rounding, wherever that is not below 0.
    """
    selected = sides != 0
    if known is not None:
        selected[known.rows, known.columns] = True
    places = np.argwhere(selected & ~excluded)
    known_surfaces = np.full((len(places), 3), -1.0)
    if known is not None:
        known = known.select(~excluded[known.rows, known.columns])
        width = sides.shape[1]
        order = np.searchsorted(places @ (width, 1), known.rows.astype(np.int64) * width + known.columns)
        known_surfaces[order] = np.stack([known.near, known.far, known.coverage], axis=-1)
    weights = np.maximum(pixel_filter.weights(), MIN_FILTER_WEIGHT)
    index = np.full(defocus.shape, -1, np.int32)
    index[places[:, 0], places[:, 1]] = np.arange(len(places))
    colors, new_colors = (np.empty((len(places), 2, 3)) for _ in range(2))
    surfaces, new_surfaces = (np.empty((len(places), 4)) for _ in range(2))
    coverages, located, limits = (np.empty((len(places), 2)) for _ in range(3))
    relations = np.empty((len(places), 2, 9), np.uint8)
    with parallel_region:
        _unmix(
            image,
            defocus,
            weights,
            excluded,
            sides,
            places,
            known_surfaces,
            coverages,
            limits,
            colors,
            surfaces,
        )
        _relate_neighbours(index, defocus, excluded, places, surfaces, relations)
        neighbourhood = (image, index, relations, places)
        for iteration in range(PRIOR.iterations + PRIOR.located_iterations):
            if iteration == PRIOR.iterations:
                _locate_edges(index, places, coverages, colors, surfaces, located)
                coverages = located
            _iterate(*neighbourhood, coverages, limits, colors, surfaces, new_colors, new_surfaces)
            colors, surfaces, new_colors, new_surfaces = new_colors, new_surfaces, colors, surfaces
    colors, surfaces = colors.astype(np.float32), surfaces.astype(np.float32)
    return MixedPixels(
        rows=places[:, 0],
        columns=places[:, 1],
        front=colors[:, 0],
        back=colors[:, 1],
        near=surfaces[:, 0],
        far=surfaces[:, 1],
        coverage=surfaces[:, 2],
        is_front=surfaces[:, 3] > 0,
    )
