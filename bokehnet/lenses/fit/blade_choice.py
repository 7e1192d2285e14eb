"""How many blades an opening has, judged on lamps that it was not fitted to."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from bokehnet.lenses.fit.disc_model import Look
from bokehnet.lenses.fit.disc_problem import DiscProblem, Window

__all__ = ["BLADE_NAMES", "choose_blades"]

# What blades have, and a round opening has not.
BLADE_NAMES = ("curvature", "rotation")

# Blades must leave less than a round opening by so many standard errors of the mean over lamps.
_SURE = 2.0
# Steps of a fit to half of the lamps, and of a place alone.
_STEPS, _FEW_STEPS = 20, 12
# Side of the squares of pixels by which a single lamp is halved: the blocks of JPEG.
_BLOCK = 8


def choose_blades(
    looks: Mapping[int, Look],
    names: Sequence[str],
    windows: Sequence[Window],
    places: np.ndarray,
    size: tuple[int, int],
    side: int,
) -> Look:
    """Choose among numbers of blades: the one that leaves least, where it beats a round opening.

    Noise, too, looks a little like blades, and its pixels are not independent. So the opening is fitted to
    every second lamp and judged on the others, of which only the places are fitted, and the other way round:
    blades are there where those lamps are left less by them. A single lamp is halved by blocks of pixels.

    Args:
        looks: Where each number of blades begins, by number; 0 is a round opening. Without it no number is
            doubted.
        names: What is fitted of a look besides blades.
        windows: Pixels around the lamps.
        places: Middles and radii to begin with, (lamps, 3).
        size: Width and height of the photograph.
        side: Of the focus, 1 in front, -1 behind.

    Returns:
        The look as all these lamps have it.

    Source:
        Stone, "Cross-validatory choice and assessment of statistical predictions", J. R. Stat. Soc. B, 1974.
    """
    solved, by_lamp = {}, {}
    for count, look in looks.items():
        problem = DiscProblem(_free(names, count), look, windows, size, side)
        values = problem.solve(places, _STEPS).values
        solved[count] = problem.look(values), problem.places(values), problem.well_fitted(values)
        pairs = zip(solved[count][1], windows, strict=True)
        by_lamp[count] = np.median([np.mean(problem.one(solved[count][0], *pair) ** 2) for pair in pairs])
    # By the middle one of the lamps: one that was lost must not tell.
    best = min(by_lamp, key=lambda count: by_lamp[count])
    if best and 0 in looks:
        kept = solved[best][2]
        judged = [window for window, good in zip(windows, kept, strict=True) if good]
        by_blades, by_round = (
            _left_of_others(names, count, solved[count][0], judged, solved[best][1][kept], size, side)
            for count in (best, 0)
        )
        gain = (by_round - by_blades) / by_round
        if not gain.mean() > _SURE * gain.std(ddof=1) / math.sqrt(len(gain)):
            best = 0
    return solved[best][0]


def _free(names: Sequence[str], count: int) -> list[str]:
    return [*names, *(BLADE_NAMES if count else ())]


def _left_of_others(
    names: Sequence[str],
    count: int,
    start: Look,
    windows: Sequence[Window],
    places: np.ndarray,
    size: tuple[int, int],
    side: int,
) -> np.ndarray:
    """What a look leaves of each lamp that it was not fitted to, (lamps,); of each half of a single one."""
    free = _free(names, count)
    if len(windows) == 1:
        halves = [_half(windows[0], odd) for odd in (0, 1)]
        left = []
        for first, other in (halves, halves[::-1]):
            problem = DiscProblem(free, start, [first], size, side)
            values = problem.solve(places, _STEPS).values
            left.append((problem.one(problem.look(values), problem.places(values)[0], other) ** 2).sum())
        return np.array(left)
    found = np.zeros(len(windows))
    for odd in (0, 1):
        own = [window for number, window in enumerate(windows) if number % 2 == odd]
        problem = DiscProblem(free, start, own, size, side)
        look = problem.look(problem.solve(places[odd::2], _STEPS).values)
        for number in range(1 - odd, len(windows), 2):
            alone = DiscProblem([], look, [windows[number]], size, side)
            found[number] = alone.solve(places[number : number + 1], _FEW_STEPS).cost
    return found


def _half(window: Window, odd: int) -> Window:
    """Every second square of pixels."""
    kept = (np.floor(window.x / _BLOCK) + np.floor(window.y / _BLOCK)) % 2 == odd
    return Window(window.x[kept], window.y[kept], window.light[kept], window.scale)
