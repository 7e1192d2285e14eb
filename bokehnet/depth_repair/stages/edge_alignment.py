"""Steps of an enlarged disparity map put where the larger picture has its edges."""

import math

import numpy as np
from numba import prange

from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit

__all__ = ["align_steps"]

# Half the width of the window beside a step in which a pixel may change sides: as much as doubling a map
# leaves open.
_REACH = 2

# Half the width of the window that tells the colours of both sides.
_WINDOW = 6

# Mean evidence of a pixel and its neighbours, -1 to 1, below which it stays on its side.
_SURE = 0.2

# Rows worked at a time, so that the evidence stays small.
_ROWS = 512


@njit(cache=True)
def _extremes(disparity, y, x):  # type: ignore[no-untyped-def]
    """Lowest and highest value in the window beside a step."""
    low = high = disparity[y, x]
    for v in range(max(0, y - _REACH), min(disparity.shape[0], y + _REACH + 1)):
        for u in range(max(0, x - _REACH), min(disparity.shape[1], x + _REACH + 1)):
            low, high = min(low, disparity[v, u]), max(high, disparity[v, u])
    return low, high


@njit(cache=True)
def _beside_step(disparity, y, x, middle):  # type: ignore[no-untyped-def]
    """Whether one of the four neighbours lies on the other side of ``middle``: such pixels may be mixed."""
    near = disparity[y, x] > middle
    return (
        (y > 0 and (disparity[y - 1, x] > middle) != near)
        or (y + 1 < disparity.shape[0] and (disparity[y + 1, x] > middle) != near)
        or (x > 0 and (disparity[y, x - 1] > middle) != near)
        or (x + 1 < disparity.shape[1] and (disparity[y, x + 1] > middle) != near)
    )


@njit(cache=True, parallel=True)
def _weigh(image, disparity, least, first, evidence):  # type: ignore[no-untyped-def]
    """Fill ``evidence`` of the rows from ``first`` on: 1 for the colour of the near side, -1 for the far."""
    height, width = disparity.shape
    for row in prange(evidence.shape[0]):
        y = first + row
        sums = np.empty((2, 4))
        for x in range(width):
            evidence[row, x] = 0.0
            low, high = _extremes(disparity, y, x)
            if high - low <= least:
                continue
            middle = 0.5 * (low + high)
            sums[:] = 0.0
            for v in range(max(0, y - _WINDOW), min(height, y + _WINDOW + 1)):
                for u in range(max(0, x - _WINDOW), min(width, x + _WINDOW + 1)):
                    if not _beside_step(disparity, v, u, middle):
                        side = 1 if disparity[v, u] > middle else 0
                        for c in range(3):
                            sums[side, c] += math.sqrt(image[v, u, c])
                        sums[side, 3] += 1.0
            if sums[0, 3] == 0.0 or sums[1, 3] == 0.0:
                continue
            far = near = 1e-6
            for c in range(3):
                own = math.sqrt(image[y, x, c])
                far += (own - sums[0, c] / sums[0, 3]) ** 2
                near += (own - sums[1, c] / sums[1, 3]) ** 2
            evidence[row, x] = (far - near) / (far + near)


@njit(cache=True, parallel=True)
def _move(disparity, evidence, first, top, bottom, result):  # type: ignore[no-untyped-def]
    """Fill rows ``top`` to ``bottom``: the value of the side that the evidence around a pixel is for."""
    width = disparity.shape[1]
    for y in prange(top, bottom):
        for x in range(width):
            result[y, x] = disparity[y, x]
            if evidence[y - first, x] == 0.0:
                continue
            total, count = 0.0, 0
            for v in range(max(0, y - first - 1), min(evidence.shape[0], y - first + 2)):
                for u in range(max(0, x - 1), min(width, x + 2)):
                    total += evidence[v, u]
                    count += evidence[v, u] != 0.0
            low, high = _extremes(disparity, y, x)
            near = disparity[y, x] > 0.5 * (low + high)
            if near and total < -_SURE * count:
                result[y, x] = low
            elif not near and total > _SURE * count:
                result[y, x] = high


def align_steps(image: np.ndarray, disparity: np.ndarray, least: float) -> np.ndarray:
    """Move steps by up to two pixels to where the picture changes from one side's colour to the other's.

    The colours of both sides are the means over a window, without the pixels at the step itself. Which of
    them a pixel is like is asked of it and of its neighbours together.

    Args:
        image: Scene-linear, 0 or above, (H, W, 3).
        disparity: Its steps are sharp, (H, W).
        least: What counts as a step, in the unit of the map.

    Returns:
        A new map (H, W).

    Source:
        Kopf, Cohen, Lischinski and Uyttendaele, "Joint bilateral upsampling", ACM TOG 2007, for a small
        map brought to the edges of a large picture; the choice between two sides is ours.
    """
    disparity = np.ascontiguousarray(disparity)
    height, width = disparity.shape
    result = np.empty_like(disparity)
    for top in range(0, height, _ROWS):
        bottom = min(top + _ROWS, height)
        first, last = max(0, top - 1), min(height, bottom + 1)
        evidence = np.empty((last - first, width), np.float32)
        with parallel_region:
            _weigh(image, disparity, least, first, evidence)
            _move(disparity, evidence, first, top, bottom, result)
    return result
