"""Scatter as you gather: a few rings of taps, weighted by their circles of confusion, in two layers.

Faults: a fixed number of taps leaves blotches, mainly on bright lights, which lose energy between taps; only
    two layers per tile, split at its nearest depth; half resolution. With Tan's normalisation the weights of
    the two layers, whose sum is one, cancel: the result is a normalised scatter with 81 taps.

Jimenez suggests different strategies per tile (thesis 000, 6.0.1): in a tile of one depth all weights are
equal, so a plain mean of the taps suffices; a tile without blur needs no taps; a wide blur can use more rings
than a narrow one.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import prange

from bokehnet.baselines.apertures import ANGLES, check_baseline, outline
from bokehnet.baselines.gather.basic_gather import random_number
from bokehnet.baselines.gather.half_size import doubled, extreme_of_four
from bokehnet.baselines.gather.tiles import dilated_tiles
from bokehnet.checks import check_above, check_at_least
from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit
from bokehnet.optics.aperture import Aperture

__all__ = [
    "TILE",
    "jimenez",
    "median_of_nine",
    "presort",
    "ring_taps",
    "sample_alpha",
    "spread_weight",
    "tan",
    "tap_table",
    "tile_strategies",
]

# Side of a tile at full size, pixels.
TILE = 32

# Strategies per tile: maximum number of rings, their distance in half-size pixels, and the maximum range of
# defocus of a tile of one depth, as a fraction of its maximum blur.
_MAX_RINGS, _RING_GAP_PX, _MAX_ONE_DEPTH_RANGE = 8, 1.0, 0.1

# Exponent of the coverage of the innermost ring, ``kDofSpreadToePower``, whose value is not published.
_TOE_EXPONENT = 4


class _Kind(NamedTuple):
    """Parameters that differ between Jimenez and Tan."""

    rings: int
    prefilter: float
    two_layers: bool


_JIMENEZ, _TAN = _Kind(3, 1 / 6, True), _Kind(4, 1 / 8, False)


@njit(cache=True)
def presort(behind_nearest, fade):
    """Return the weight of the background: 0 at the tile's nearest depth, 1 ``fade`` pixels behind it.

    ``depthCmp2`` of thesis 000, 5.1.1. The thesis calls it the weight of the foreground, but it is 0 at the
    nearest depth.
    """
    t = min(max(behind_nearest / fade, 0.0), 1.0)
    return t * t * (3.0 - 2.0 * t)


@njit(cache=True)
def sample_alpha(radius):
    """Return the light of a pixel on each pixel of its disc: one over the disc's area, at least one pixel."""
    return 1.0 / (math.pi * max(radius, math.sqrt(0.5)) ** 2)


@njit(cache=True)
def spread_weight(ring, radius):
    """Return the soft coverage of a ring of the kernel by a disc: ``spreadCmp`` of thesis 000, 5.1.1.

    Args:
        ring: Index of the ring, 0 in the centre.
        radius: Radius of the sample's disc, in ring distances.
    """
    spread = min(max(radius - ring + 1.0, 0.0), 1.0)
    return spread**_TOE_EXPONENT if ring <= 1.0 else spread


def ring_taps(rings: int) -> np.ndarray:
    """Return angle and radius in [0, 1] of the centre and of 8 k taps on ring k, (N, 2) float32."""
    taps = [(0.0, 0.0)]
    for ring in range(1, rings + 1):
        count = 8 * ring
        taps += [(2 * math.pi * (index + 0.5) / count, ring / rings) for index in range(count)]
    return np.array(taps, np.float32)


def tap_table(rings: int) -> np.ndarray:
    """Return the taps of 1 to ``rings`` rings, one row each, (rings, N, 2) float32, zero-padded."""
    table = np.zeros((rings, len(ring_taps(rings)), 2), np.float32)
    for number in range(1, rings + 1):
        taps = ring_taps(number)
        table[number - 1, : len(taps)] = taps
    return table


def tile_strategies(nearest: np.ndarray, farthest: np.ndarray, largest: np.ndarray) -> np.ndarray:
    """Return the strategy of each tile, int64: 0 copies, n > 0 uses n rings, -n a plain mean over n rings.

    Args:
        nearest: Maximum defocus of each tile and of the tiles whose blur reaches it, half-size pixels.
        farthest: Minimum defocus.
        largest: Maximum blur radius.
    """
    rings = np.clip(np.ceil(largest / _RING_GAP_PX), 1, _MAX_RINGS).astype(np.int64)
    one_depth = nearest - farthest <= _MAX_ONE_DEPTH_RANGE * largest
    return np.where(2 * largest <= math.sqrt(0.5), 0, np.where(one_depth, -rings, rings))


def median_of_nine(image: np.ndarray) -> np.ndarray:
    """Return the median of 3x3 pixels per channel, (H, W, C)."""
    height, width = image.shape[:2]
    padded = np.pad(image, ((1, 1), (1, 1), (0, 0)), mode="edge")
    windows = [padded[i : i + height, j : j + width] for i in range(3) for j in range(3)]
    return np.asarray(np.median(windows, axis=0))


@njit(cache=True, parallel=True)
def _prefilter(image, defocus, coc, largest, size, spread, result):
    """Fill ``result`` (half size) with nine taps around each pixel, weighted by blur and Karis's average."""
    rows, columns, _ = result.shape
    height, width, _ = image.shape
    for y in prange(rows):
        for x in range(columns):
            reach = max(spread * largest[y // size, x // size], 1.0)  # pixels of full size
            sums = np.zeros(4)
            for tap in range(9):
                j, i = tap // 3 - 1, tap % 3 - 1
                if math.sqrt(i * i + j * j) * reach > max(abs(2.0 * coc[y, x]), 1.5):
                    continue  # no wider than the pixel's own blur
                down, across = 2 * y + 0.5 + reach * j, 2 * x + 0.5 + reach * i
                top, left = int(math.floor(down)), int(math.floor(across))
                for texel in range(4):
                    v, u = texel // 2, texel % 2
                    row, column = min(max(top + v, 0), height - 1), min(max(left + u, 0), width - 1)
                    difference = abs(defocus[row, column] - 2.0 * coc[y, x])
                    red, green, blue = image[row, column, 0], image[row, column, 1], image[row, column, 2]
                    weight = abs(1 - v - down + top) * abs(1 - u - across + left)
                    weight *= max(1.0 - 0.5 * difference, 0.0)
                    weight /= 1.0 + 0.2126 * red + 0.7152 * green + 0.0722 * blue
                    sums[0] += weight * red
                    sums[1] += weight * green
                    sums[2] += weight * blue
                    sums[3] += weight
            if sums[3] > 0.0:
                for c in range(3):
                    result[y, x, c] = sums[c] / sums[3]
            else:
                row, column = min(2 * y, height - 1), min(2 * x, width - 1)
                for c in range(3):
                    result[y, x, c] = image[row, column, c]


@njit(cache=True, parallel=True)
def _main(light, coc, nearest, largest, size, strategies, table, shape, fade, two_layers, jitter, result):
    """Fill ``result`` (half size) with colours and the foreground's alpha; taps move by ``jitter`` pixels."""
    rows, columns, _ = light.shape
    for y in prange(rows):
        for x in range(columns):
            reach, first = max(largest[y // size, x // size], 1e-6), nearest[y // size, x // size]
            rings, plain = abs(strategies[y // size, x // size]), strategies[y // size, x // size] < 0
            if rings == 0:
                for c in range(3):
                    result[y, x, c] = light[y, x, c]
                result[y, x, 3] = 1.0
                continue
            count = 1 + 4 * rings * (rings + 1)
            front, behind = np.zeros(4), np.zeros(4)
            for index in range(count):
                angle, distance = table[rings - 1, index, 0], table[rings - 1, index, 1] * reach
                fraction = angle / (2.0 * math.pi)
                radial = distance * shape[int((fraction - math.floor(fraction)) * ANGLES) % ANGLES]
                down, across = y + radial * math.sin(angle) + 0.5, x + radial * math.cos(angle) + 0.5
                if jitter > 0.0:
                    down += jitter * (random_number(x, y, 2 * index) - 0.5)
                    across += jitter * (random_number(x, y, 2 * index + 1) - 0.5)
                row = min(max(int(math.floor(down)), 0), rows - 1)
                column = min(max(int(math.floor(across)), 0), columns - 1)
                if plain:
                    for c in range(3):
                        front[c] += light[row, column, c]
                    continue
                radius = abs(coc[row, column])
                ring = math.floor(table[rings - 1, index, 1] * rings + 0.5)  # a third times 3 exceeds 1
                weight = spread_weight(ring, radius * rings / reach) * sample_alpha(radius)
                far = presort(first - coc[row, column], fade)
                for c in range(3):
                    front[c] += weight * (1.0 - far) * light[row, column, c]
                    behind[c] += weight * far * light[row, column, c]
                front[3] += weight * (1.0 - far)
                behind[3] += weight * far
            if plain:
                for c in range(3):
                    result[y, x, c] = front[c] / count
                result[y, x, 3] = 1.0
                continue
            alpha = min(2.0 * front[3] / (count * sample_alpha(reach)), 1.0)
            total = front[3] + behind[3]
            for c in range(3):
                if two_layers and behind[3] > 0.0 and front[3] > 0.0:
                    far_light, near_light = behind[c] / behind[3], front[c] / front[3]
                    result[y, x, c] = far_light + alpha * (near_light - far_light)
                else:
                    result[y, x, c] = (front[c] + behind[c]) / total if total > 0.0 else light[y, x, c]
            result[y, x, 3] = alpha


def _render(
    name: str,
    kind: _Kind,
    image: np.ndarray,
    defocus: np.ndarray,
    aperture: Aperture | None,
    fade: float,
    by_tile: bool,
    jitter: float = 0.0,
) -> np.ndarray:
    check_above("fade", fade, 0)
    image, defocus, aperture = check_baseline(name, "outline", image, defocus, aperture)
    coc = extreme_of_four(defocus, largest=False) / np.float32(2)  # the farthest, in half-size pixels
    nearest, largest = dilated_tiles(coc, TILE // 2)
    strategies = np.full(largest.shape, kind.rings)
    if by_tile:
        strategies = tile_strategies(nearest, -dilated_tiles(-coc, TILE // 2)[0], largest)
    light = np.empty((*coc.shape, 3), np.float32)
    blurred = np.empty((*coc.shape, 4), np.float32)
    with parallel_region:
        _prefilter(image, defocus, coc, 2 * largest, TILE // 2, kind.prefilter, light)
        table, shape = tap_table(_MAX_RINGS if by_tile else kind.rings), outline(aperture)
        _main(
            light,
            coc,
            nearest,
            largest,
            TILE // 2,
            strategies,
            table,
            shape,
            fade / 2,
            kind.two_layers,
            jitter,
            blurred,
        )
    blurred[..., :3] = median_of_nine(blurred[..., :3])
    full = doubled(blurred, *defocus.shape)
    # In focus: pixels whose blur is smaller than the diagonal of one, unless a foreground covers them.
    covered = np.clip(full[..., 3], 0, 1)
    nearest_full = np.repeat(np.repeat(nearest, TILE, 0), TILE, 1)[: len(defocus), : defocus.shape[1]]
    covered = np.where(nearest_full > math.sqrt(0.5), covered, 0)
    mix = np.maximum(np.clip((np.abs(defocus) - math.sqrt(0.5)) / math.sqrt(0.5), 0, 1), covered)
    return np.asarray(image + mix[..., None] * (full[..., :3] - image), np.float32)


def jimenez(
    image: np.ndarray,
    defocus: np.ndarray,
    aperture: Aperture | None = None,
    *,
    fade: float = 1.0,
    by_tile: bool = False,
    jitter: float = 0.0,
) -> np.ndarray:
    """Render by Jimenez's post-process: the centre and 48 taps in 3 rings, two layers, alpha between them.

    Steps: tiles of nearest depth and maximum blur; their dilation; prefilter of 9 taps with Karis's average
        and presort at half size; main pass; median; upsampling over pixels in focus.

    Args:
        image: Scene-linear, (H, W, 3).
        defocus: Signed blur radius in pixels, (H, W), + in front of focus.
        aperture: Aperture whose outline shapes the rings; default: disc.
        fade: Distance behind the nearest depth of its tile at which a pixel is fully background, pixels of
            defocus; the thesis fades over 1.5 times the focus distance in scene depth.
        by_tile: Select a strategy per tile (:func:`tile_strategies`), unlike the publication.
        jitter: Range of a random offset of each tap, half-size pixels; 1 is that of thesis 000, 5.1.1, whose
            noise its temporal anti-aliasing hides.

    Returns:
        Picture (H, W, 3), float32.

    Source:
        Jimenez, "Next generation post processing in Call of Duty: Advanced Warfare", SIGGRAPH courses 2014;
        Karis, "Tone mapping", 2013; thesis 000, 5.0.1 and 5.1.1.
    """
    check_at_least("jitter", jitter, 0)
    return _render("jimenez", _JIMENEZ, image, defocus, aperture, fade, by_tile, jitter)


def tan(
    image: np.ndarray,
    defocus: np.ndarray,
    aperture: Aperture | None = None,
    *,
    fade: float = 1.0,
    by_tile: bool = False,
) -> np.ndarray:
    """Render by Tan's post-process: like :func:`jimenez` with 80 taps in 4 rings, all layers in one mean.

    Args:
        image: Scene-linear, (H, W, 3).
        defocus: Signed blur radius in pixels, (H, W), + in front of focus.
        aperture: Aperture whose outline shapes the rings; default: disc.
        fade: As in :func:`jimenez`; determines where the foreground covers pixels in focus.
        by_tile: As in :func:`jimenez`.

    Returns:
        Picture (H, W, 3), float32.

    Source:
        Tan et al. 2022, after thesis 000, 5.0.1: eq. 5.1, ``(v_f + v_b) / sum D alpha``. The two weights of
            the presort sum to 1, so the two sums add up to the total.
    """
    return _render("tan", _TAN, image, defocus, aperture, fade, by_tile)
