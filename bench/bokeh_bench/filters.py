"""Filters of depth maps: means, medians, maxima, resampling, and filling of holes along rows."""

import numpy as np

__all__ = ["blocks", "box", "dilated", "filled", "median", "resized"]


def _windows(values: np.ndarray, size: int) -> np.ndarray:
    """Return all squares of an odd size, border repeated, (H, W, size, size)."""
    return np.lib.stride_tricks.sliding_window_view(np.pad(values, size // 2, mode="edge"), (size, size))


def box(values: np.ndarray, size: int) -> np.ndarray:
    """Return the mean over a square of an odd size, border repeated."""
    half = size // 2
    padded = np.pad(values, [(half + 1, half), (half + 1, half)], mode="edge").cumsum(0).cumsum(1)
    total = padded[size:, size:] - padded[:-size, size:] - padded[size:, :-size] + padded[:-size, :-size]
    return np.asarray(total / size**2)


def median(values: np.ndarray, size: int) -> np.ndarray:
    """Return the median over a square of an odd size, border repeated."""
    return np.asarray(np.median(_windows(values, size).reshape(*values.shape, -1), axis=-1))


def dilated(values: np.ndarray, size: int) -> np.ndarray:
    """Return the maximum over a square of an odd size."""
    for _ in range(2):
        padded = np.pad(values, [(size // 2, size // 2), (0, 0)], mode="edge")
        values = np.lib.stride_tricks.sliding_window_view(padded, size, axis=0).max(-1).T
    return values


def resized(values: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Return (h, w) interpolated linearly to another size, centres aligned, border repeated."""
    result = np.asarray(values, np.float64)
    for axis in range(2):
        count = result.shape[axis]
        position = np.clip((np.arange(shape[axis]) + 0.5) * count / shape[axis] - 0.5, 0, count - 1)
        low = np.minimum(position.astype(int), max(count - 2, 0))
        part = (position - low).reshape((-1, 1) if axis == 0 else (1, -1))
        upper = np.take(result, np.minimum(low + 1, count - 1), axis)
        result = np.take(result, low, axis) * (1 - part) + upper * part
    return result


def blocks(values: np.ndarray, factor: int) -> np.ndarray:
    """Return the mean of blocks, (H / factor, W / factor, ...)."""
    height, width = values.shape[0] // factor, values.shape[1] // factor
    return np.asarray(values.reshape(height, factor, width, factor, *values.shape[2:]).mean((1, 3)))


def filled(values: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Return values with holes filled by the smaller of the valid neighbours left and right."""
    result = values.copy()
    columns = np.arange(values.shape[1])
    for row, known in zip(result, valid, strict=True):
        if not known.any():
            continue
        left = np.maximum.accumulate(np.where(known, columns, -1))
        right = np.minimum.accumulate(np.where(known, columns, len(columns))[::-1])[::-1]
        from_left = np.where(left >= 0, row[np.maximum(left, 0)], np.inf)
        from_right = np.where(right < len(columns), row[np.minimum(right, len(columns) - 1)], np.inf)
        row[~known] = np.minimum(from_left, from_right)[~known]
    return result
