"""A picture and its depth at a multiple of their size, reduced to pixels of one or two surfaces.

Where the disparities of a pixel's fine samples leave a gap, those before and behind it are two surfaces. How
many there are of each is their coverage. Fine samples beside the other surface are mixtures themselves, as a
renderer filters the fine picture too; so colours are means over the pure ones of a surface, those inside the
pixel first, else those around it. What ``a F + (1 - a) B`` lacks of the pixel's light then is shared out by
least squares, so that both surfaces add up to it.
"""

import numpy as np
from numba import prange

from bokehnet.classical.known_surfaces import KnownSurfaces
from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit

__all__ = ["reduce_supersampled"]

# Smallest gap between two surfaces, as a part of the range of disparity in the picture.
_LEAST_GAP = 1e-3

# How far around its middle a pixel looks for pure samples, in pixels, and their weight beside one within.
_AROUND, _OUTSIDE = 3, 4e-4

# Weight of a sample beside the other surface.
_IMPURE = 1e-3

# Disparities of a surface may go on beyond those inside the pixel by this part of the gap.
_SLACK = 0.25


@njit(cache=True)
def _widest_gap(values, least):  # type: ignore[no-untyped-def]
    """Middle of the widest gap in ``values``, sorted in place, or NaN where none is wider than ``least``."""
    for i in range(1, len(values)):  # few values: sorted as they are inserted
        value, place = values[i], i
        while place > 0 and values[place - 1] > value:
            values[place] = values[place - 1]
            place -= 1
        values[place] = value
    middle = np.nan
    for i in range(1, len(values)):
        if values[i] - values[i - 1] > least:
            least = values[i] - values[i - 1]
            middle = 0.5 * (values[i] + values[i - 1])
    return middle


@njit(cache=True)
def _is_pure(disparity, y, x, middle):  # type: ignore[no-untyped-def]
    """Whether a sample has only samples of its own side around it."""
    height, width = disparity.shape
    before = disparity[y, x] > middle
    for v in range(max(0, y - 1), min(height, y + 2)):
        for u in range(max(0, x - 1), min(width, x + 2)):
            if (disparity[v, u] > middle) != before:
                return False
    return True


@njit(cache=True)
def _add_colors(image, disparity, factor, y, x, middle, low, high, colors, totals):  # type: ignore[no-untyped-def]
    """Add up the colours (2, 3) of both sides of the pixel (y, x) and their weights (2,)."""
    height, width = disparity.shape
    top, left = y * factor, x * factor
    reach = _AROUND * factor
    center_y, center_x = top + 0.5 * (factor - 1), left + 0.5 * (factor - 1)
    slack = _SLACK * (high - low)
    for v in range(max(0, top + factor // 2 - reach), min(height, top + factor // 2 + reach)):
        for u in range(max(0, left + factor // 2 - reach), min(width, left + factor // 2 + reach)):
            if not low - slack <= disparity[v, u] <= high + slack:
                continue
            square = ((v - center_y) ** 2 + (u - center_x) ** 2) / (factor * factor)
            weight = _OUTSIDE * np.exp(-0.5 * square)
            if top <= v < top + factor and left <= u < left + factor:
                weight += 1.0
            if not _is_pure(disparity, v, u, middle):
                weight *= _IMPURE
            side = 0 if disparity[v, u] > middle else 1
            totals[side] += weight
            for c in range(3):
                colors[side, c] += weight * image[v, u, c]


@njit(cache=True, parallel=True)
def _reduce(image, disparity, factor, least, small, values, colors, surfaces):  # type: ignore[no-untyped-def]
    """Fill picture, disparity, colours (H, W, 2, 3) and near, far, coverage (H, W, 3), -1 where it is one."""
    height, width = values.shape
    count = factor * factor
    for y in prange(height):
        found, totals = np.empty(count), np.empty(2)
        for x in range(width):
            light = np.zeros(3)
            for i in range(count):
                v, u = y * factor + i // factor, x * factor + i % factor
                found[i] = disparity[v, u]
                for c in range(3):
                    light[c] += image[v, u, c] / count
            for c in range(3):
                small[y, x, c] = light[c]
            surfaces[y, x, 2] = -1.0
            mean = found.mean()
            middle = _widest_gap(found, least)
            if np.isnan(middle):
                values[y, x] = mean
                continue
            near = far = 0.0
            before = 0
            for i in range(count):
                if found[i] > middle:
                    near += found[i]
                    before += 1
                else:
                    far += found[i]
            near, far, share = near / before, far / (count - before), before / count
            two = np.zeros((2, 3))
            totals[:] = 0.0
            low, high = found[0], found[-1]
            _add_colors(image, disparity, factor, y, x, middle, low, high, two, totals)
            spread = share * share + (1.0 - share) * (1.0 - share)
            for c in range(3):
                front, back = two[0, c] / totals[0], two[1, c] / totals[1]
                lacking = light[c] - share * front - (1.0 - share) * back
                front += share / spread * lacking
                back += (1.0 - share) / spread * lacking
                lowest = min(light[c], 0.0)
                if front < lowest:
                    front, back = lowest, (light[c] - share * lowest) / (1.0 - share)
                elif back < lowest:
                    front, back = (light[c] - (1.0 - share) * lowest) / share, lowest
                colors[y, x, 0, c], colors[y, x, 1, c] = front, back
            surfaces[y, x, 0], surfaces[y, x, 1], surfaces[y, x, 2] = near, far, share
            values[y, x] = near if share >= 0.5 else far


def reduce_supersampled(
    image: np.ndarray, disparity: np.ndarray, factor: int
) -> tuple[np.ndarray, np.ndarray, KnownSurfaces]:
    """Reduce a picture and its disparity to pixels of one or two surfaces.

    Args:
        image: Scene-linear, (factor H, factor W, 3), float32.
        disparity: Of the same pixels, near is large, or anything that is linear in it.
        factor: Fine pixels of a pixel along each side.

    Returns:
        Picture (H, W, 3), each pixel the mean of its samples; disparity (H, W), where there are two surfaces
        that of the one with more samples; and both surfaces of those pixels, in the unit of ``disparity``.
    """
    height, width = disparity.shape[0] // factor, disparity.shape[1] // factor
    small, values = np.empty((height, width, 3), np.float32), np.empty((height, width), np.float32)
    colors, surfaces = np.empty((height, width, 2, 3), np.float32), np.empty((height, width, 3), np.float32)
    least = _LEAST_GAP * float(np.ptp(disparity))
    with parallel_region:
        _reduce(image, disparity, factor, least, small, values, colors, surfaces)
    y, x = np.nonzero(surfaces[..., 2] >= 0)
    near, far, coverage = surfaces[y, x].T
    known = KnownSurfaces(
        rows=y,
        columns=x,
        near=near,
        far=np.minimum(near, far),
        coverage=coverage,
        front=colors[y, x, 0],
        back=colors[y, x, 1],
        complete=True,
    )
    return small, values, known
