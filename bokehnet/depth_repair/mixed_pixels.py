"""Mixed pixels ("flying pixels") of an anti-aliased depth map: values between two surfaces.

If a renderer filters depth like colour, a pixel that an edge crosses stores an average of both surfaces. It
is then blurred like a surface that does not exist, and can even be in focus between a blurred foreground and
a blurred background. Colour may be mixed, depth may not.

Method: ramp detection along four directions. A ramp of at most three pixels between two surfaces, steeper
than both, is replaced by the value of the surface with the larger coverage, computed in the quantity that was
filtered (depth or disparity). Wider ramps do not change. In contrast,
:mod:`bokehnet.classical.layered.depth_discontinuities` measures edges in pixels of blur, which are unknown
for a file, and splits them at the middle of the disparity, which is not the middle of the coverage if depth
was filtered.

In: disparity, relative or 1/mm, (H, W). Out: a map in the same unit.
"""

from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bokehnet.checks import check_choice, check_finite, check_map
from bokehnet.depth_repair.config import (
    MAX_RAMP_PX,
    MIN_COVERAGE_STEP,
    MIN_EDGE_HEIGHT,
    MIN_MIXED_CHANGE,
    MIN_MIXED_EDGE,
    MIN_SLOPE_RATIO,
)
from bokehnet.depth_repair.filters import local_extremes

__all__ = ["mixed_pixel_fraction", "repair_mixed"]

_DIRECTIONS = ((0, 1), (1, 0), (1, 1), (1, -1))


def repair_mixed(disparity: NDArray[np.float32], *, filtered: str = "disparity") -> NDArray[np.float32]:
    """Return the map with each mixed pixel set to the value of the surface that covers more of it.

    A pixel is mixed if, along a row, a column or a diagonal, up to three pixels rise or fall monotonically
    from one surface to another, and every part of this ramp is steeper than the surfaces on both sides.
    Slopes do not change, nor do thin structures, which are nearer or farther than both of their sides.

    Args:
        disparity: Finite map, relative or 1/mm, (H, W), 0 at infinity.
        filtered: Quantity that is linear in coverage: ``"depth"`` if the file stored depth, ``"disparity"``
            if it stored disparity.

    Returns:
        New map, (H, W); each value is the input or a value nearby.

    Raises:
        ShapeError: The map is not (H, W).
        ParameterError: The map is not finite, or ``filtered`` is unknown.
    """
    result = np.array(disparity, np.float32)
    rows, columns, mixed, value = _detect(disparity, filtered)
    result[rows[mixed], columns[mixed]] = value[mixed]
    return result


def mixed_pixel_fraction(disparity: NDArray[np.float32], *, filtered: str = "disparity") -> float:
    """Return the fraction of mixed pixels among those at clear depth edges, 0 to 1.

    Maps sampled at pixel centres have about 0.01, filtered maps 0.2 and more; 0.05 separates them.

    Args:
        disparity: Finite map, relative or 1/mm, (H, W), 0 at infinity.
        filtered: Quantity that is linear in coverage, as for :func:`repair_mixed`.
    """
    rows, columns, mixed, _ = _detect(disparity, filtered)
    ranges = _span(np.asarray(disparity, np.float64))[rows, columns]
    clear = ranges > MIN_EDGE_HEIGHT * float(np.ptp(disparity))
    return float(mixed[clear].mean()) if clear.any() else 0.0


def _detect(
    disparity: NDArray[np.float32], filtered: str
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.bool_], NDArray[Any]]:
    """Return rows and columns of pixels at edges, a mask of the mixed ones, and their corrected values."""
    check_map("disparity", disparity)
    check_finite("disparity", disparity)
    check_choice("filtered", filtered, ("disparity", "depth"))
    values = np.asarray(disparity, np.float64)
    min_height = MIN_MIXED_EDGE * float(np.ptp(values))
    rows, columns = np.nonzero(_span(values) > min_height)
    corrected = np.zeros(rows.size)
    ramp_length = np.full(rows.size, np.inf)  # pixels between the surfaces on the shortest ramp so far
    pairs = [(i, j) for i, j in product(range(1, MAX_RAMP_PX + 1), repeat=2) if i + j <= MAX_RAMP_PX + 1]
    for (dy, dx), (i, j) in product(_DIRECTIONS, sorted(pairs, key=sum)):
        distance = (i + j) * np.hypot(dy, dx)
        candidates = np.flatnonzero(ramp_length > distance)
        line = _lines_through(values, rows[candidates], columns[candidates], (dy, dx), (i + 1, j + 1))
        mixed, value = _classify(line, i + 1, min_height, filtered)
        corrected[candidates[mixed]] = value[mixed]
        ramp_length[candidates[mixed]] = distance
    return rows, columns, np.isfinite(ramp_length), corrected


def _span(values: NDArray[Any]) -> NDArray[Any]:
    """Return the range of values in the 3x3 window of each pixel."""
    low, high = local_extremes(values, 1)
    return high - low


def _lines_through(
    values: NDArray[Any],
    rows: NDArray[np.intp],
    columns: NDArray[np.intp],
    direction: tuple[int, int],
    reach: tuple[int, int],
) -> NDArray[Any]:
    """Return the values on a line through each pixel, (pixels, 1 + both reaches); the border is repeated."""
    steps = np.arange(-reach[0], reach[1] + 1)
    height, width = values.shape
    return values[
        np.clip(rows[:, None] + direction[0] * steps, 0, height - 1),
        np.clip(columns[:, None] + direction[1] * steps, 0, width - 1),
    ]


def _classify(
    line: NDArray[Any], centre: int, min_height: float, filtered: str
) -> tuple[NDArray[np.bool_], NDArray[Any]]:
    """Return which pixels are mixed, and the value of the surface that covers more of each.

    The first two and the last two values of each line are the surfaces on both sides; the values between are
    the ramp with the pixel at index ``centre``.
    """
    first, last = line[:, 1], line[:, -2]
    slopes = np.diff(line, axis=1)  # slopes of the ramp, and of the surfaces at both ends
    surface_slope = np.maximum(np.abs(slopes[:, 0]), np.abs(slopes[:, -1]))
    steep = np.abs(slopes[:, 1:-1]).min(axis=1) > MIN_SLOPE_RATIO * surface_slope
    # The lower bound avoids infinite depth at disparity 0.
    linear = 1 / np.maximum(line, 1e-30) if filtered == "depth" else line
    with np.errstate(divide="ignore", invalid="ignore"):  # both surfaces are equal
        coverage = (linear - linear[:, -2:-1]) / (linear[:, 1:2] - linear[:, -2:-1])  # from 1 to 0
        falling = (np.diff(coverage[:, 1:-1], axis=1) < -MIN_COVERAGE_STEP).all(axis=1)
    height = np.abs(first - last)
    surface = np.where(coverage[:, centre] > 0.5, first, last)
    differs = np.abs(line[:, centre] - surface) > MIN_MIXED_CHANGE * height
    return steep & falling & differs & (height > min_height), surface
