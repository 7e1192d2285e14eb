"""The look of a photograph's discs, by least squares from several starts."""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bokehnet.errors import LensError
from bokehnet.lenses.fit.blade_choice import BLADE_NAMES, choose_blades
from bokehnet.lenses.fit.disc_model import Look, edge_depth
from bokehnet.lenses.fit.disc_problem import CLIPPED, DiscProblem, box_of, window_of
from bokehnet.lenses.fit.discs import Disc

__all__ = ["LookFit", "fit_look"]

# Pixels of each disc, and steps.
_PIXELS, _STEPS = 1500, 20
# Openings are tried on the strongest discs, in grey, with fewer pixels and steps.
_CHOSEN, _FEW, _FEW_STEPS = 3, 500, 12
# The numbers of blades that then leave least are told apart by all discs, with so many pixels of each at
# least, and of all together.
_LIKELY, _MANY, _ALL_MANY = 3, 1000, 4000
_BLADES = (0, 5, 6, 7, 8, 9, 10, 11)
# A core this much darker than the rest of the disc is one of a mirror lens.
_DARK = 0.65
# Blades whose edges lie less than this many pixels within the circle are a round opening.
_SHALLOW = 0.1
_GREY = np.array([0.2126, 0.7152, 0.0722])


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class LookFit:
    """What a photograph tells of its lens.

    Attributes:
        look: The fitted look.
        deviation: Standard deviation of each fitted parameter by the noise that is left.
        discs: The discs with their fitted middles and radii, signed as in the settings.
        left: Root mean square of what is left, of the light of a disc.
        others: What other numbers of blades leave, by number.
        drawn: The photograph with its discs as they were fitted, (H, W, 3); the rest as it was.
    """

    look: Look
    deviation: dict[str, float]
    discs: tuple[Disc, ...]
    left: float
    others: dict[int, float]
    drawn: np.ndarray


def fit_look(
    image: np.ndarray, discs: Sequence[Disc], *, behind: bool = True, blades: Sequence[int] = _BLADES
) -> LookFit:
    """Fit the opening and the colours of a lens to the discs of lamps in a photograph.

    Args:
        image: The whole photograph, scene-linear, (H, W, 3).
        discs: Where lamps are, roughly.
        behind: Whether they are behind the plane of focus, as most are; rims and axial colours turn with it.
        blades: Numbers of blades that are tried; 0 is a round opening.

    Raises:
        LensError: There is no disc, or nothing of them is left that is not clipped.
    """
    if not discs:
        raise LensError("lights: expected at least one blurred lamp that stands alone, found none")
    size, side = (image.shape[1], image.shape[0]), -1 if behind else 1
    grey = (image @ _GREY)[..., None]
    few = [window_of(grey, disc, discs, _FEW) for disc in discs[:_CHOSEN]]
    start = Look(cats_eye=0.3, softness=0.7, obstruction=_core(grey[..., 0], discs[0]))
    names = ["spherical_profile", "cats_eye", "softness"]
    if start.obstruction:
        names.append("obstruction")
    rough = np.array([[disc.x, disc.y, disc.radius] for disc in discs])
    costs: dict[int, tuple[float, Look, np.ndarray]] = {}
    for count in blades:
        for turn in (0.0, 0.5) if count else (0.0,):
            begin = dataclasses.replace(
                start, blades=count, curvature=0.3 if count else 0.0, rotation=turn * 360 / max(count, 1)
            )
            free = [*names, *(BLADE_NAMES if count else ())]
            problem = DiscProblem(free, begin, few, size, side)
            found = problem.solve(rough[: len(few)], _FEW_STEPS)
            if count not in costs or found.cost < costs[count][0]:
                costs[count] = found.cost, problem.look(found.values), problem.places(found.values)
    left = {n: math.sqrt(cost[0] / sum(w.light.size for w in few)) for n, cost in costs.items()}
    look = _chosen(grey, discs, costs, names, size, side)
    best, given = look.blades, discs
    discs, rough = _placed(grey, look, costs[best][2], discs, size, side)
    windows = [window_of(image, disc, discs, _PIXELS) for disc in discs]
    free = [*names, "axial", "lateral", *(BLADE_NAMES if best else ())]
    problem = DiscProblem(free, look, windows, size, side)
    found = problem.solve(rough, _STEPS)
    kept = problem.well_fitted(found.values)
    if not kept.all():  # what stands out is no lamp, or two, or was not found
        windows = [window for window, good in zip(windows, kept, strict=True) if good]
        discs = [disc for disc, good in zip(discs, kept, strict=True) if good]
        places = problem.places(found.values)[kept]
        problem = DiscProblem(free, problem.look(found.values), windows, size, side)
        found = problem.solve(places, _STEPS)
    pixels = sum(window.light.size for window in windows)
    look, places = problem.look(found.values), problem.places(found.values)
    if best and edge_depth(best, look.curvature) * np.median(places[:, 2]) < _SHALLOW:
        return dataclasses.replace(fit_look(image, given, behind=behind, blades=(0,)), others=left)
    if best:
        period = 360 / best
        look = dataclasses.replace(look, rotation=(look.rotation + period / 2) % period - period / 2)
    return LookFit(
        look=look,
        deviation=dict(zip(free, found.deviation.tolist(), strict=False)),
        discs=tuple(Disc(x=float(x), y=float(y), radius=side * float(r)) for x, y, r in places),
        left=math.sqrt(found.cost / pixels),
        others=left,
        drawn=_drawn(image, problem, look, places, discs),
    )


def _chosen(
    grey: np.ndarray,
    discs: Sequence[Disc],
    costs: dict[int, tuple[float, Look, np.ndarray]],
    names: Sequence[str],
    size: tuple[int, int],
    side: int,
) -> Look:
    """The opening by all discs: one of the numbers of blades that left least of the first ones, or round."""
    order = sorted(costs, key=lambda count: costs[count][0])
    _, look, places = costs[order[0]]
    placed, rough = _placed(grey, look, places, discs, size, side)
    many = max(_MANY, _ALL_MANY // len(discs))
    windows = [window_of(grey, disc, placed, many) for disc in placed]
    kept = DiscProblem([], look, windows, size, side).well_fitted(rough.ravel())  # what is no lamp has no say
    windows = [window for window, good in zip(windows, kept, strict=True) if good]
    likely = [count for count in order if count][:_LIKELY] + [count for count in order if not count]
    return choose_blades(
        {count: costs[count][1] for count in likely}, names, windows, rough[kept], size, side
    )


def _placed(
    grey: np.ndarray,
    look: Look,
    places: np.ndarray,
    discs: Sequence[Disc],
    size: tuple[int, int],
    side: int,
) -> tuple[list[Disc], np.ndarray]:
    """Discs with a look; those that were not among the first each alone, as found or as large as these."""
    usual = float(np.median(places[:, 2]))
    found = list(places)
    for disc in discs[len(places) :]:
        tried = []
        for radius in (disc.radius, usual):
            there = Disc(x=disc.x, y=disc.y, radius=max(disc.radius, radius))
            around = [there if one is disc else one for one in discs]  # its own light is not another's
            problem = DiscProblem([], look, [window_of(grey, there, around, _FEW)], size, side)
            solved = problem.solve(np.array([[disc.x, disc.y, radius]]), _FEW_STEPS)
            tried.append((solved.cost, solved.values))
        found.append(min(tried, key=lambda pair: pair[0])[1])
    all_places = np.stack(found)
    return [Disc(x=float(x), y=float(y), radius=float(r)) for x, y, r in all_places], all_places


def _core(grey: np.ndarray, disc: Disc) -> float:
    """A first radius of the dark core; 0 where there is none."""
    rows, columns = box_of(grey, disc)
    y, x = np.mgrid[rows, columns]
    rho = np.hypot(x - disc.x, y - disc.y) / disc.radius
    light = grey[rows, columns]
    ground = float(np.quantile(light, 0.05))
    ring = float(np.median(light[(rho > 0.5) & (rho < 0.75)])) - ground
    core = float(np.median(light[rho < 0.12])) - ground
    return 0.3 if core < _DARK * ring else 0.0


def _drawn(
    image: np.ndarray, problem: DiscProblem, look: Look, places: np.ndarray, discs: Sequence[Disc]
) -> np.ndarray:
    drawn = np.array(image, np.float32)
    for disc, place in zip(discs, places, strict=True):
        rows, columns = box_of(image, disc)
        y, x = (axis.astype(float) for axis in np.mgrid[rows, columns])
        plane = np.stack([np.ones(x.size), x.ravel() - disc.x, y.ravel() - disc.y], -1)
        for channel, shape in enumerate(problem.shapes(look, place, x, y)):
            basis = np.concatenate([shape.reshape(-1, 1), plane], -1)
            light = image[rows, columns, channel].ravel()
            good = light < CLIPPED
            factors = np.linalg.lstsq(basis[good], light[good], rcond=None)[0]
            drawn[rows, columns, channel] = (basis @ factors).reshape(x.shape)
    return drawn
