"""Spread every pixel over its disc, and the adjoint: the doors of :mod:`bokehnet.classical.kernels`."""

import numpy as np

from bokehnet.classical.disc import disc_table
from bokehnet.classical.kernels import BAND_ROWS, LARGEST_RADIUS, gather_discs, spread_discs, sum_from_end
from bokehnet.classical.parallel import parallel_region

__all__ = ["BAND_ROWS", "LARGEST_RADIUS", "in_fours", "joined", "spread_backward", "spread_forward"]


def in_fours(array: np.ndarray) -> list[np.ndarray]:
    """Cut the channels into groups of four, which kernels take; the last one is filled up with zeros."""
    if array.shape[2] == 4:
        return [np.ascontiguousarray(array)]
    missing = -array.shape[2] % 4
    filled = np.pad(array, ((0, 0), (0, 0), (0, missing)))
    return [np.ascontiguousarray(part) for part in np.split(filled, filled.shape[2] // 4, axis=2)]


def joined(groups: list[np.ndarray], channels: int) -> np.ndarray:
    """Undo :func:`in_fours`."""
    return groups[0] if channels == 4 else np.ascontiguousarray(np.concatenate(groups, 2)[..., :channels])


def spread_forward(values: np.ndarray, defocus: np.ndarray) -> np.ndarray:
    """Spread every pixel over its disc and add up; linear in ``values``.

    Args:
        values: What each pixel spreads, (H, W, C), float32 or float64; a channel of ones gives the
            weights to divide by. Four channels are the fastest. A pixel of zeros costs nothing.
        defocus: Blur radius in pixels, (H, W); only its magnitude matters. Up to 1/2 a pixel keeps what
            it has.

    Returns:
        Sums (H, W, C) of the values' dtype. What a pixel spreads adds up to its value, whatever its
        radius, as far as it falls into the picture.
    """
    sums = []
    for group in in_fours(values):
        sums.append(np.empty_like(group))
        with parallel_region:
            spread_discs(group, np.ascontiguousarray(defocus), disc_table(), sums[-1])
    return joined(sums, values.shape[2])


def spread_backward(
    values: np.ndarray, defocus: np.ndarray, grad_sums: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Adjoint of :func:`spread_forward`, at the same order of cost.

    Args:
        values: As given to the forward, (H, W, C).
        defocus: Likewise, (H, W).
        grad_sums: Gradient for the sums, (H, W, C).

    Returns:
        Gradients for the values (H, W, C) and the defocus (H, W). The latter is 0 where the magnitude is
        up to 1/2 or above ``LARGEST_RADIUS``.
    """
    defocus = np.ascontiguousarray(defocus)
    grad_values, grad_defocus = [], np.zeros_like(defocus)
    for group, gradient in zip(in_fours(values), in_fours(grad_sums), strict=True):
        grad_values.append(np.empty_like(group))
        with parallel_region:
            rests = sum_from_end(gradient)
            gather_discs(group, defocus, disc_table(), gradient, rests, grad_values[-1], grad_defocus)
    return joined(grad_values, values.shape[2]), grad_defocus
