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
the colours where they are textured. Light is not negative; what that cuts off is given to the other side, so
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
from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit

__all__ = ["HELD", "MixedPixels", "unmix"]

# Of a Blackman-Harris filter 3 pixels wide, the part over a pixel itself and over its two neighbours.
_PIXEL_FILTER = np.array([0.1186, 0.7628, 0.1186])

# Standard deviation of the share of the nearer side.
_SHARE_SPREAD = 0.1

# Half the width of the window, squared deviation of the weights and weight of mixed pixels, for the colours.
_WINDOW, _SQUARE, _MIXED = 3, 4.0, 0.35

# Bit of sides beside those of discontinuities: pixels that are known to be mixed, and their weight.
HELD, _KNOWN_MIXED = 4, 1e-3

# Colours vary by at least this part of themselves, and by this much.
_RELATIVE, _LEAST = 0.02, 1e-4


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


@njit(cache=True)
def _surfaces(defocus, y, x):  # type: ignore[no-untyped-def]
    """Near and far defocus of a pixel, the share of the nearer, and whether that is its own."""
    height, width = defocus.shape
    own = near = far = defocus[y, x]
    before = behind = 0.0
    same = 0.0
    for i in range(-1, 2):
        for j in range(-1, 2):
            v, u = min(max(y + i, 0), height - 1), min(max(x + j, 0), width - 1)
            weight = _PIXEL_FILTER[i + 1] * _PIXEL_FILTER[j + 1]
            if defocus[v, u] > own + DISCONTINUITY_THRESHOLD:
                before += weight
                near = max(near, defocus[v, u])
            elif defocus[v, u] < own - DISCONTINUITY_THRESHOLD:
                behind += weight
                far = min(far, defocus[v, u])
            else:
                same += weight
    if before >= behind:
        return near, own, before / (before + same), False
    return own, far, same / (behind + same), True


@njit(cache=True)
def _mean(image, defocus, spared, sides, y, x, depth, color):  # type: ignore[no-untyped-def]
    """Write the colour of the surface at ``depth`` around (y, x); return its variance, below 0 if none."""
    height, width = defocus.shape
    total = square = 0.0
    color[:] = 0.0
    for v in range(max(0, y - _WINDOW), min(height, y + _WINDOW + 1)):
        for u in range(max(0, x - _WINDOW), min(width, x + _WINDOW + 1)):
            if spared[v, u] or abs(defocus[v, u] - depth) > DISCONTINUITY_THRESHOLD:
                continue
            weight = np.exp(-((v - y) * (v - y) + (u - x) * (u - x)) / _SQUARE)
            if sides[v, u] != 0:
                weight *= _KNOWN_MIXED if sides[v, u] & HELD else _MIXED
            total += weight
            for c in range(3):
                color[c] += weight * image[v, u, c]
                square += weight * image[v, u, c] * image[v, u, c]
    if total == 0.0:
        return -1.0
    color /= total
    return max(square / total - (color * color).sum(), 0.0) / 3.0


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


@njit(cache=True, parallel=True)
def _unmix(image, defocus, spared, sides, places, held, colors, surfaces):  # type: ignore[no-untyped-def]
    """Fill colours (N, 2, 3) of front and back, and (N, 4): near, far, coverage, whether near is the own.

    ``held``, (N, 3), are near, far and coverage where they are known; coverage is -1 where they are not.
    """
    for i in prange(len(places)):
        y, x = places[i, 0], places[i, 1]
        near, far, share, is_front = _surfaces(defocus, y, x)
        share_spread = _SHARE_SPREAD
        if held[i, 2] >= 0.0:
            near, far, share = held[i, 0], held[i, 1], held[i, 2]
            is_front, share_spread = share >= 0.5, 0.0
        front_variance = _mean(image, defocus, spared, sides, y, x, near, colors[i, 0])
        back_variance = _mean(image, defocus, spared, sides, y, x, far, colors[i, 1])
        least = _LEAST * _LEAST
        if front_variance < 0.0 or back_variance < 0.0:  # nothing tells the two apart
            colors[i, 0], colors[i, 1] = image[y, x], image[y, x]
            front_variance = back_variance = 1.0
        for c in range(3):
            least += _RELATIVE * _RELATIVE * (colors[i, 0, c] ** 2 + colors[i, 1, c] ** 2) / 3.0
        surfaces[i, 0], surfaces[i, 1], surfaces[i, 3] = near, far, is_front
        surfaces[i, 2] = _part(
            image[y, x],
            colors[i, 0],
            colors[i, 1],
            share,
            share_spread,
            front_variance + least,
            back_variance + least,
        )


def unmix(
    image: np.ndarray,
    defocus: np.ndarray,
    sides: np.ndarray,
    spared: np.ndarray,
    held: KnownSurfaces | None = None,
) -> MixedPixels:
    """Part the pixels at depth discontinuities into the two surfaces that they mix.

    Args:
        image: All-in-focus picture, scene-linear, (H, W, 3), float32.
        defocus: Signed blur radius in pixels, (H, W), + in front of focus, float32, with sharp steps.
        sides: From :func:`bokehnet.classical.layered.depth_discontinuities.discontinuity_sides`, and ``HELD``
            where pixels are known to be mixed.
        spared: Pixels that stay as they are and tell nothing about their neighbours: lights, (H, W) bool.
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
        held = held.taken(~spared[held.rows, held.columns])
        width = sides.shape[1]
        order = np.searchsorted(places @ (width, 1), held.rows.astype(np.int64) * width + held.columns)
        told[order] = np.stack([held.near, held.far, held.coverage], axis=-1)
    colors, surfaces = np.empty((len(places), 2, 3)), np.empty((len(places), 4))
    with parallel_region:
        _unmix(image, defocus, spared, sides, places, told, colors, surfaces)
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
