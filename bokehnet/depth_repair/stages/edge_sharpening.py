"""Soft steps of a map made sharp: each value goes to the nearer one of the extremes around it."""

import numpy as np

from bokehnet.arrays.row_blocks import cut_row_blocks, make_in_row_blocks

__all__ = [
    "SHARPENED",
    "SLOPE_HALO",
    "SOFT",
    "STEP",
    "extremes",
    "on_slopes",
    "repair_soft_edges",
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

# Pixels around one on which depends what it becomes when soft steps are made sharp.
SHARPENED = sum(_RADII)

# A slope goes on: from pixels this far to either side to those at thrice that way it rises as much again, all
# differences together within this share. Gaussians wider than 6 pixels and ramps longer than 13 pass for
# slopes.
_STRIDE, _UNEVEN = 3, 0.75
SLOPE_HALO = 3 * _STRIDE


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


def on_slopes(disparity: np.ndarray, where: np.ndarray) -> np.ndarray:
    """Which of some pixels of a map stand on slopes: surfaces that lean towards the camera.

    Args:
        disparity: (H, W), any unit.
        where: The pixels, (H, W) bool.

    Returns:
        (H, W) bool.
    """
    rows, columns = np.nonzero(where)
    # Slopes go on beyond the border.
    padded = np.pad(disparity, SLOPE_HALO, "reflect", reflect_type="odd")
    uneven, rise = np.zeros(len(rows), np.float32), np.zeros(len(rows), np.float32)
    for axis in (0, 1):
        line = []
        for away in (0, 2, 4, 6):
            shift = [SLOPE_HALO, SLOPE_HALO]
            shift[axis] = away * _STRIDE
            line.append(padded[rows + shift[0], columns + shift[1]])
        before, here, after = np.diff(line, axis=0)
        uneven += np.abs(here - before) + np.abs(here - after)
        rise += np.abs(here)
    found = np.zeros(disparity.shape, bool)
    found[rows, columns] = uneven < _UNEVEN * rise
    return found


def soft_edge_fraction(disparity: np.ndarray, by_size: bool = True) -> float:
    """How much of the steps stands between their two sides: 0 = all are sharp.

    Args:
        disparity: (H, W), any unit.
        by_size: Whether pixels count by the square of their step, or else what is round or leans would say of
            a map with few steps that it is soft: blur spares none of them. If all count alike, noise that is
            as high as steps makes a map soft, too.
    """
    span = float(np.ptp(disparity))
    soft, all_steps = 0.0, 0.0
    for rows in cut_row_blocks(disparity.shape):
        window, inner = with_halo(rows, SLOPE_HALO)
        values = disparity[window]
        low, high = extremes(values, 2)
        steps = high - low > STEP * span
        between = steps & (np.minimum(high - values, values - low) > _BETWEEN * (high - low))
        slopes = on_slopes(values, between)
        power = 2 if by_size else 0
        weights = np.where(steps & ~slopes, ((high - low) / (span or 1)) ** power, 0)[inner]
        soft += float(weights[between[inner]].sum(dtype=float))
        all_steps += float(weights.sum(dtype=float))
    return soft / all_steps if all_steps else 0.0


def repair_soft_edges(disparity: np.ndarray, span: float | None = None) -> np.ndarray:
    """Return the map (H, W) with soft steps made sharp where they pass the middle between both sides.

    Slopes stay as they are.

    Args:
        disparity: (H, W), any unit.
        span: Of the values that steps are held against; by default the map's.

    Source:
        Kramer and Bruckner, "Iterations of a non-linear transformation for enhancement of digital images",
        Pattern Recognition 1975.
    """
    least = STEP * (np.ptp(disparity) if span is None else span)

    def make(rows: slice) -> np.ndarray:
        window, inner = with_halo(rows, SLOPE_HALO + SHARPENED)
        sharp = values = disparity[window]
        for radius in _RADII:
            low, high = extremes(sharp, radius)
            nearer = np.where(high - sharp < sharp - low, high, low)
            changed = (high - low > least) & (nearer != sharp)
            sharp = np.where(changed & ~on_slopes(values, changed), nearer, sharp)
        return sharp[inner]

    return make_in_row_blocks(make, disparity.shape, np.float32)
