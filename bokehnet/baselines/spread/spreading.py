"""Kosloff's spreading: pixels write the differences of their blur, and cumulative sums integrate them.

Rectangle: sixteen numbers per pixel for any blur. Perimeter: the outline of any aperture, row by row.
Hybrid: the second where contrast is high, the first elsewhere. Faults: foreground and background mix without
order; a rectangle is a square.
"""

import math

import numpy as np

from bokehnet.baselines.apertures import check_baseline, ladder_positions, psf_image, radius_ladder
from bokehnet.baselines.spread.psf_spreading import normalised
from bokehnet.checks import check_above, check_whole
from bokehnet.kernels import njit
from bokehnet.optics.aperture import Aperture

__all__ = ["hybrid_spreading", "local_contrast", "perimeter", "rectangle", "spread_outlines"]

# Number of channels of a pixel: light and weight.
_CHANNELS = 4


@njit(cache=True)
def _add_squares(image, defocus, mask, sums):
    """Write the second differences of a square of the area of each pixel's disc, (H + 1, W + 1, 4).

    A side of 2 h pixels around a pixel centre has differences at four positions, two at each end, as its ends
    cover pixels partially. Parts outside the picture are clipped.
    """
    height, width, _ = image.shape
    at_row, at_column = np.empty(4, np.int64), np.empty(4, np.int64)
    by_row, by_column = np.empty(4), np.empty(4)
    for y in range(height):
        for x in range(width):
            if not mask[y, x]:
                continue
            half = max(0.5 * math.sqrt(math.pi) * abs(defocus[y, x]), 0.5)
            full_pixels = int(math.floor(half - 0.5))
            fraction = half - 0.5 - full_pixels
            for axis in range(2):
                middle, end = (y, height) if axis == 0 else (x, width)
                at, by = (at_row, by_row) if axis == 0 else (at_column, by_column)
                at[0], at[1] = middle - full_pixels - 1, middle - full_pixels
                at[2], at[3] = middle + full_pixels + 1, middle + full_pixels + 2
                by[0], by[1], by[2], by[3] = fraction, 1.0 - fraction, fraction - 1.0, -fraction
                for k in range(4):
                    at[k] = min(max(at[k], 0), end)
            light = 1.0 / (4.0 * half * half)
            for j in range(4):
                for i in range(4):
                    weight = light * by_row[j] * by_column[i]
                    if weight == 0.0:
                        continue
                    for c in range(3):
                        sums[at_row[j], at_column[i], c] += weight * image[y, x, c]
                    sums[at_row[j], at_column[i], 3] += weight


@njit(cache=True)
def _add_outlines(image, low, upper, starts, down, across, change, mask, sums):
    """Write the differences along rows of each pixel's image of the aperture, (H, W + 1, 4)."""
    height, width, _ = image.shape
    for y in range(height):
        for x in range(width):
            if low[y, x] < 0 or not mask[y, x]:
                continue
            for step in range(2):
                mix = upper[y, x] if step == 1 else 1.0 - upper[y, x]
                if mix <= 0.0:
                    continue
                for k in range(starts[low[y, x] + step], starts[low[y, x] + step + 1]):
                    row = y + down[k]
                    if row < 0 or row >= height:
                        continue
                    column = min(max(x + across[k], 0), width)
                    weight = mix * change[k]
                    for c in range(3):
                        sums[row, column, c] += weight * image[y, x, c]
                    sums[row, column, 3] += weight


def _outlines(
    aperture: Aperture, radii: np.ndarray, side: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the changes of aperture images along rows, concatenated, and the start of each image."""
    starts, outlines = [0], []
    for radius in radii:
        table = psf_image(aperture, float(radius), side)
        half = len(table) // 2
        change = np.diff(table, axis=1, prepend=0, append=0)
        rows, columns = np.nonzero(np.abs(change) > 1e-12 * table.max())
        outlines.append((rows - half, columns - half, change[rows, columns]))
        starts.append(starts[-1] + len(rows))
    down, across, change = (np.concatenate(parts) for parts in zip(*outlines, strict=True))
    return np.array(starts), down, across, change


def _spread(image: np.ndarray, defocus: np.ndarray, aperture: Aperture, outlined: np.ndarray) -> np.ndarray:
    """Spread the pixels of the mask ``outlined`` by their outlines, all others by squares."""
    height, width = defocus.shape
    squares = np.zeros((height + 1, width + 1, _CHANNELS))
    _add_squares(image, defocus, ~outlined, squares)
    sums = squares.cumsum(axis=0)[:height]
    if outlined.any():
        _add_all_outlines(image, defocus, aperture, outlined, sums)
    sums = sums.cumsum(axis=1)[:, :width]
    return normalised(sums[..., :3], sums[..., 3], image)


def _add_all_outlines(
    image: np.ndarray, defocus: np.ndarray, aperture: Aperture, mask: np.ndarray, sums: np.ndarray
) -> None:
    for side in (1, -1):
        radii = radius_ladder(max(0.0, float((side * defocus).max())))
        low, upper = ladder_positions(defocus, radii, side)
        _add_outlines(image, low, upper, *_outlines(aperture, radii, side), mask, sums)


def spread_outlines(
    image: np.ndarray, defocus: np.ndarray, aperture: Aperture, mask: np.ndarray
) -> np.ndarray:
    """Return light and coverage, (H, W, 4) float64, that the pixels of a mask spread by their outlines."""
    height, width = defocus.shape
    sums = np.zeros((height, width + 1, _CHANNELS))
    _add_all_outlines(image, defocus, aperture, mask, sums)
    return sums.cumsum(axis=1)[:, :width]


def local_contrast(image: np.ndarray, window: int) -> np.ndarray:
    """Return the absolute difference of each pixel to the mean of the square around it, (H, W), linear light.

    Args:
        image: Scene-linear, (H, W, 3).
        window: Half side of the square, pixels; clipped at the border.
    """
    grey = image.astype(np.float64).mean(axis=2)
    height, width = grey.shape
    table = np.pad(grey.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
    top, bottom = (np.clip(np.arange(height) + k, 0, height) for k in (-window, window + 1))
    left, right = (np.clip(np.arange(width) + k, 0, width) for k in (-window, window + 1))
    total = table[bottom][:, right] - table[top][:, right] - table[bottom][:, left] + table[top][:, left]
    return np.asarray(np.abs(grey - total / np.outer(bottom - top, right - left)))


def rectangle(image: np.ndarray, defocus: np.ndarray, aperture: Aperture | None = None) -> np.ndarray:
    """Render by spreading squares of the discs' area, in a time independent of the blur.

    Args:
        image: Scene-linear, (H, W, 3).
        defocus: Signed blur radius in pixels, (H, W), + in front of focus.
        aperture: Plain disc or None.

    Returns:
        Picture (H, W, 3), float32.

    Source:
        Kosloff, Tao and Barsky, "Depth of field postprocessing for layered scenes using constant-time
        rectangle spreading", Graphics Interface 2009; thesis 001, 3.2.4 and 4.4.
    """
    image, defocus, aperture = check_baseline("rectangle", "disc", image, defocus, aperture)
    return _spread(image, defocus, aperture, np.zeros(defocus.shape, bool))


def perimeter(image: np.ndarray, defocus: np.ndarray, aperture: Aperture | None = None) -> np.ndarray:
    """Render by spreading outlines, in a time proportional to the blur radius instead of its area.

    Args:
        image: Scene-linear, (H, W, 3).
        defocus: Signed blur radius in pixels, (H, W), + in front of focus.
        aperture: Any aperture without a cat's-eye; non-uniform ones cost time proportional to their area.
            Default: disc.

    Returns:
        Picture (H, W, 3), float32.

    Source:
        As in :func:`rectangle`; thesis 001, figure 3.4.
    """
    image, defocus, aperture = check_baseline("perimeter", "any", image, defocus, aperture)
    return _spread(image, defocus, aperture, np.ones(defocus.shape, bool))


def hybrid_spreading(
    image: np.ndarray,
    defocus: np.ndarray,
    aperture: Aperture | None = None,
    *,
    threshold: float = 0.02,
    window: int = 4,
) -> np.ndarray:
    """Render by spreading outlines for pixels of high contrast, and squares for all others.

    Args:
        image: Scene-linear, (H, W, 3).
        defocus: Signed blur radius in pixels, (H, W), + in front of focus.
        aperture: As in :func:`perimeter`.
        threshold: Minimum :func:`local_contrast` of a pixel that spreads its outline, linear light.
        window: Half side of the square of :func:`local_contrast`, pixels.

    Returns:
        Picture (H, W, 3), float32.

    Source:
        Kosloff, "Fast image filters for depth of field post-processing", 2010, after thesis 001, 3.2.4.
    """
    check_above("threshold", threshold, 0)
    check_whole("window", window, 1)
    image, defocus, aperture = check_baseline("hybrid_spreading", "any", image, defocus, aperture)
    return _spread(image, defocus, aperture, local_contrast(image, window) > threshold)
