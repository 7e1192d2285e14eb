"""Convolution of pictures with large kernels."""

import numpy as np

__all__ = ["convolve"]


def _fast_size(size: int) -> int:
    """Return the smallest number from ``size`` on without prime factors above 5, for fast transforms."""
    while True:
        rest = size
        for prime in (2, 3, 5):
            while rest % prime == 0:
                rest //= prime
        if rest == 1:
            return size
        size += 1


def convolve(image: np.ndarray, kernel: np.ndarray) -> np.ndarray:
    """Convolve (H, W, C) with a kernel (m, n, C) or (m, n), sides odd; light beyond the border is lost.

    Returns:
        (H, W, C), the precision of ``image``.
    """
    height, width, channels = image.shape
    kernel = kernel[_effective_range(kernel.shape[0], height), _effective_range(kernel.shape[1], width)]
    above, left = (size // 2 for size in kernel.shape[:2])
    # The transform is so long that values wrap around only to rows and columns that are cropped.
    size = _fast_size(height + above), _fast_size(width + left)
    planes = np.moveaxis(kernel.reshape(*kernel.shape[:2], -1), -1, 0)
    spectra = [np.fft.rfft2(plane, size) for plane in planes]
    result = np.empty_like(image)
    for channel in range(channels):
        spectrum = np.fft.rfft2(image[..., channel], size)
        spectrum *= spectra[channel % len(spectra)]
        spread = np.fft.irfft2(spectrum, size)
        result[..., channel] = spread[above : above + height, left : left + width]
    return result


def _effective_range(kernel: int, size: int) -> slice:
    """Return the part of one side of a kernel that connects two pixels of a picture."""
    beyond = max(0, kernel // 2 - (size - 1))
    return slice(beyond, kernel - beyond)
