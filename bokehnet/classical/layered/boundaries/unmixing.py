"""Pixels at depth discontinuities parted into the two surfaces that they mix.

A pixel there shows ``I = a F + (1 - a) B``: the nearer surface's colour F, of which the pixel filter passes
the share a, and the farther one's B. All three are unknown, but not equally: a follows from where the map of
depth has its step, weighted by the pixel filter, up to the part of a pixel by which the true edge may lie
elsewhere; F and B are near the means of their surfaces' purer pixels close by, and vary as those do. The most
probable answer under these normal distributions is a least-squares problem per pixel,

    minimise (a - a0)^2 / s_a^2 + |F - F0|^2 / s_F^2 + |B - B0|^2 / s_B^2  subject to  I = a F + (1 - a) B,

linearised at the means. With ``D = F0 - B0`` and ``e = I - a0 F0 - (1 - a0) B0``, the multiplier is
``c = C^-1 e`` for ``C = s_a^2 D D^T + (a0^2 s_F^2 + (1 - a0)^2 s_B^2) 1``, which the formula of Sherman and
Morrison inverts. So what does not fit is given to the place of the edge where both sides differ much, and to
the colours where they are textured.

Neighbours know more of a surface the more of it they show, which is not known before they are parted. So all
pixels are parted again, some rounds long, each from the colours that the round before found in the 3x3
pixels around, weighted by the square of the share that those pixels show of the surface: what Jacobi's
iteration does for least squares that tie neighbours together.

Their variance takes what is parted wrongly for texture: light of a bright outline that is given to an even
wall makes the wall seem so uneven that it stays there. So where many pure pixels of both surfaces are near,
neither varies by more than ten times what these do.

The first shares know an edge to a pixel of the map. What the rounds made of them tells where inside the
pixel it runs, noisily; edges go on, so all pixels around that show the same two surfaces say together how far
it lies towards the farther one, ``d``, by least squares with a prior that holds it:

    minimise  sum w (a - a0 - g d)^2 + doubt d^2,   g = 4 a0 (1 - a0),

g being how fast a share changes with the place of the edge, and w falling off with the distance and growing
with how much both colours differ. Shares start from ``a0 + g d`` from then on, and are surer.

Light is not negative; what that cuts off is given to the other side, so
that the two surfaces add up to the picture.

Source: Tarantola, "Inverse problem theory", 2005, for least squares with uncertain priors; Chuang et al., "A
Bayesian approach to digital matting", CVPR 2001, for colours and share of two surfaces as one estimate.
Shares that start from the map and the pixel filter are ours.
"""

from typing import NamedTuple

import numpy as np
from numba import prange

from bokehnet.classical.known_surfaces import KnownSurfaces
from bokehnet.classical.layered.depth_discontinuities import DISCONTINUITY_THRESHOLD
from bokehnet.classical.layered.slight_steps import LEAST_STEP, SLIGHT, half_step
from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit
from bokehnet.optics.pixels.pixel_filter import DEFAULT_FILTER, PixelFilter

__all__ = ["HELD", "LEAST_WEIGHT", "OF_LIGHTS", "PRIOR", "TIE", "MixedPixels", "mean_color", "unmix"]

# What the pixel filter sees of each of its pixels at the least: neighbours tell the two surfaces apart.
LEAST_WEIGHT = 1e-3

# Sums that differ by no more are the same but for rounding: then what is before a pixel counts.
TIE = 1e-9


class _Prior(NamedTuple):
    """What is assumed before the picture is looked at.

    Attributes:
        share_spread: Standard deviation of the share of the nearer side.
        window: Half the width of the window for the first colours, pixels.
        square: Squared deviation of its weights.
        mixed: Weight of mixed pixels there.
        rounds: How often all is parted again.
        near_square: Squared deviation of the weights of the 3x3 pixels then.
        unseen: Weight, beside the square of its share, of a surface that a pixel shows little of.
        relative: Colours vary by at least this part of themselves,
        least: and by this much.
        edge_window: Half the width of the window in which edges are placed together, pixels.
        edge_square: Squared deviation of its weights.
        edge_contrast: Squared difference of colours at which a pixel's word counts half.
        edge_doubt: Weight of an edge that stays where the map has it.
        edge_slope: Least slope of a share.
        placed_spread: As ``share_spread``, once edges are placed.
        placed_rounds: As ``rounds``, from then on.
        pure: Pure pixels in ``window`` of a surface whose variance is known,
        pure_ratio: which parted pixels exceed so many times at the most.
    """

    share_spread: float
    window: int
    square: float
    mixed: float
    rounds: int
    near_square: float
    unseen: float
    relative: float
    least: float
    edge_window: int
    edge_square: float
    edge_contrast: float
    edge_doubt: float
    edge_slope: float
    placed_spread: float
    placed_rounds: int
    pure: int
    pure_ratio: float


PRIOR = _Prior(
    share_spread=0.1,
    window=3,
    square=4.0,
    mixed=0.35,
    rounds=8,
    near_square=2.0,
    unseen=0.1,
    relative=0.02,
    least=1e-4,
    edge_window=2,
    edge_square=4.0,
    edge_contrast=1e-3,
    edge_doubt=0.18,
    edge_slope=0.02,
    placed_spread=0.07,
    placed_rounds=4,
    pure=12,
    pure_ratio=10.0,
)

# The same weights, by rows and columns from the middle; of the 3x3 pixels one after the other.
_WINDOW = np.exp(-np.add.outer(*2 * [np.arange(PRIOR.window + 1) ** 2]) / PRIOR.square)
_EDGE_WINDOW = np.exp(-np.add.outer(*2 * [np.arange(PRIOR.edge_window + 1) ** 2]) / PRIOR.edge_square)
_NEAR_WINDOW = np.exp(-np.add.outer(*2 * [np.arange(-1, 2) ** 2]).ravel() / PRIOR.near_square)

# What a pixel shows of a surface of its neighbour: nothing, it alone, or it as its nearer or farther one.
_NOTHING, _WHOLLY, _NEAR_SIDE, _FAR_SIDE = range(4)

# Weight of lights among the first colours of a surface: of a bright frame before the dark they are all.
OF_LIGHTS = 1e-6

# Bit of sides beside those of discontinuities: pixels that are known to be mixed, and their weight.
HELD, _KNOWN_MIXED = 4, 1e-3


class MixedPixels(NamedTuple):
    """Both surfaces of every pixel at a depth discontinuity.

    Attributes:
        rows: (N,).
        columns: (N,).
        front: Colours of the nearer surface, (N, 3).
        back: Of the farther one, (N, 3).
        near: Defocus of the nearer surface, (N,).
        far: Of the farther one, (N,).
        coverage: Share of the nearer surface, (N,) in [0, 1].
        is_front: Whether the pixel's own depth is the nearer one, (N,).
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
        """Whether the step is one of :mod:`bokehnet.classical.layered.slight_steps`, (N,) bool."""
        found: np.ndarray = self.near - self.far <= DISCONTINUITY_THRESHOLD
        return found


@njit(cache=True)
def _surfaces(defocus, weights, y, x, least):  # type: ignore[no-untyped-def]
    """Near and far defocus of a pixel, the share of the nearer, and whether that is its own.

    Surfaces differ by more than ``least``.
    """
    height, width = defocus.shape
    reach = len(weights) // 2
    own = near = far = defocus[y, x]
    before = behind = 0.0
    same = 0.0
    for i in range(-reach, reach + 1):
        for j in range(-reach, reach + 1):
            v, u = min(max(y + i, 0), height - 1), min(max(x + j, 0), width - 1)
            weight = weights[i + reach] * weights[j + reach]
            if defocus[v, u] > own + least:
                before += weight
                near = max(near, defocus[v, u])
            elif defocus[v, u] < own - least:
                behind += weight
                far = min(far, defocus[v, u])
            else:
                same += weight
    if before >= behind - TIE:
        return near, own, before / (before + same), False
    return own, far, same / (behind + same), True


@njit(cache=True)
def mean_color(image, defocus, spared, sides, y, x, depth, apart, color, of_spared=0.0):  # type: ignore[no-untyped-def]
    """Write the colour of the surface at ``depth`` around (y, x); return its variance, below 0 if none.

    What is within ``apart`` of that depth belongs to it. Spared pixels have the weight ``of_spared``.
    """
    height, width = defocus.shape
    total = square = 0.0
    color[:] = 0.0
    for v in range(max(0, y - PRIOR.window), min(height, y + PRIOR.window + 1)):
        for u in range(max(0, x - PRIOR.window), min(width, x + PRIOR.window + 1)):
            if abs(defocus[v, u] - depth) > apart or (spared[v, u] and of_spared == 0.0):
                continue
            weight = _WINDOW[abs(v - y), abs(u - x)] * (of_spared if spared[v, u] else 1.0)
            if sides[v, u] != 0:
                weight *= _KNOWN_MIXED if sides[v, u] & HELD else PRIOR.mixed
            total += weight
            for c in range(3):
                color[c] += weight * image[v, u, c]
                square += weight * image[v, u, c] * image[v, u, c]
    if total == 0.0:
        return -1.0
    color /= total
    return max(square / total - (color * color).sum(), 0.0) / 3.0


@njit(cache=True)
def _most_variance(image, defocus, sides, y, x, depth, apart):  # type: ignore[no-untyped-def]
    """Most that parted pixels of the surface at ``depth`` may vary around (y, x); inf if too few are pure."""
    height, width = defocus.shape
    count, square = 0, 0.0
    red = green = blue = 0.0
    for v in range(max(0, y - PRIOR.window), min(height, y + PRIOR.window + 1)):
        for u in range(max(0, x - PRIOR.window), min(width, x + PRIOR.window + 1)):
            if sides[v, u] != 0 or abs(defocus[v, u] - depth) > apart:
                continue
            r, g, b = np.float64(image[v, u, 0]), np.float64(image[v, u, 1]), np.float64(image[v, u, 2])
            count += 1
            red, green, blue = red + r, green + g, blue + b
            square += r * r + g * g + b * b
    if count < PRIOR.pure:
        return np.inf
    variance = max(square / count - (red * red + green * green + blue * blue) / count**2, 0.0) / 3.0
    return PRIOR.pure_ratio * variance


@njit(cache=True, parallel=True)
def _find_kin(index, defocus, spared, places, surfaces, kin):  # type: ignore[no-untyped-def]
    """Fill ``kin``, (N, 2, 9): what the 3x3 pixels around show of the nearer and the farther surface."""
    height, width = defocus.shape
    for i in prange(len(places)):
        apart = half_step(surfaces[i, 0], surfaces[i, 1])
        for k in range(9):
            v, u = places[i, 0] + k // 3 - 1, places[i, 1] + k % 3 - 1
            for side in range(2):
                kin[i, side, k] = _NOTHING
                if not (0 <= v < height and 0 <= u < width) or spared[v, u]:
                    continue
                j = index[v, u]
                if j < 0:
                    if abs(defocus[v, u] - surfaces[i, side]) <= apart:
                        kin[i, side, k] = _WHOLLY
                    continue
                to_near = abs(surfaces[j, 0] - surfaces[i, side])
                to_far = abs(surfaces[j, 1] - surfaces[i, side])
                if min(to_near, to_far) <= apart:
                    kin[i, side, k] = _NEAR_SIDE if to_near <= to_far else _FAR_SIDE


@njit(cache=True)
def _parted_mean(image, index, kin, colors, surfaces, y, x, color):  # type: ignore[no-untyped-def]
    """As :func:`mean_color`, of the 3x3 pixels around as far as they are parted; ``kin``, (9,), of a side."""
    total = square = red = green = blue = 0.0
    for k in range(9):
        if kin[k] == _NOTHING:
            continue
        v, u = y + k // 3 - 1, x + k % 3 - 1
        weight = _NEAR_WINDOW[k]
        if kin[k] == _WHOLLY:
            r, g, b = np.float64(image[v, u, 0]), np.float64(image[v, u, 1]), np.float64(image[v, u, 2])
        else:
            i, side = index[v, u], kin[k] - _NEAR_SIDE
            share = 1.0 - surfaces[i, 2] if side else surfaces[i, 2]
            weight *= share * share + PRIOR.unseen
            r, g, b = colors[i, side, 0], colors[i, side, 1], colors[i, side, 2]
        total += weight
        red, green, blue = red + weight * r, green + weight * g, blue + weight * b
        square += weight * (r * r + g * g + b * b)
    if total == 0.0:
        return -1.0
    color[0], color[1], color[2] = red / total, green / total, blue / total
    return max(square / total - (color[0] ** 2 + color[1] ** 2 + color[2] ** 2), 0.0) / 3.0


@njit(cache=True)
def _part(pixel, front, back, share, share_spread, front_variance, back_variance):  # type: ignore[no-untyped-def]
    """Move the means ``front`` and ``back`` to the most probable colours; return the share."""
    own, other = share * front_variance, (1.0 - share) * back_variance
    spread = share * own + (1.0 - share) * other
    shift = share_spread * share_spread
    along = across = 0.0
    for c in range(3):
        across += (front[c] - back[c]) ** 2
        along += (front[c] - back[c]) * (pixel[c] - share * front[c] - (1.0 - share) * back[c])
    along /= spread + shift * across
    for c in range(3):
        difference = front[c] - back[c]
        error = pixel[c] - share * front[c] - (1.0 - share) * back[c]
        multiplier = (error - shift * along * difference) / spread
        front[c] += own * multiplier
        back[c] += other * multiplier
    share = min(max(share + shift * along, 0.0), 1.0)
    own, other = share * front_variance, (1.0 - share) * back_variance
    spread = share * own + (1.0 - share) * other
    for c in range(3):  # exactly, and without negative light where the picture has none
        error = pixel[c] - share * front[c] - (1.0 - share) * back[c]
        front[c] += own / spread * error
        back[c] += other / spread * error
        least = min(pixel[c], 0.0)
        if front[c] < least and share < 1.0:
            front[c], back[c] = least, (pixel[c] - share * least) / (1.0 - share)
        elif back[c] < least and share > 0.0:
            front[c], back[c] = (pixel[c] - (1.0 - share) * least) / share, least
    return share


@njit(cache=True)
def _part_means(pixel, colors, share, share_spread, variances, most):  # type: ignore[no-untyped-def]
    """As :func:`_part`, of means (2, 3) and two variances, at most ``most``; below 0: nothing to average."""
    front_variance, back_variance = min(variances[0], most[0]), min(variances[1], most[1])
    least = PRIOR.least * PRIOR.least
    if front_variance < 0.0 or back_variance < 0.0:  # nothing tells the two apart
        colors[0], colors[1] = pixel, pixel
        front_variance = back_variance = 1.0
    for c in range(3):
        least += PRIOR.relative * PRIOR.relative * (colors[0, c] ** 2 + colors[1, c] ** 2) / 3.0
    return _part(
        pixel, colors[0], colors[1], share, share_spread, front_variance + least, back_variance + least
    )


@njit(cache=True, parallel=True)
def _unmix(image, defocus, weights, spared, sides, places, held, shares, most, colors, surfaces):  # type: ignore[no-untyped-def]
    """Fill first shares and their spreads (N, 2), colours (N, 2, 3), and (N, 4): near, far, share, side.

    The side is whether the pixel's own surface is the nearer one; ``most``, (N, 2), is set to the variance
    that either surface has at the most.

    ``held``, (N, 3), are near, far and coverage where they are known; coverage is -1 where they are not.
    """
    for i in prange(len(places)):
        y, x = places[i, 0], places[i, 1]
        least = LEAST_STEP if sides[y, x] & SLIGHT else DISCONTINUITY_THRESHOLD
        near, far, share, is_front = _surfaces(defocus, weights, y, x, least)
        spread = PRIOR.share_spread
        if held[i, 2] >= 0.0:
            near, far, share, spread = held[i, 0], held[i, 1], held[i, 2], 0.0
            is_front = share >= 0.5
        apart = half_step(near, far)
        front_variance = mean_color(image, defocus, spared, sides, y, x, near, apart, colors[i, 0], OF_LIGHTS)
        back_variance = mean_color(image, defocus, spared, sides, y, x, far, apart, colors[i, 1], OF_LIGHTS)
        most[i, 0] = _most_variance(image, defocus, sides, y, x, near, apart)
        most[i, 1] = _most_variance(image, defocus, sides, y, x, far, apart)
        if max(most[i, 0], most[i, 1]) == np.inf:
            most[i] = np.inf
        shares[i, 0], shares[i, 1] = share, spread
        surfaces[i, 0], surfaces[i, 1], surfaces[i, 3] = near, far, is_front
        variances = front_variance, back_variance
        surfaces[i, 2] = _part_means(image[y, x], colors[i], share, spread, variances, most[i])


@njit(cache=True, parallel=True)
def _unmix_again(image, index, kin, places, shares, most, colors, surfaces, new_colors, new_surfaces):  # type: ignore[no-untyped-def]
    """Fill the new colours and surfaces from those around; ``shares`` and their spreads, (N, 2)."""
    for i in prange(len(places)):
        y, x = places[i, 0], places[i, 1]
        front_variance = _parted_mean(image, index, kin[i, 0], colors, surfaces, y, x, new_colors[i, 0])
        back_variance = _parted_mean(image, index, kin[i, 1], colors, surfaces, y, x, new_colors[i, 1])
        new_surfaces[i] = surfaces[i]
        variances = front_variance, back_variance
        new_surfaces[i, 2] = _part_means(
            image[y, x], new_colors[i], shares[i, 0], shares[i, 1], variances, most[i]
        )


@njit(cache=True)
def _edge_slope(share):  # type: ignore[no-untyped-def]
    """How fast a share changes with the place of its edge."""
    return max(4.0 * share * (1.0 - share), PRIOR.edge_slope)


@njit(cache=True, parallel=True)
def _place_edges(index, places, first, colors, surfaces, shares):  # type: ignore[no-untyped-def]
    """Fill shares and their spreads (N, 2) with what all parted pixels around say of the edge."""
    height, width = index.shape
    for i in prange(len(places)):
        y, x = places[i, 0], places[i, 1]
        shares[i, 0], shares[i, 1] = first[i, 0], first[i, 1]
        if first[i, 1] == 0.0:
            continue
        moved, total, apart = 0.0, PRIOR.edge_doubt, half_step(surfaces[i, 0], surfaces[i, 1])
        for v in range(max(0, y - PRIOR.edge_window), min(height, y + PRIOR.edge_window + 1)):
            for u in range(max(0, x - PRIOR.edge_window), min(width, x + PRIOR.edge_window + 1)):
                j = index[v, u]
                if j < 0:
                    continue
                same = True
                for side in range(2):
                    if abs(surfaces[j, side] - surfaces[i, side]) > apart:
                        same = False
                if not same:
                    continue
                difference = 0.0
                for c in range(3):
                    difference += (colors[j, 0, c] - colors[j, 1, c]) ** 2
                weight = _EDGE_WINDOW[abs(v - y), abs(u - x)]
                weight *= difference / (difference + PRIOR.edge_contrast)
                slope = _edge_slope(first[j, 0])
                moved += weight * slope * (surfaces[j, 2] - first[j, 0])
                total += weight * slope * slope
        shares[i, 0] = min(max(first[i, 0] + _edge_slope(first[i, 0]) * moved / total, 0.0), 1.0)
        shares[i, 1] = PRIOR.placed_spread


def unmix(
    image: np.ndarray,
    defocus: np.ndarray,
    sides: np.ndarray,
    spared: np.ndarray,
    pixel_filter: PixelFilter = DEFAULT_FILTER,
    held: KnownSurfaces | None = None,
) -> MixedPixels:
    """Part the pixels at depth discontinuities into the two surfaces that they mix.

    Args:
        image: All-in-focus picture, scene-linear, (H, W, 3), float32.
        defocus: Signed blur radius in pixels, (H, W), + in front of focus, float32, with sharp steps.
        sides: From :func:`bokehnet.classical.layered.slight_steps.sides_with_slight_steps`, and ``HELD``
            where pixels are known to be mixed.
        spared: Pixels that stay as they are and tell nothing about their neighbours: lights, (H, W) bool.
        pixel_filter: Of the picture.
        held: Pixels whose surfaces and coverage are known: of these only the colours are estimated.

    Returns:
        Both surfaces of all pixels of ``sides`` and ``held`` that are not spared. They add up to the picture
        but for rounding, wherever that is not below 0.
    """
    wanted = sides != 0
    if held is not None:
        wanted[held.rows, held.columns] = True
    places = np.argwhere(wanted & ~spared)
    told = np.full((len(places), 3), -1.0)
    if held is not None:
        held = held.select(~spared[held.rows, held.columns])
        width = sides.shape[1]
        order = np.searchsorted(places @ (width, 1), held.rows.astype(np.int64) * width + held.columns)
        told[order] = np.stack([held.near, held.far, held.coverage], axis=-1)
    weights = np.maximum(pixel_filter.weights(), LEAST_WEIGHT)
    index = np.full(defocus.shape, -1, np.int32)
    index[places[:, 0], places[:, 1]] = np.arange(len(places))
    colors, new_colors = (np.empty((len(places), 2, 3)) for _ in range(2))
    surfaces, new_surfaces = (np.empty((len(places), 4)) for _ in range(2))
    shares, placed, most = (np.empty((len(places), 2)) for _ in range(3))
    kin = np.empty((len(places), 2, 9), np.uint8)
    with parallel_region:
        _unmix(image, defocus, weights, spared, sides, places, told, shares, most, colors, surfaces)
        _find_kin(index, defocus, spared, places, surfaces, kin)
        around = (image, index, kin, places)
        for number in range(PRIOR.rounds + PRIOR.placed_rounds):
            if number == PRIOR.rounds:
                _place_edges(index, places, shares, colors, surfaces, placed)
                shares = placed
            _unmix_again(*around, shares, most, colors, surfaces, new_colors, new_surfaces)
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
