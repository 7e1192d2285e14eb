"""Sharpening of soft depth edges: each value becomes the nearer of the extremes in its window.

Method: the toggle mapping of Kramer and Bruckner, "Iterations of a non-linear transformation for enhancement
    of
digital images", Pattern Recognition 1975, in two passes. Slopes, such as the ground, are excluded: a pixel
lies on a slope if the map continues on both sides with the same gradient.

In: a map (H, W), any unit. Out: the map with sharp edges, in the same unit.
"""

import numpy as np

from bokehnet.arrays.row_blocks import cut_row_blocks, make_in_row_blocks

__all__ = [
    "MIN_EDGE_HEIGHT",
    "SHARPENING_HALO_PX",
    "SLOPE_HALO_PX",
    "SOFT_FRACTION",
    "extend_rows",
    "local_extremes",
    "repair_soft_edges",
    "slope_mask",
    "soft_edge_fraction",
]

# Minimum height of a depth edge, as a fraction of the range of the map.
MIN_EDGE_HEIGHT = 0.05

# Minimum distance of a soft pixel from both extremes, as a fraction of the edge height.
_MIN_DISTANCE_FROM_EXTREMES = 0.2

# Fraction of soft edges above which all edges are sharpened before the network runs.
SOFT_FRACTION = 0.3

# Half widths of the windows in each pass, pixels; together they sharpen ramps of ten pixels.
_RADII_PX = (3, 2)

# Halo of the sharpening, pixels.
SHARPENING_HALO_PX = sum(_RADII_PX)

# Slope test: the rise over this stride (pixels) at a pixel must continue on both sides, with a sum of
# differences below this fraction of the rise. Gaussians wider than 6 pixels and ramps longer than 13 pixels
# pass as slopes.
_SLOPE_STRIDE_PX, _MAX_SLOPE_CHANGE = 3, 0.75
SLOPE_HALO_PX = 3 * _SLOPE_STRIDE_PX


def local_extremes(values: np.ndarray, radius: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the smallest and the largest value of the square window around each pixel.

    Args:
        values: Array, (H, W); its border is repeated.
        radius: Half width of the window, pixels.
    """
    low, high = (_reduce_windows(values, radius, reduce) for reduce in (np.minimum, np.maximum))
    return low, high


def _reduce_windows(values: np.ndarray, radius: int, reduce: np.ufunc) -> np.ndarray:
    """Reduce the square window around each pixel, one axis after the other; windows grow by doubling."""
    result = values
    for axis in (0, 1):
        padding = [(radius, radius) if a == axis else (0, 0) for a in (0, 1)]
        lines = np.moveaxis(np.pad(result, padding, "edge"), axis, 0)
        size, full_size = 1, 2 * radius + 1
        while size < full_size:
            step = min(size, full_size - size)
            lines = reduce(lines[: len(lines) - step], lines[step:])
            size += step
        result = np.moveaxis(lines, 0, axis)
    return result


def extend_rows(rows: slice, halo: int) -> tuple[slice, slice]:
    """Return rows extended by ``halo`` rows on both sides, clipped at the top, and the rows inside these."""
    top = max(0, rows.start - halo)
    return slice(top, rows.stop + halo), slice(rows.start - top, rows.stop - top)


def slope_mask(disparity: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Return which of some pixels lie on slopes: surfaces inclined to the image plane.

    Args:
        disparity: Map, (H, W), any unit.
        mask: Pixels to test, (H, W), bool.

    Returns:
        Pixels on slopes, (H, W), bool.
    """
    rows, columns = np.nonzero(mask)
    # Odd reflection continues slopes beyond the border.
    padded = np.pad(disparity, SLOPE_HALO_PX, "reflect", reflect_type="odd")
    change, rise = np.zeros(len(rows), np.float32), np.zeros(len(rows), np.float32)
    for axis in (0, 1):
        line = []
        for position in (0, 2, 4, 6):
            shift = [SLOPE_HALO_PX, SLOPE_HALO_PX]
            shift[axis] = position * _SLOPE_STRIDE_PX
            line.append(padded[rows + shift[0], columns + shift[1]])
        before, rise_at, after = np.diff(line, axis=0)
        change += np.abs(rise_at - before) + np.abs(rise_at - after)
        rise += np.abs(rise_at)
    on_slope = np.zeros(disparity.shape, bool)
    on_slope[rows, columns] = change < _MAX_SLOPE_CHANGE * rise
    return on_slope


def soft_edge_fraction(disparity: np.ndarray, by_size: bool = True) -> float:
    """Return the fraction of edge pixels between both sides of their edge, 0 (all sharp) to 1.

    Args:
        disparity: Map, (H, W), any unit.
        by_size: True to weight pixels by the square of the edge height. Otherwise round and inclined surfaces
            make a map with few edges seem soft, although blur affects all edges, and so does noise that is as
            high as edges.
    """
    span = float(np.ptp(disparity))
    soft, total = 0.0, 0.0
    for rows in cut_row_blocks(disparity.shape):
        window, inner = extend_rows(rows, SLOPE_HALO_PX)
        values = disparity[window]
        low, high = local_extremes(values, 2)
        edges = high - low > MIN_EDGE_HEIGHT * span
        between = edges & (
            np.minimum(high - values, values - low) > _MIN_DISTANCE_FROM_EXTREMES * (high - low)
        )
        slopes = slope_mask(values, between)
        power = 2 if by_size else 0
        weights = np.where(edges & ~slopes, ((high - low) / (span or 1)) ** power, 0)[inner]
        soft += float(weights[between[inner]].sum(dtype=float))
        total += float(weights.sum(dtype=float))
    return soft / total if total else 0.0


def repair_soft_edges(disparity: np.ndarray, span: float | None = None) -> np.ndarray:
    """Return the map with soft edges made sharp at the middle between both sides, (H, W).

    Slopes do not change.

    Args:
        disparity: Map, (H, W), any unit.
        span: Range of values that defines the minimum edge height; default: the range of the map.

    Source:
        Kramer and Bruckner, "Iterations of a non-linear transformation for enhancement of digital images",
        Pattern Recognition 1975.
    """
    min_height = MIN_EDGE_HEIGHT * (np.ptp(disparity) if span is None else span)

    def make(rows: slice) -> np.ndarray:
        window, inner = extend_rows(rows, SLOPE_HALO_PX + SHARPENING_HALO_PX)
        sharp = values = disparity[window]
        for radius in _RADII_PX:
            low, high = local_extremes(sharp, radius)
            nearer = np.where(high - sharp < sharp - low, high, low)
            changed = (high - low > min_height) & (nearer != sharp)
            sharp = np.where(changed & ~slope_mask(values, changed), nearer, sharp)
        return sharp[inner]

    return make_in_row_blocks(make, disparity.shape, np.float32)
