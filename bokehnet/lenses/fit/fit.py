"""Fit of the look of the discs of a photograph, by least squares from several starts."""

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

# Pixels of each disc, and iterations of the final fit.
_PIXELS, _ITERATIONS = 1500, 20
# Number of strongest discs, pixels of each, and iterations of the first fits, in grey.
_FIRST_DISCS, _FIRST_PIXELS, _FIRST_ITERATIONS = 3, 500, 12
# Number of best candidates compared on all discs, minimum pixels of each disc, and of all together.
_CANDIDATES, _MIN_PIXELS, _MIN_TOTAL_PIXELS = 3, 1000, 4000
_BLADES = (0, 5, 6, 7, 8, 9, 10, 11)
# Maximum light of the core of a mirror lens, relative to the rest of the disc.
_MAX_CORE_LIGHT = 0.65
# Minimum depth of blade edges inside the circle, pixels; shallower blades are a round aperture.
_MIN_EDGE_DEPTH_PX = 0.1
_GREY = np.array([0.2126, 0.7152, 0.0722])


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class LookFit:
    """Fitted look of a photograph.

    Attributes:
        look: Fitted look.
        deviation: Standard deviation of each fitted parameter by the residual noise.
        discs: Discs with their fitted centres and radii, signed as in the settings.
        residual: Root mean square residual, relative to the light of a disc.
        residual_by_blades: Residual of each number of blades, by number.
        rendered: Photograph with the fitted discs, (H, W, 3); other pixels are unchanged.
    """

    look: Look
    deviation: dict[str, float]
    discs: tuple[Disc, ...]
    residual: float
    residual_by_blades: dict[int, float]
    rendered: np.ndarray


def fit_look(
    image: np.ndarray, discs: Sequence[Disc], *, behind: bool = True, blades: Sequence[int] = _BLADES
) -> LookFit:
    """Fit the aperture and colour aberrations of a lens to the discs of lamps in a photograph.

    Args:
        image: Whole photograph, scene-linear, (H, W, 3).
        discs: Approximate positions of the lamps.
        behind: True if they are behind the plane of focus, as usual; radial profile and axial colour depend
            on it.
        blades: Candidate numbers of blades; 0 is a round aperture.

    Raises:
        LensError: There is no disc, or a disc has too few unclipped pixels.
    """
    if not discs:
        raise LensError("lights: expected at least one isolated blurred lamp, found none")
    size, side = (image.shape[1], image.shape[0]), -1 if behind else 1
    grey = (image @ _GREY)[..., None]
    first_windows = [window_of(grey, disc, discs, _FIRST_PIXELS) for disc in discs[:_FIRST_DISCS]]
    start = Look(cats_eye=0.3, softness=0.7, obstruction=_core(grey[..., 0], discs[0]))
    names = ["spherical_profile", "cats_eye", "softness"]
    if start.obstruction:
        names.append("obstruction")
    rough = np.array([[disc.x, disc.y, disc.radius] for disc in discs])
    costs: dict[int, tuple[float, Look, np.ndarray]] = {}
    for count in blades:
        for phase in (0.0, 0.5) if count else (0.0,):
            initial = dataclasses.replace(
                start, blades=count, curvature=0.3 if count else 0.0, rotation=phase * 360 / max(count, 1)
            )
            free = [*names, *(BLADE_NAMES if count else ())]
            problem = DiscProblem(free, initial, first_windows, size, side)
            solution = problem.solve(rough[: len(first_windows)], _FIRST_ITERATIONS)
            if count not in costs or solution.cost < costs[count][0]:
                costs[count] = solution.cost, problem.look(solution.values), problem.places(solution.values)
    residual_by_blades = {
        n: math.sqrt(cost[0] / sum(w.light.size for w in first_windows)) for n, cost in costs.items()
    }
    look = _choose_look(grey, discs, costs, names, size, side)
    best, all_discs = look.blades, discs
    discs, rough = _place_discs(grey, look, costs[best][2], discs, size, side)
    windows = [window_of(image, disc, discs, _PIXELS) for disc in discs]
    free = [*names, "axial", "lateral", *(BLADE_NAMES if best else ())]
    problem = DiscProblem(free, look, windows, size, side)
    solution = problem.solve(rough, _ITERATIONS)
    kept = problem.well_fitted(solution.values)
    if not kept.all():  # outliers are no lamps, two lamps, or failed fits
        windows = [window for window, good in zip(windows, kept, strict=True) if good]
        discs = [disc for disc, good in zip(discs, kept, strict=True) if good]
        places = problem.places(solution.values)[kept]
        problem = DiscProblem(free, problem.look(solution.values), windows, size, side)
        solution = problem.solve(places, _ITERATIONS)
    pixels = sum(window.light.size for window in windows)
    look, places = problem.look(solution.values), problem.places(solution.values)
    if best and edge_depth(best, look.curvature) * np.median(places[:, 2]) < _MIN_EDGE_DEPTH_PX:
        return dataclasses.replace(
            fit_look(image, all_discs, behind=behind, blades=(0,)), residual_by_blades=residual_by_blades
        )
    if best:
        period = 360 / best
        look = dataclasses.replace(look, rotation=(look.rotation + period / 2) % period - period / 2)
    return LookFit(
        look=look,
        deviation=dict(zip(free, solution.deviation.tolist(), strict=False)),
        discs=tuple(Disc(x=float(x), y=float(y), radius=side * float(r)) for x, y, r in places),
        residual=math.sqrt(solution.cost / pixels),
        residual_by_blades=residual_by_blades,
        rendered=_render_discs(image, problem, look, places, discs),
    )


def _choose_look(
    grey: np.ndarray,
    discs: Sequence[Disc],
    costs: dict[int, tuple[float, Look, np.ndarray]],
    names: Sequence[str],
    size: tuple[int, int],
    side: int,
) -> Look:
    """Return the look by all discs, among the best numbers of blades of the first fits, and round."""
    order = sorted(costs, key=lambda count: costs[count][0])
    _, look, places = costs[order[0]]
    placed, rough = _place_discs(grey, look, places, discs, size, side)
    pixels = max(_MIN_PIXELS, _MIN_TOTAL_PIXELS // len(discs))
    windows = [window_of(grey, disc, placed, pixels) for disc in placed]
    kept = DiscProblem([], look, windows, size, side).well_fitted(rough.ravel())  # ignore outliers
    windows = [window for window, good in zip(windows, kept, strict=True) if good]
    candidates = [count for count in order if count][:_CANDIDATES] + [count for count in order if not count]
    return choose_blades(
        {count: costs[count][1] for count in candidates}, names, windows, rough[kept], size, side
    )


def _place_discs(
    grey: np.ndarray,
    look: Look,
    places: np.ndarray,
    discs: Sequence[Disc],
    size: tuple[int, int],
    side: int,
) -> tuple[list[Disc], np.ndarray]:
    """Return the fitted discs of a look; those without a first fit are fitted from two initial radii."""
    median_radius = float(np.median(places[:, 2]))
    fitted = list(places)
    for disc in discs[len(places) :]:
        solutions = []
        for radius in (disc.radius, median_radius):
            candidate = Disc(x=disc.x, y=disc.y, radius=max(disc.radius, radius))
            # The disc itself must not count as another one.
            others = [candidate if other is disc else other for other in discs]
            problem = DiscProblem([], look, [window_of(grey, candidate, others, _FIRST_PIXELS)], size, side)
            solution = problem.solve(np.array([[disc.x, disc.y, radius]]), _FIRST_ITERATIONS)
            solutions.append((solution.cost, solution.values))
        fitted.append(min(solutions, key=lambda pair: pair[0])[1])
    all_places = np.stack(fitted)
    return [Disc(x=float(x), y=float(y), radius=float(r)) for x, y, r in all_places], all_places


def _core(grey: np.ndarray, disc: Disc) -> float:
    """Return an initial radius of the dark core; 0 if there is none."""
    rows, columns = box_of(grey, disc)
    y, x = np.mgrid[rows, columns]
    rho = np.hypot(x - disc.x, y - disc.y) / disc.radius
    light = grey[rows, columns]
    background = float(np.quantile(light, 0.05))
    ring = float(np.median(light[(rho > 0.5) & (rho < 0.75)])) - background
    core = float(np.median(light[rho < 0.12])) - background
    return 0.3 if core < _MAX_CORE_LIGHT * ring else 0.0


def _render_discs(
    image: np.ndarray, problem: DiscProblem, look: Look, places: np.ndarray, discs: Sequence[Disc]
) -> np.ndarray:
    rendered = np.array(image, np.float32)
    for disc, place in zip(discs, places, strict=True):
        rows, columns = box_of(image, disc)
        y, x = (axis.astype(float) for axis in np.mgrid[rows, columns])
        plane = np.stack([np.ones(x.size), x.ravel() - disc.x, y.ravel() - disc.y], -1)
        for channel, shape in enumerate(problem.shapes(look, place, x, y)):
            basis = np.concatenate([shape.reshape(-1, 1), plane], -1)
            light = image[rows, columns, channel].ravel()
            good = light < CLIPPED
            factors = np.linalg.lstsq(basis[good], light[good], rcond=None)[0]
            rendered[rows, columns, channel] = (basis @ factors).reshape(x.shape)
    return rendered
