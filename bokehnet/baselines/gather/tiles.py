"""Tiles of a defocus map: nearest defocus and maximum blur of each tile and its neighbours."""

import math

import numpy as np

__all__ = ["dilated_tiles"]


def dilated_tiles(defocus: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Return nearest defocus and maximum blur radius of each tile and of all tiles within reach of blur.

    The published 3x3 tiles suffice while no blur exceeds a tile; this function dilates as often as needed.

    Args:
        defocus: Signed blur radius, (H, W), + in front of focus.
        size: Side of a tile, pixels.

    Returns:
        Two maps with one value per tile, (ceil(H / size), ceil(W / size)).
    """
    height, width = defocus.shape
    rows, columns = -(-height // size), -(-width // size)
    padded = np.pad(defocus, ((0, rows * size - height), (0, columns * size - width)), mode="edge")
    parts = padded.reshape(rows, size, columns, size)
    nearest, largest = parts.max(axis=(1, 3)), np.abs(parts).max(axis=(1, 3))
    for _ in range(max(1, math.ceil(float(largest.max()) / size))):
        nearest, largest = (_largest_of_nine(values) for values in (nearest, largest))
    return nearest, largest


def _largest_of_nine(values: np.ndarray) -> np.ndarray:
    rows, columns = values.shape
    padded = np.pad(values, 1, mode="edge")
    windows = [padded[i : i + rows, j : j + columns] for i in range(3) for j in range(3)]
    return np.asarray(np.max(windows, axis=0))
