"""Choice of the number of blades by cross-validation over lamps."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from bokehnet.lenses.fit.disc_model import Look
from bokehnet.lenses.fit.disc_problem import DiscProblem, Window

__all__ = ["BLADE_NAMES", "choose_blades"]

# Parameters that only apertures with blades have.
BLADE_NAMES = ("curvature", "rotation")

# Minimum improvement of blades over a round aperture, in standard errors of the mean over lamps.
_MIN_STANDARD_ERRORS = 2.0
# Iterations of a fit to half of the lamps, and of a fit of positions only.
_ITERATIONS, _POSITION_ITERATIONS = 20, 12
# Side of the blocks by which the pixels of a single lamp are halved, pixels: the blocks of JPEG.
_BLOCK = 8


def choose_blades(
    looks: Mapping[int, Look],
    names: Sequence[str],
    windows: Sequence[Window],
    places: np.ndarray,
    size: tuple[int, int],
    side: int,
) -> Look:
    """Return the look with the number of blades of the smallest residual, if it beats a round aperture.

    Noise can resemble blades, and its pixels are not independent. Therefore the aperture is fitted to
    every second lamp and evaluated on the others, where only the positions are fitted, and vice versa:
    blades are accepted if they reduce the residual of those lamps. The pixels of a single lamp are halved by
    blocks.

    Args:
        looks: Start of each number of blades, by number; 0 is a round aperture. Without 0, the best number is
            accepted without comparison.
        names: Fitted parameters of a look other than those of blades.
        windows: Pixels around the lamps.
        places: Initial centres and radii, (lamps, 3).
        size: Width and height of the photograph.
        side: Side of the focus, 1 in front, -1 behind.

    Returns:
        The look fitted to all these lamps.

    Source:
        Stone, "Cross-validatory choice and assessment of statistical predictions", J. R. Stat. Soc. B, 1974.
    """
    solved, by_lamp = {}, {}
    for count, look in looks.items():
        problem = DiscProblem(_free(names, count), look, windows, size, side)
        values = problem.solve(places, _ITERATIONS).values
        solved[count] = problem.look(values), problem.places(values), problem.well_fitted(values)
        pairs = zip(solved[count][1], windows, strict=True)
        by_lamp[count] = np.median(
            [np.mean(problem.disc_residuals(solved[count][0], *pair) ** 2) for pair in pairs]
        )
    # The median over lamps, to ignore a lamp whose fit failed.
    best = min(by_lamp, key=lambda count: by_lamp[count])
    if best and 0 in looks:
        kept = solved[best][2]
        evaluated = [window for window, good in zip(windows, kept, strict=True) if good]
        by_blades, by_round = (
            _validation_residuals(
                names, count, solved[count][0], evaluated, solved[best][1][kept], size, side
            )
            for count in (best, 0)
        )
        gain = (by_round - by_blades) / by_round
        if not gain.mean() > _MIN_STANDARD_ERRORS * gain.std(ddof=1) / math.sqrt(len(gain)):
            best = 0
    return solved[best][0]


def _free(names: Sequence[str], count: int) -> list[str]:
    return [*names, *(BLADE_NAMES if count else ())]


def _validation_residuals(
    names: Sequence[str],
    count: int,
    start: Look,
    windows: Sequence[Window],
    places: np.ndarray,
    size: tuple[int, int],
    side: int,
) -> np.ndarray:
    """Return the residual of each lamp, or half lamp, under a look fitted to the others, (lamps,)."""
    free = _free(names, count)
    if len(windows) == 1:
        halves = [_half(windows[0], odd) for odd in (0, 1)]
        residuals = []
        for first, other in (halves, halves[::-1]):
            problem = DiscProblem(free, start, [first], size, side)
            values = problem.solve(places, _ITERATIONS).values
            residuals.append(
                (problem.disc_residuals(problem.look(values), problem.places(values)[0], other) ** 2).sum()
            )
        return np.array(residuals)
    costs = np.zeros(len(windows))
    for odd in (0, 1):
        own = [window for number, window in enumerate(windows) if number % 2 == odd]
        problem = DiscProblem(free, start, own, size, side)
        look = problem.look(problem.solve(places[odd::2], _ITERATIONS).values)
        for number in range(1 - odd, len(windows), 2):
            single = DiscProblem([], look, [windows[number]], size, side)
            costs[number] = single.solve(places[number : number + 1], _POSITION_ITERATIONS).cost
    return costs


def _half(window: Window, odd: int) -> Window:
    """Return every second block of pixels."""
    kept = (np.floor(window.x / _BLOCK) + np.floor(window.y / _BLOCK)) % 2 == odd
    return Window(window.x[kept], window.y[kept], window.light[kept], window.scale)
