"""Convolution of pictures with large kernels."""

import numpy as np

__all__ = ["convolve"]


def _smooth(size: int) -> int:
    """The smallest number from ``size`` on without factors above 5, for which transforms are fast."""
    while True:
        rest = size
        for prime in (2, 3, 5):
            while rest % prime == 0:
                rest //= prime
        if rest == 1:
            return size
        size += 1


def convolve(image: np.ndarray, kernel: np.ndarray) -> np.ndarray:
    """Spread each pixel of (H, W, C) by a kernel (m, n, C) or (m, n), sides odd; what leaves is lost.

    Returns:
        (H, W, C), the precision of ``image``.
    """
    height, width, channels = image.shape
    kernel = kernel[_reached(kernel.shape[0], height), _reached(kernel.shape[1], width)]
    above, left = (size // 2 for size in kernel.shape[:2])
    # What goes round the end of so long a transform falls on rows and columns that are cut away.
    size = _smooth(height + above), _smooth(width + left)
    planes = np.moveaxis(kernel.reshape(*kernel.shape[:2], -1), -1, 0)
    spectra = [np.fft.rfft2(plane, size) for plane in planes]
    result = np.empty_like(image)
    for channel in range(channels):
        spectrum = np.fft.rfft2(image[..., channel], size)
        spectrum *= spectra[channel % len(spectra)]
        spread = np.fft.irfft2(spectrum, size)
        result[..., channel] = spread[above : above + height, left : left + width]
    return result


def _reached(kernel: int, size: int) -> slice:
    """The part of one side of a kernel that joins two pixels of a picture."""
    beyond = max(0, kernel // 2 - (size - 1))
    return slice(beyond, kernel - beyond)
