"""Low-rank filter: the image of the aperture as a sum of few separable terms, by its singular values.

Faults: truncated ranks leave rings and negative light; foreground and background mix without order.
"""

from functools import lru_cache

import numpy as np

from bokehnet.baselines.apertures import check_baseline, ladder_positions, psf_image, radius_ladder
from bokehnet.checks import check_range, check_whole
from bokehnet.kernels import njit
from bokehnet.optics.aperture import Aperture

__all__ = ["low_rank", "separable_terms"]


@lru_cache(maxsize=256)
def separable_terms(
    aperture: Aperture, radius: float, side: int, rank: int | None, error: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return columns and rows whose products sum to the image of the aperture, up to a truncation error.

    Args:
        aperture: Aperture.
        radius: Blur radius in pixels.
        side: +1 in front of focus, -1 behind it.
        rank: Number of terms; None selects the minimum that ``error`` allows.
        error: Maximum relative error of the image's norm: the root of the sum of the squared omitted singular
            values, divided by that of all.

    Returns:
        Columns and rows, (rank, 2 n + 1) each, float64, scaled so that the total is 1.
    """
    left, values, right = np.linalg.svd(psf_image(aperture, radius, side))
    if rank is None:
        missing = np.sqrt(np.cumsum((values**2)[::-1])[::-1] / (values**2).sum())
        rank = max(1, int((missing > error).sum()))
    rank = min(rank, len(values))
    columns, rows = left[:, :rank].T * values[:rank, None], right[:rank]
    return columns / float((columns.sum(axis=1) * rows.sum(axis=1)).sum()), np.ascontiguousarray(rows)


@njit(cache=True)
def _add_blurred(values, low, upper, index, columns, rows, lines, sums):
    """Add the pixels of a ladder step, spread along rows, then along columns, for each separable term."""
    height, width, channels = values.shape
    half = rows.shape[1] // 2
    for term in range(rows.shape[0]):
        first, last = height, -1
        for y in range(height):
            for x in range(width):
                if low[y, x] == index:
                    mix = 1.0 - upper[y, x]
                elif low[y, x] >= 0 and low[y, x] + 1 == index:
                    mix = upper[y, x]
                else:
                    continue
                first, last = min(first, y), max(last, y)
                for u in range(max(0, x - half), min(width, x + half + 1)):
                    weight = mix * rows[term, u - x + half]
                    for c in range(channels):
                        lines[y, u, c] += weight * values[y, x, c]
        for y in range(first, last + 1):
            for v in range(max(0, y - half), min(height, y + half + 1)):
                weight = columns[term, v - y + half]
                for u in range(width):
                    for c in range(channels):
                        sums[v, u, c] += weight * lines[y, u, c]
            lines[y, :, :] = 0.0


def low_rank(
    image: np.ndarray,
    defocus: np.ndarray,
    aperture: Aperture | None = None,
    *,
    rank: int | None = None,
    error: float = 0.1,
) -> np.ndarray:
    """Render by low-rank filters, one for each step of a ladder of radii on either side of focus.

    Light is divided by weight. A pixel between two steps contributes to both.

    Args:
        image: Scene-linear, (H, W, 3).
        defocus: Signed blur radius in pixels, (H, W), + in front of focus.
        aperture: Any aperture without a cat's-eye, including spherical profiles and holes; default: disc.
        rank: Number of separable filters per radius; None selects the minimum that ``error`` allows.
        error: Maximum relative error of a filter's norm, 0 to 1.

    Returns:
        Picture (H, W, 3), float32, at least 0.

    Source:
        McGraw, "Fast bokeh effects using low-rank linear filters", The Visual Computer 2014; thesis 000, eq.
        3.19. Eckart and Young's theorem: the best sum of r products is that of the r largest singular values.
    """
    if rank is not None:
        check_whole("rank", rank, 1)
    check_range("error", error, 0, 1)
    image, defocus, aperture = check_baseline("low_rank", "any", image, defocus, aperture)
    values = np.concatenate([image, np.ones((*defocus.shape, 1), np.float32)], axis=2)
    sums, lines = np.zeros(values.shape, np.float32), np.zeros(values.shape, np.float32)
    for side in (1, -1):
        radii = radius_ladder(max(0.0, float((side * defocus).max())))
        low, upper = ladder_positions(defocus, radii, side)
        for index, radius in enumerate(radii):
            terms = separable_terms(aperture, float(radius), side, rank, error)
            columns, rows = (np.ascontiguousarray(term, np.float32) for term in terms)
            _add_blurred(values, low, upper, index, columns, rows, lines, sums)
    weight = sums[..., 3:]
    return np.asarray(np.where(weight > 1e-6, np.maximum(sums[..., :3], 0) / np.maximum(weight, 1e-6), image))
