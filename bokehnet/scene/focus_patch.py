"""Disparity of the surface under one pixel: robust to holes and noise of the map."""

import math

import numpy as np
import numpy.typing as npt

from bokehnet.io.color.srgb import linear_to_srgb

__all__ = ["surface_disparity"]

Array = npt.NDArray[np.float32]

# Radius of the patch in pixels, and relative to the longer side of the map: networks and depth cameras store
# maps of fewer pixels than the picture, so that one wrong value covers several pixels.
_MIN_RADIUS_PX, _RELATIVE_RADIUS = 5, 1 / 200

# Disparities of one surface differ between neighbours by at most this fraction of the map's range, or this
# many times the median difference of neighbours in the patch.
_MAX_STEP, _NOISE_STEPS = 0.02, 4.0

# Islands inside the patch of at most this fraction of its area count as holes, unless their colour differs.
_MAX_HOLE_AREA = 0.25

# Islands of at least this length that are four times as long as wide are things such as twigs.
_MIN_LINE_PX = 5

# Standard deviation of colours of one surface, sRGB. An island's colour differs if its nearest colours around
# are farther than this, plus this many times the distance of the nearest colours among those around it.
_COLOR_SIGMA, _MAX_COLOR_RATIO, _MAX_COLORS = 0.05, 2.0, 256


def surface_disparity(values: Array, column: int, row: int, image: Array | None = None) -> float:
    """Return the disparity of the surface under a pixel: the median of a patch of that surface.

    The surface is the connected area around the pixel without a step of disparity. The median runs over
    pairs of its pixels opposite each other, so that a slope does not shift it. An island of other
    disparity than the patch around it is a hole of the map, unless the picture shows it in another colour:
    then the surface is the one around it, with weights for pixels of similar colour.

    Args:
        values: Disparity map (H, W), finite, any unit.
        column: Column of the pixel in the map.
        row: Row of the pixel in the map.
        image: Scene-linear picture, (H, W, 3); None decides by the map alone.

    Returns:
        Disparity in the unit of the map.

    Examples:
        >>> values = np.full((40, 60), 0.8, np.float32)
        >>> values[:, :20] = 0.2
        >>> values[20, 30] = 0.1  # a hole
        >>> round(surface_disparity(values, 30, 20), 3), round(surface_disparity(values, 19, 20), 3)
        (0.8, 0.2)
    """
    height, width = values.shape
    radius = max(_MIN_RADIUS_PX, round(max(height, width) * _RELATIVE_RADIUS))
    rows = slice(max(0, row - radius), min(height, row + radius + 1))
    columns = slice(max(0, column - radius), min(width, column + radius + 1))
    patch = values[rows, columns].astype(np.float64)
    y, x = row - rows.start, column - columns.start
    step = max(_MAX_STEP * float(np.ptp(values)), _NOISE_STEPS * _neighbour_difference(patch))
    surface = _connected(patch, y, x, step)
    colors = None if image is None else _encoded(image[rows, columns])
    open_sides = (rows.start > 0, rows.stop < height, columns.start > 0, columns.stop < width)
    if _is_hole(surface, colors, open_sides):
        return _surrounding_disparity(patch, ~surface, y, x, colors)
    similar = surface & (np.abs(patch - patch[y, x]) <= step)
    return float(np.median(patch[_paired(similar, y, x)]))


def _neighbour_difference(patch: npt.NDArray[np.float64]) -> float:
    """Return the median absolute difference of horizontal and vertical neighbours."""
    differences = np.concatenate([np.abs(np.diff(patch, axis=axis)).ravel() for axis in (0, 1)])
    return float(np.median(differences)) if differences.size else 0.0


def _connected(patch: npt.NDArray[np.float64], y: int, x: int, step: float) -> npt.NDArray[np.bool_]:
    """Return the pixels that neighbours without a larger step connect to a pixel, 8-connected."""
    reached = np.zeros(patch.shape, bool)
    reached[y, x] = True
    stack = [(y, x)]
    while stack:
        a, b = stack.pop()
        for i in range(max(0, a - 1), min(patch.shape[0], a + 2)):
            for j in range(max(0, b - 1), min(patch.shape[1], b + 2)):
                if not reached[i, j] and abs(patch[i, j] - patch[a, b]) <= step:
                    reached[i, j] = True
                    stack.append((i, j))
    return reached


def _is_hole(
    surface: npt.NDArray[np.bool_],
    colors: npt.NDArray[np.float64] | None,
    open_sides: tuple[bool, bool, bool, bool],
) -> bool:
    """Return whether an area is a small island that the colours do not confirm.

    Args:
        surface: Pixels of the area in the patch, (h, w).
        colors: Colours of the patch, (h, w, 3), or None.
        open_sides: True for each side of the patch beyond which the map goes on: top, bottom, left, right.
    """
    area = int(surface.sum())
    if area > _MAX_HOLE_AREA * surface.size:
        return False
    rows, columns = np.nonzero(surface)
    extent = max(np.ptp(rows), np.ptp(columns)) + 1
    thin = extent >= _MIN_LINE_PX and 2 * math.sqrt(area) < extent
    sides = surface[0], surface[-1], surface[:, 0], surface[:, -1]
    goes_on = any(is_open and side.any() for is_open, side in zip(open_sides, sides, strict=True))
    if thin or goes_on:
        return False
    if colors is None:
        return True
    inside, outside = _sample(colors[surface]), _sample(colors[~surface])
    own_spread = float(np.median(_nearest(outside[::2], outside[1::2])))
    return float(np.median(_nearest(inside, outside))) < _COLOR_SIGMA + _MAX_COLOR_RATIO * own_spread


def _sample(colors: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return at most about ``_MAX_COLORS`` of the colours (N, 3), evenly spaced."""
    return colors[:: max(1, len(colors) // _MAX_COLORS)]


def _nearest(colors: npt.NDArray[np.float64], others: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return the distance of each colour (N, 3) to the nearest of other colours (M, 3); (N,)."""
    distance: npt.NDArray[np.float64] = np.linalg.norm(colors[:, None] - others[None], axis=2).min(axis=1)
    return distance


def _surrounding_disparity(
    patch: npt.NDArray[np.float64],
    around: npt.NDArray[np.bool_],
    y: int,
    x: int,
    colors: npt.NDArray[np.float64] | None,
) -> float:
    """Return the median of the pixels around a hole, weighted by distance and similarity of colour."""
    rows, columns = np.nonzero(around)
    distance = np.hypot(rows - y, columns - x)
    weights = np.exp(-0.5 * (distance / max(1.0, float(distance.min()))) ** 2)
    if colors is not None:
        difference = np.linalg.norm(colors[around] - colors[y, x], axis=1)
        weights = weights * np.exp(-0.5 * ((difference - difference.min()) / _COLOR_SIGMA) ** 2)
    values = patch[around]
    order = np.argsort(values, kind="stable")
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, total[-1] / 2)])


def _paired(surface: npt.NDArray[np.bool_], y: int, x: int) -> npt.NDArray[np.bool_]:
    """Return the pixels of a surface whose opposite pixel about (y, x) belongs to it too."""
    rows, columns = np.nonzero(surface)
    opposite_rows, opposite_columns = 2 * y - rows, 2 * x - columns
    inside = (
        (opposite_rows >= 0)
        & (opposite_rows < surface.shape[0])
        & (opposite_columns >= 0)
        & (opposite_columns < surface.shape[1])
    )
    rows, columns = rows[inside], columns[inside]
    both = surface[opposite_rows[inside], opposite_columns[inside]]
    result = np.zeros_like(surface)
    result[rows[both], columns[both]] = True
    return result


def _encoded(image: Array) -> npt.NDArray[np.float64]:
    """Return colours in sRGB, in which equal differences look about equal."""
    return linear_to_srgb(np.clip(np.nan_to_num(image), 0, 1)).astype(np.float64)
