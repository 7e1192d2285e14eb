"""PSNR and SSIM of pictures as they are shown."""

import math

import numpy as np

from bokehnet.checks import check_image, check_same_size

__all__ = ["psnr", "ssim_map"]

_MOST = 100.0  # dB, of equal pictures
_WIDTH, _HALF = 1.5, 5  # of the Gaussian window, pixels
_C1, _C2 = 0.01**2, 0.03**2


def psnr(reference: np.ndarray, test: np.ndarray, where: np.ndarray | None = None) -> float:
    """Peak signal over noise of values in [0, 1], dB, at most 100; NaN where no pixel counts.

    Args:
        reference: (H, W, 3).
        test: The same size.
        where: Pixels that count, (H, W) bool; default all.

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
    return min(_MOST, -10 * math.log10(max(float(squared.mean()), 1e-12)))


def _smoothed(values: np.ndarray) -> np.ndarray:
    """Gaussian means where the whole window lies inside, (H - 10, W - 10, C)."""
    at = np.arange(-_HALF, _HALF + 1)
    bell = np.exp(-0.5 * (at / _WIDTH) ** 2)
    bell /= bell.sum()
    for axis in (0, 1):
        size = values.shape[axis] - 2 * _HALF
        values = sum(np.take(values, np.arange(k, k + size), axis) * w for k, w in enumerate(bell))
    return values


def ssim_map(reference: np.ndarray, test: np.ndarray) -> np.ndarray:
    """Structural similarity around each pixel that is at least five from the border; 1 is best.

    Args:
        reference: As it is shown, [0, 1], (H, W, 3), at least 11 pixels high and wide.
        test: The same size.

    Returns:
        (H - 10, W - 10, 3) float64; its mean is the usual score.

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
