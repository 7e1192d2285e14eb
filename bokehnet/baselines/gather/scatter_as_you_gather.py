"""Scatter as you gather: a few rings of taps, each weighed by its own circle of confusion, in two layers.

Faults: a fixed number of taps leaves blotches, above all on bright lights, which lose energy where they fall
between taps; two layers a tile, told apart by the nearest depth in it; half resolution. With Tan's
normalisation the weights of the two layers, which add up to one, cancel: what is left is a normalised scatter
at 81 taps.

Tiles need not all be treated alike, Jimenez says (thesis 000, 6.0.1): where a tile has one depth all weights
are the same, and a plain mean of the taps will do; where nothing is blurred, none; and a wide blur may take
more rings than a narrow one.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import prange

from bokehnet.baselines.gather.half_size import doubled, extreme_of_four
from bokehnet.baselines.gather.tiles import dilated_tiles
from bokehnet.baselines.openings import ANGLES, check_baseline, outline
from bokehnet.checks import check_above
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
    "tile_ways",
]

# Side of a tile at full size, pixels.
TILE = 32

# By tile: the most rings, their distance in pixels of half the size, and the range of defocus in a tile, part
# of its largest blur, that is still one depth.
_MOST_RINGS, _RING_GAP, _ONE_DEPTH = 8, 1.0, 0.1

# Power of the cover of the innermost ring, ``kDofSpreadToePower``, whose value is not told.
_TOE = 4


class _Kind(NamedTuple):
    """What Jimenez and Tan choose differently."""

    rings: int
    prefilter: float
    two_layers: bool


_JIMENEZ, _TAN = _Kind(3, 1 / 6, True), _Kind(4, 1 / 8, False)


@njit(cache=True)
def presort(behind_nearest, fade):  # type: ignore[no-untyped-def]
    """Weight of the background, 0 at the tile's nearest to 1 ``fade`` pixels of defocus behind it.

    ``depthCmp2`` of thesis 000, 5.1.1. What it calls the foreground's weight is that of the background: it is
    0 where the depth is the closest one.
    """
    t = min(max(behind_nearest / fade, 0.0), 1.0)
    return t * t * (3.0 - 2.0 * t)


@njit(cache=True)
def sample_alpha(radius):  # type: ignore[no-untyped-def]
    """Light that a pixel brings to each pixel of its disc: one over its area, at most one pixel's."""
    return 1.0 / (math.pi * max(radius, math.sqrt(0.5)) ** 2)


@njit(cache=True)
def spread_weight(ring, radius):  # type: ignore[no-untyped-def]
    """Whether a disc covers a ring of the kernel, softly over one ring: ``spreadCmp`` of thesis 000, 5.1.1.

    Args:
        ring: Its number, 0 in the middle.
        radius: Of the sample's disc, in distances between rings.
    """
    spread = min(max(radius - ring + 1.0, 0.0), 1.0)
    return spread**_TOE if ring <= 1.0 else spread


def ring_taps(rings: int) -> np.ndarray:
    """Angle and radius in [0, 1] of the middle and of 8 k taps on ring k; (N, 2) float32."""
    found = [(0.0, 0.0)]
    for ring in range(1, rings + 1):
        count = 8 * ring
        found += [(2 * math.pi * (index + 0.5) / count, ring / rings) for index in range(count)]
    return np.array(found, np.float32)


def tap_table(rings: int) -> np.ndarray:
    """Taps of 1 to ``rings`` rings, one row each, (rings, N, 2) float32, with zeros after the last."""
    table = np.zeros((rings, len(ring_taps(rings)), 2), np.float32)
    for number in range(1, rings + 1):
        taps = ring_taps(number)
        table[number - 1, : len(taps)] = taps
    return table


def tile_ways(nearest: np.ndarray, farthest: np.ndarray, largest: np.ndarray) -> np.ndarray:
    """How each tile is best treated: 0 as it is, n > 0 by n rings, -n by a plain mean over n rings; int64.

    Args:
        nearest: Largest defocus of each tile and of those whose blur reaches it, pixels of half the size.
        farthest: Least defocus.
        largest: Largest blur radius.
    """
    rings = np.clip(np.ceil(largest / _RING_GAP), 1, _MOST_RINGS).astype(np.int64)
    one_depth = nearest - farthest <= _ONE_DEPTH * largest
    return np.where(2 * largest <= math.sqrt(0.5), 0, np.where(one_depth, -rings, rings))


def median_of_nine(image: np.ndarray) -> np.ndarray:
    """Median of 3x3 pixels, each channel by itself; (H, W, C)."""
    height, width = image.shape[:2]
    padded = np.pad(image, ((1, 1), (1, 1), (0, 0)), mode="edge")
    windows = [padded[i : i + height, j : j + width] for i in range(3) for j in range(3)]
    return np.asarray(np.median(windows, axis=0))


@njit(cache=True, parallel=True)
def _prefilter(image, defocus, coc, largest, size, share, result):  # type: ignore[no-untyped-def]
    """Fill ``result`` (half size) with nine taps around each pixel, weighed by blur and Karis's average."""
    rows, columns, _ = result.shape
    height, width, _ = image.shape
    for y in prange(rows):
        for x in range(columns):
            reach = max(share * largest[y // size, x // size], 1.0)  # pixels of full size
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
                    apart = abs(defocus[row, column] - 2.0 * coc[y, x])
                    red, green, blue = image[row, column, 0], image[row, column, 1], image[row, column, 2]
                    weight = abs(1 - v - down + top) * abs(1 - u - across + left)
                    weight *= max(1.0 - 0.5 * apart, 0.0)
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
def _main(  # type: ignore[no-untyped-def]
    light, coc, nearest, largest, size, ways, table, shape, fade, two_layers, result
):
    """Fill ``result`` (half size) with colours and the foreground's alpha."""
    rows, columns, _ = light.shape
    for y in prange(rows):
        for x in range(columns):
            reach, first = max(largest[y // size, x // size], 1e-6), nearest[y // size, x // size]
            rings, plain = abs(ways[y // size, x // size]), ways[y // size, x // size] < 0
            if rings == 0:
                for c in range(3):
                    result[y, x, c] = light[y, x, c]
                result[y, x, 3] = 1.0
                continue
            count = 1 + 4 * rings * (rings + 1)
            before, behind = np.zeros(4), np.zeros(4)
            for index in range(count):
                angle, distance = table[rings - 1, index, 0], table[rings - 1, index, 1] * reach
                turn = angle / (2.0 * math.pi)
                away = distance * shape[int((turn - math.floor(turn)) * ANGLES) % ANGLES]
                row = min(max(int(math.floor(y + away * math.sin(angle) + 0.5)), 0), rows - 1)
                column = min(max(int(math.floor(x + away * math.cos(angle) + 0.5)), 0), columns - 1)
                if plain:
                    for c in range(3):
                        before[c] += light[row, column, c]
                    continue
                radius = abs(coc[row, column])
                ring = math.floor(table[rings - 1, index, 1] * rings + 0.5)  # a third times 3 is above 1
                weight = spread_weight(ring, radius * rings / reach) * sample_alpha(radius)
                far = presort(first - coc[row, column], fade)
                for c in range(3):
                    before[c] += weight * (1.0 - far) * light[row, column, c]
                    behind[c] += weight * far * light[row, column, c]
                before[3] += weight * (1.0 - far)
                behind[3] += weight * far
            if plain:
                for c in range(3):
                    result[y, x, c] = before[c] / count
                result[y, x, 3] = 1.0
                continue
            alpha = min(2.0 * before[3] / (count * sample_alpha(reach)), 1.0)
            total = before[3] + behind[3]
            for c in range(3):
                if two_layers and behind[3] > 0.0 and before[3] > 0.0:
                    far_light, near_light = behind[c] / behind[3], before[c] / before[3]
                    result[y, x, c] = far_light + alpha * (near_light - far_light)
                else:
                    result[y, x, c] = (before[c] + behind[c]) / total if total > 0.0 else light[y, x, c]
            result[y, x, 3] = alpha


def _render(
    name: str,
    kind: _Kind,
    image: np.ndarray,
    defocus: np.ndarray,
    aperture: Aperture | None,
    fade: float,
    by_tile: bool,
) -> np.ndarray:
    check_above("fade", fade, 0)
    image, defocus, aperture = check_baseline(name, "outline", image, defocus, aperture)
    coc = extreme_of_four(defocus, largest=False) / np.float32(2)  # the farthest, in pixels of half the size
    nearest, largest = dilated_tiles(coc, TILE // 2)
    ways = np.full(largest.shape, kind.rings)
    if by_tile:
        ways = tile_ways(nearest, -dilated_tiles(-coc, TILE // 2)[0], largest)
    light = np.empty((*coc.shape, 3), np.float32)
    blurred = np.empty((*coc.shape, 4), np.float32)
    with parallel_region:
        _prefilter(image, defocus, coc, 2 * largest, TILE // 2, kind.prefilter, light)
        table, shape = tap_table(_MOST_RINGS if by_tile else kind.rings), outline(aperture)
        _main(
            light,
            coc,
            nearest,
            largest,
            TILE // 2,
            ways,
            table,
            shape,
            fade / 2,
            kind.two_layers,
            blurred,
        )
    blurred[..., :3] = median_of_nine(blurred[..., :3])
    full = doubled(blurred, *defocus.shape)
    # In focus: pixels whose blur is smaller than the diagonal of one, unless a foreground covers them.
    covered = np.clip(full[..., 3], 0, 1)
    before = np.repeat(np.repeat(nearest, TILE, 0), TILE, 1)[: len(defocus), : defocus.shape[1]]
    covered = np.where(before > math.sqrt(0.5), covered, 0)
    share = np.maximum(np.clip((np.abs(defocus) - math.sqrt(0.5)) / math.sqrt(0.5), 0, 1), covered)
    return np.asarray(image + share[..., None] * (full[..., :3] - image), np.float32)


def jimenez(
    image: np.ndarray,
    defocus: np.ndarray,
    aperture: Aperture | None = None,
    *,
    fade: float = 1.0,
    by_tile: bool = False,
) -> np.ndarray:
    """Render by Jimenez's post-process: 48 taps in 3 rings beside the middle, two layers, alpha between them.

    Tiles of the nearest depth and the largest blur; their dilation; prefilter of 9 taps with Karis's average
    and presort at half the size; main pass; median; back to full size over what is in focus.

    Args:
        image: Scene-linear, (H, W, 3).
        defocus: Signed blur radius in pixels, (H, W), + in front of focus.
        aperture: Its outline shapes the rings; default a disc.
        fade: How far behind the nearest of its tile a pixel is all background, pixels of defocus; the thesis
            has one over 1.5 times the focus distance, in the depth of its scenes.
        by_tile: Treat each tile as it needs (:func:`tile_ways`), which is not what was published.

    Returns:
        Picture (H, W, 3), float32.

    Source:
        Jimenez, "Next generation post processing in Call of Duty: Advanced Warfare", SIGGRAPH courses 2014;
        Karis, "Tone mapping", 2013; thesis 000, 5.0.1 and 5.1.1.
    """
    return _render("jimenez", _JIMENEZ, image, defocus, aperture, fade, by_tile)


def tan(
    image: np.ndarray,
    defocus: np.ndarray,
    aperture: Aperture | None = None,
    *,
    fade: float = 1.0,
    by_tile: bool = False,
) -> np.ndarray:
    """Render by Tan's post-process: as :func:`jimenez` with 80 taps in 4 rings, all layers in one mean.

    Args:
        image: Scene-linear, (H, W, 3).
        defocus: Signed blur radius in pixels, (H, W), + in front of focus.
        aperture: Its outline shapes the rings; default a disc.
        fade: As for :func:`jimenez`; it decides where the foreground covers what is in focus.
        by_tile: As for :func:`jimenez`.

    Returns:
        Picture (H, W, 3), float32.

    Source:
        Tan et al. 2022, as thesis 000, 5.0.1, gives it: eq. 5.1, ``(v_f + v_b) / sum D alpha``. As the two
        weights of the presort add up to 1, so do the two sums to the sum of all.
    """
    return _render("tan", _TAN, image, defocus, aperture, fade, by_tile)
