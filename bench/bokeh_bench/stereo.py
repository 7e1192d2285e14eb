"""Stereo matching between the picture and a second one from the right.

Both matchers return inverse depth in 1/m, (H, W). They share the pair, the check from right to left, and the
filling of what the second camera does not see; they differ in their costs.
"""

import numpy as np

from bokeh_bench.filters import box, filled, median
from bokeh_bench.scenes import HEIGHT, WIDTH, Scene, camera
from bokeh_bench.tracing import render

__all__ = ["block_matching", "semi_global"]

# Distance of the two cameras in pixel metres: disparity in pixels times depth in metres.
_BASELINE, _DISPARITIES, _WINDOW = 12.0, 32, 7

# Half width of the census window; penalties of a step of one disparity and of a larger one, in bits of the
# census; gradient of the picture, in levels of [0, 1], that divides the larger penalty by two.
_CENSUS, _SMALL_STEP, _LARGE_STEP, _EDGE = 2, 3.0, 20.0, 0.08

_PATHS = ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1))


def _pair(scene: Scene, image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the encoded pictures of the left and the right camera, (H, W, 3) in [0, 1]."""
    right = render(scene.surfaces, scene.sky, camera(shift=_BASELINE * camera().slope), 64, 5)
    return np.clip(image, 0, 1) ** (1 / 2.2), np.clip(right, 0, 1) ** (1 / 2.2)


def _moved(values: np.ndarray, disparity: int) -> np.ndarray:
    """Return the right picture's values at the column ``x - disparity``, its border repeated."""
    moved = np.roll(values, disparity, 1)
    moved[:, :disparity] = values[:, :1]
    return moved


def _inverse_depth(costs: np.ndarray, size: int, *, checks_border: bool) -> np.ndarray:
    """Return inverse depth by the least of costs (D, H, W), checked from the right, filled and smoothed.

    Args:
        costs: Cost of each disparity in pixels for the pixels of the left picture.
        size: Width of the median at the end.
        checks_border: True to count matches outside of the right picture as unseen.
    """
    other = np.stack([np.roll(cost, -d, 1) for d, cost in enumerate(costs)])
    disparity, reverse = costs.argmin(0), other.argmin(0)
    columns = np.arange(WIDTH)
    back = np.take_along_axis(reverse, np.clip(columns - disparity, 0, WIDTH - 1), 1)
    seen = np.abs(back - disparity) <= 1
    if checks_border:
        seen &= columns >= disparity
    return median(filled(_subpixel(costs, disparity), seen), size) / _BASELINE


def _subpixel(costs: np.ndarray, best: np.ndarray) -> np.ndarray:
    """Return the minimum of the parabola through the costs around the best disparity."""
    low, middle, high = (
        np.take_along_axis(costs, np.clip(best + step, 0, len(costs) - 1)[None], 0)[0] for step in (-1, 0, 1)
    )
    curvature = np.maximum(low - 2 * middle + high, 1e-6)
    return np.asarray(best + np.clip((low - high) / (2 * curvature), -0.5, 0.5))


def block_matching(scene: Scene, image: np.ndarray) -> np.ndarray:
    """Return inverse depth by sums of absolute differences over windows of seven pixels.

    Windows fatten foregrounds, stripes match at the wrong period, smooth areas are noisy, and pixels that the
    second camera does not see fail the check from right to left and take the farther neighbour of their row.
    """
    left, right = _pair(scene, image)
    costs = np.empty((_DISPARITIES, HEIGHT, WIDTH))
    for d, cost in enumerate(costs):
        cost[:] = box(np.abs(left - _moved(right, d)).sum(-1), _WINDOW)
    return _inverse_depth(costs, 5, checks_border=False)


def semi_global(scene: Scene, image: np.ndarray) -> np.ndarray:
    """Return inverse depth by semi-global matching: census costs, summed along eight paths.

    Outlines follow the picture's better than those of windows. Thin things are smoothed into what is behind
    them, areas without texture take the depth of their surroundings, and streaks follow the paths.

    Source: Hirschmüller, "Stereo processing by semiglobal matching and mutual information", PAMI 2008; census
    of Zabih and Woodfill, "Non-parametric local transforms for computing visual correspondence", ECCV 1994.
    """
    left, right = (each.mean(-1) for each in _pair(scene, image))
    signs_left, signs_right = _census(left), _census(right)
    costs = np.empty((HEIGHT, WIDTH, _DISPARITIES))
    for d in range(_DISPARITIES):
        costs[..., d] = (signs_left != _moved(signs_right, d)).sum(-1)
    total = sum(_along_path(costs, left, step) for step in _PATHS)
    return _inverse_depth(np.moveaxis(np.asarray(total), -1, 0), 3, checks_border=True)


def _census(grey: np.ndarray) -> np.ndarray:
    """Return whether each neighbour in the window is darker than its pixel, (H, W, 24) bool."""
    height, width = grey.shape
    padded = np.pad(grey, _CENSUS, mode="edge")
    span = range(2 * _CENSUS + 1)
    return np.stack(
        [
            padded[y : y + height, x : x + width] < grey
            for y in span
            for x in span
            if (y, x) != (_CENSUS, _CENSUS)
        ],
        -1,
    )


def _along_path(costs: np.ndarray, grey: np.ndarray, step: tuple[int, int]) -> np.ndarray:
    """Return the costs (H, W, D) of the best assignment along the path that arrives at each pixel.

    Args:
        costs: Costs of the pixels alone, (H, W, D).
        grey: Picture, whose edges lower the penalty of large steps, (H, W).
        step: Rows and columns from one pixel of the path to the next.
    """
    if step[0] == 0:  # along rows: transposed, so that a whole line is one operation
        return _along_path(costs.transpose(1, 0, 2), grey.T, (step[1], 0)).transpose(1, 0, 2)
    result = np.array(costs)
    lines = range(len(costs)) if step[0] > 0 else range(len(costs))[::-1]
    for line, before in zip(lines[1:], lines, strict=False):
        last, last_grey = _shifted(result[before], step[1]), _shifted(grey[before], step[1])
        least = last.min(-1, keepdims=True)
        penalty = np.maximum(_LARGE_STEP / (1 + np.abs(grey[line] - last_grey) / _EDGE), 2 * _SMALL_STEP)
        best = np.minimum(last, least + penalty[:, None])
        best[:, 1:] = np.minimum(best[:, 1:], last[:, :-1] + _SMALL_STEP)
        best[:, :-1] = np.minimum(best[:, :-1], last[:, 1:] + _SMALL_STEP)
        result[line] += best - least
    return result


def _shifted(values: np.ndarray, columns: int) -> np.ndarray:
    """Return the values of the pixels ``columns`` to the left, border repeated."""
    if columns == 0:
        return values
    moved = np.roll(values, columns, 0)
    if columns > 0:
        moved[0] = values[0]
    else:
        moved[-1] = values[-1]
    return moved
