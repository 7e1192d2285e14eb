"""PSNR and SSIM of display pictures."""

import math

import numpy as np

from bokehnet.checks import check_image, check_same_size

__all__ = ["psnr", "ssim_map"]

_MAX_PSNR_DB = 100.0  # of equal pictures
_SIGMA_PX, _HALF_WINDOW_PX = 1.5, 5  # of the Gaussian window
_C1, _C2 = 0.01**2, 0.03**2


def psnr(reference: np.ndarray, test: np.ndarray, where: np.ndarray | None = None) -> float:
    """Return the peak signal-to-noise ratio of values in [0, 1], dB, at most 100; NaN without pixels.

    Args:
        reference: Picture in [0, 1], (H, W, 3).
        test: Picture of the same size.
        where: Mask of the pixels to compare, (H, W) bool; default: all.

    Examples:
        >>> import numpy as np
        >>> round(psnr(np.zeros((4, 4, 3)), np.full((4, 4, 3), 0.1)), 6)
        20.0
    """
    check_same_size("reference", reference, "test", test)
    squared = (np.asarray(reference, float) - test) ** 2
    if where is not None:
        squared = squared[where]
    if squared.size == 0:
        return math.nan
    return min(_MAX_PSNR_DB, -10 * math.log10(max(float(squared.mean()), 1e-12)))


def _smoothed(values: np.ndarray) -> np.ndarray:
    """Return Gaussian means over windows inside the picture, (H - 10, W - 10, C)."""
    position = np.arange(-_HALF_WINDOW_PX, _HALF_WINDOW_PX + 1)
    gaussian = np.exp(-0.5 * (position / _SIGMA_PX) ** 2)
    gaussian /= gaussian.sum()
    for axis in (0, 1):
        size = values.shape[axis] - 2 * _HALF_WINDOW_PX
        values = sum(np.take(values, np.arange(k, k + size), axis) * w for k, w in enumerate(gaussian))
    return values


def ssim_map(reference: np.ndarray, test: np.ndarray) -> np.ndarray:
    """Return the structural similarity at each pixel at least five from the border; 1 is best.

    Args:
        reference: Display picture in [0, 1], (H, W, 3), at least 11 pixels high and wide.
        test: Display picture of the same size.

    Returns:
        Similarity map (H - 10, W - 10, 3) float64; its mean is the usual score.

    Source:
        Wang, Bovik, Sheikh and Simoncelli, "Image quality assessment: From error visibility to structural
        similarity", IEEE Transactions on Image Processing 2004.
    """
    check_image("reference", reference)
    check_same_size("reference", reference, "test", test)
    a, b = np.asarray(reference, float), np.asarray(test, float)
    mean_a, mean_b = _smoothed(a), _smoothed(b)
    variance_a, variance_b = _smoothed(a * a) - mean_a**2, _smoothed(b * b) - mean_b**2
    covariance = _smoothed(a * b) - mean_a * mean_b
    above = (2 * mean_a * mean_b + _C1) * (2 * covariance + _C2)
    return np.asarray(above / ((mean_a**2 + mean_b**2 + _C1) * (variance_a + variance_b + _C2)))
