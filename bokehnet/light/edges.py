"""Edges of clipped light towards the dark: how sharp they are, and what they say about its radiance."""

import numpy as np

from bokehnet.light.bright_picture import Array, Floats, Indices

__all__ = ["DARK_SIDE_PX", "edge_pixels", "sharpness"]

# Pixels from an edge to its dark side.
DARK_SIDE_PX = 4


def edge_pixels(values: Array, level: float, rows: Indices, columns: Indices, dark: float) -> Indices:
    """Return the unclipped neighbours of clipped pixels at edges towards the dark.

    Args:
        values: Light of each pixel, (H, W).
        level: Clip level.
        rows: Rows of clipped pixels, (N,).
        columns: Their columns, (N,).
        dark: Light up to which the pixel four steps away counts as dark.

    Returns:
        Index of the clipped pixel, row and column of its neighbour, and those one step further, (5, pairs).
    """
    height, width = values.shape
    pairs = []
    for down in (-1, 0, 1):
        for right in (-1, 0, 1):
            far_rows, far_columns = rows + DARK_SIDE_PX * down, columns + DARK_SIDE_PX * right
            inside = (far_rows >= 0) & (far_rows < height) & (far_columns >= 0) & (far_columns < width)
            index = np.flatnonzero(inside)
            index = index[values[rows[index] + down, columns[index] + right] < level]
            index = index[values[far_rows[index], far_columns[index]] < dark]
            y, x = rows[index] + down, columns[index] + right
            pairs.append(np.stack([index, y, x, y + down, x + right]))
    return np.concatenate(pairs, axis=1)


def sharpness(edge_light: Floats) -> float:
    """Return half the inverse of the mean light of unclipped edge pixels, relative to the clip level.

    Light of radiance F that covers a fraction a of a pixel clips it if a > 1 / F. With a uniform in [0, 1],
    the unclipped pixels of an edge hold 1 / (2 F) of light on average over all pixels of the edge: the mean
    falls with F. Matter just at the clip level gives 1 / 2; a wide point spread function raises the mean.
    """
    return 0.5 * max(len(edge_light), 1) / max(float(edge_light.sum()), 0.5)
