"""Pictures at a multiple of their size brought back to it through the pixel filter of a renderer."""

import numpy as np
import numpy.typing as npt

__all__ = ["fine_weights", "reduce_fine"]

# Terms of the Blackman-Harris window.
_TERMS = (0.35875, -0.48829, 0.14128, -0.01168)

# Pixels that the filter is wide.
_WIDTH = 3


def fine_weights(factor: int) -> npt.NDArray[np.float64]:
    """Weights of the fine pixels along one side that a pixel is made of, (3 factor,), with a sum of 1.

    A Blackman-Harris filter three pixels wide, as that of Cycles at its default width.

    Source:
        Harris, "On the use of windows for harmonic analysis with the discrete Fourier transform", 1978.
    """
    place = 2 * np.pi * (np.arange(_WIDTH * factor) + 0.5) / (_WIDTH * factor)
    found: npt.NDArray[np.float64] = np.stack(
        [term * np.cos(i * place) for i, term in enumerate(_TERMS)]
    ).sum(0)
    return found / found.sum()


def reduce_fine(values: npt.NDArray[np.float32], factor: int) -> npt.NDArray[np.float32]:
    """Filter an array (factor H, factor W, ...) down to (H, W, ...).

    Beyond the border nothing is counted: what a filter finds there is given to what lies inside.

    Examples:
        >>> reduce_fine(np.ones((4, 6), np.float32), 2).tolist()
        [[1.0, 1.0, 1.0], [1.0, 1.0, 1.0]]
    """
    return _along_columns(_along_rows(values, factor), factor)


def _along_columns(values: npt.NDArray[np.float32], factor: int) -> npt.NDArray[np.float32]:
    return np.ascontiguousarray(_along_rows(values.swapaxes(0, 1), factor).swapaxes(0, 1))


def _along_rows(values: npt.NDArray[np.float32], factor: int) -> npt.NDArray[np.float32]:
    size = len(values) // factor
    result = np.zeros((size, *values.shape[1:]), np.float32)
    total = np.zeros(size, np.float32)
    for i, weight in enumerate(fine_weights(factor).astype(np.float32)):
        offset = i - factor  # from a pixel's first fine row
        first = max(0, -(offset // factor))
        last = min(size, (len(values) - 1 - offset) // factor + 1)
        rows = slice(first * factor + offset, (last - 1) * factor + offset + 1, factor)
        if first < last:
            result[first:last] += weight * values[rows]
            total[first:last] += weight
    result /= total.reshape(-1, *(1,) * (values.ndim - 1))
    return result
