"""Soft steps of a map made sharp: each value goes to the nearer one of the extremes around it."""

import numpy as np

from bokehnet.io.row_blocks import cut_row_blocks, make_in_row_blocks

__all__ = [
    "SOFT",
    "STEP",
    "extremes",
    "repair_soft_edges",
    "sharpen_if_soft",
    "soft_edge_fraction",
    "with_halo",
]

# A span of the map's values, as a share of the whole map's, that makes a step.
STEP = 0.05

# Between the extremes, in shares of the step, from which on a pixel stands on a slope of it.
_BETWEEN = 0.2

# Share of soft steps from which on all are sharpened before a network sees the map.
SOFT = 0.3

# Half widths of the windows, one after the other; together they turn ramps of ten pixels into steps.
_RADII = (3, 2)


def extremes(values: np.ndarray, radius: int) -> tuple[np.ndarray, np.ndarray]:
    """Smallest and largest value of the square window around each pixel, the border repeated."""
    low, high = (_over_windows(values, radius, choose) for choose in (np.minimum, np.maximum))
    return low, high


def _over_windows(values: np.ndarray, radius: int, choose: np.ufunc) -> np.ndarray:
    """Reduce the square window around each pixel, along rows, then columns; windows grow by doubling."""
    found = values
    for axis in (0, 1):
        padding = [(radius, radius) if a == axis else (0, 0) for a in (0, 1)]
        lines = np.moveaxis(np.pad(found, padding, "edge"), axis, 0)
        size, whole = 1, 2 * radius + 1
        while size < whole:
            step = min(size, whole - size)
            lines = choose(lines[: len(lines) - step], lines[step:])
            size += step
        found = np.moveaxis(lines, 0, axis)
    return found


def with_halo(rows: slice, halo: int) -> tuple[slice, slice]:
    """Rows with as many more on either side as there are, and where the rows are in them."""
    top = max(0, rows.start - halo)
    return slice(top, rows.stop + halo), slice(rows.start - top, rows.stop - top)


def soft_edge_fraction(disparity: np.ndarray) -> float:
    """How many of the pixels at steps stand between the two sides: 0 = all steps are sharp.

    Args:
        disparity: (H, W), any unit.
    """
    least, soft, all_steps = STEP * np.ptp(disparity), 0, 0
    for rows in cut_row_blocks(disparity.shape):
        window, inner = with_halo(rows, 2)
        low, high = (x[inner] for x in extremes(disparity[window], 2))
        width, own = high - low, disparity[rows]
        steps = width > least
        between = np.minimum(high - own, own - low) > _BETWEEN * width
        soft, all_steps = soft + int((steps & between).sum()), all_steps + int(steps.sum())
    return soft / max(all_steps, 1)


def repair_soft_edges(disparity: np.ndarray, span: float | None = None) -> np.ndarray:
    """Return the map (H, W) with soft steps made sharp where they pass the middle between both sides.

    Args:
        disparity: (H, W), any unit.
        span: Of the values that steps are held against; by default the map's.

    Source:
        Kramer and Bruckner, "Iterations of a non-linear transformation for enhancement of digital images",
        Pattern Recognition 1975.
    """
    least = STEP * (np.ptp(disparity) if span is None else span)

    def make(rows: slice) -> np.ndarray:
        window, inner = with_halo(rows, sum(_RADII))
        sharp = disparity[window]
        for radius in _RADII:
            low, high = extremes(sharp, radius)
            nearer = np.where(high - sharp < sharp - low, high, low)
            sharp = np.where(high - low > least, nearer, sharp)
        return sharp[inner]

    return make_in_row_blocks(make, disparity.shape, np.float32)


def sharpen_if_soft(disparity: np.ndarray, fraction: float) -> np.ndarray:
    """The map itself, or where many of its steps are soft, with all of them sharp.

    Args:
        disparity: (H, W), any unit.
        fraction: From :func:`soft_edge_fraction`.
    """
    return repair_soft_edges(disparity) if fraction > SOFT else disparity
