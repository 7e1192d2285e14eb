"""Spreading on layers that are composited front to back: thesis 001, 3.2.4.

``spread_intervals`` cuts the picture into disjoint intervals of defocus, spreads each by its outlines and
composites the layers. ``spread_pixel_layers`` spreads every pixel into three layers of the pixels that it
reaches: in front of their surface, on it, or behind it.

Faults: a single picture has holes behind its foregrounds, so a blurred foreground is too opaque at its edge;
    surfaces that cross the border of two intervals lose coverage there; the three layers mix all surfaces on
    one side of a pixel.

Source: Kosloff, Tao and Barsky, "Depth of field postprocessing for layered scenes using constant-time
rectangle spreading", Graphics Interface 2009; Lee, Kim and Choi, "Real-time depth-of-field rendering using
point splatting on per-pixel layers", Computer Graphics Forum 2008; after thesis 001, 3.2.4.
"""

from collections.abc import Sequence

import numpy as np

from bokehnet.baselines.apertures import check_baseline, ladder_positions, psf_image, radius_ladder
from bokehnet.baselines.spread.psf_spreading import packed
from bokehnet.baselines.spread.spreading import spread_outlines
from bokehnet.checks import check_above, check_whole
from bokehnet.kernels import njit
from bokehnet.optics.aperture import Aperture

__all__ = ["composite_layers", "interval_of", "spread_intervals", "spread_pixel_layers"]


def interval_of(defocus: np.ndarray, layers: int) -> np.ndarray:
    """Return the index of each pixel's interval, 0 in front, (H, W); intervals of equal length in defocus."""
    low, high = float(defocus.min()), float(defocus.max())
    position = (high - defocus) / max(high - low, 1e-9) * layers
    return np.minimum(position.astype(np.int64), layers - 1)


def composite_layers(layers: Sequence[np.ndarray], image: np.ndarray) -> np.ndarray:
    """Return layers of light and coverage (H, W, 4), front to back, composited, (H, W, 3) float32.

    Coverage above 1, where discs of different sizes overlap, is scaled to 1. The result is divided by the
    total coverage, as nothing is known behind the last layer.

    Args:
        layers: Light times coverage, and coverage.
        image: Picture, for pixels that no layer covers.
    """
    total = np.zeros((*image.shape[:2], 4))
    passing = np.ones((*image.shape[:2], 1))
    for layer in layers:
        covering = layer / np.maximum(layer[..., 3:], 1)
        total += passing * covering
        passing = passing * (1 - covering[..., 3:])
    alpha = total[..., 3:]
    return np.where(alpha > 1e-9, total[..., :3] / np.maximum(alpha, 1e-9), image).astype(np.float32)


def spread_intervals(
    image: np.ndarray, defocus: np.ndarray, aperture: Aperture | None = None, *, layers: int = 8
) -> np.ndarray:
    """Render by spreading the outlines of each interval of defocus, composited front to back.

    Args:
        image: Scene-linear, (H, W, 3).
        defocus: Signed blur radius in pixels, (H, W), + in front of focus.
        aperture: Any aperture without a cat's-eye; default: disc.
        layers: Number of intervals, at least 1; 1 is :func:`bokehnet.baselines.spread.spreading.perimeter`.

    Returns:
        Picture (H, W, 3), float32.

    Source:
        Kosloff, Tao and Barsky 2009; thesis 001, 3.2.4.
    """
    check_whole("layers", layers, 1)
    image, defocus, aperture = check_baseline("spread_intervals", "any", image, defocus, aperture)
    interval = interval_of(defocus, layers)
    spread = [spread_outlines(image, defocus, aperture, interval == each) for each in np.unique(interval)]
    return composite_layers(spread, image)


@njit(cache=True)
def _spread_by_depth(image, defocus, low, upper, tables, starts, halves, tolerance, sums):
    """Add each pixel times the mix of its two tables to one of three layers of ``sums``, (3, H, W, 4)."""
    height, width, _ = image.shape
    for y in range(height):
        for x in range(width):
            if low[y, x] < 0:
                continue
            for step in range(2):
                mix = upper[y, x] if step == 1 else 1.0 - upper[y, x]
                if mix <= 0.0:
                    continue
                half, start = halves[low[y, x] + step], starts[low[y, x] + step]
                for v in range(max(0, y - half), min(height, y + half + 1)):
                    line = start + (v - y + half) * (2 * half + 1) + half - x
                    for u in range(max(0, x - half), min(width, x + half + 1)):
                        difference = defocus[y, x] - defocus[v, u]
                        layer = 1
                        if difference > tolerance:
                            layer = 0
                        elif difference < -tolerance:
                            layer = 2
                        weight = mix * tables[line + u]
                        sums[layer, v, u, 3] += weight
                        for c in range(3):
                            sums[layer, v, u, c] += weight * image[y, x, c]


def spread_pixel_layers(
    image: np.ndarray, defocus: np.ndarray, aperture: Aperture | None = None, *, tolerance: float = 1.0
) -> np.ndarray:
    """Render by spreading into three layers per pixel: in front of its surface, on it and behind it.

    Args:
        image: Scene-linear, (H, W, 3).
        defocus: Signed blur radius in pixels, (H, W), + in front of focus.
        aperture: Any aperture without a cat's-eye; default: disc.
        tolerance: Difference of defocus up to which two pixels are on one surface, pixels.

    Returns:
        Picture (H, W, 3), float32.

    Source:
        Lee, Kim and Choi 2008; thesis 001, 3.2.4.
    """
    check_above("tolerance", tolerance, 0)
    image, defocus, aperture = check_baseline("spread_pixel_layers", "any", image, defocus, aperture)
    sums = np.zeros((3, *defocus.shape, 4))
    for side in (1, -1):
        radii = radius_ladder(max(0.0, float((side * defocus).max())))
        low, upper = ladder_positions(defocus, radii, side)
        tables = packed([psf_image(aperture, float(radius), side) for radius in radii])
        _spread_by_depth(image, defocus, low, upper, *tables, tolerance, sums)
    return composite_layers(list(sums), image)
