"""The look of a photograph's discs, by least squares from several starts."""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bokehnet.errors import LensError
from bokehnet.lenses.look_fit.disc_model import LOOK, Look, draw_disc, edge_depth
from bokehnet.lenses.look_fit.discs import Disc
from bokehnet.lenses.look_fit.least_squares import Solution, solve
from bokehnet.optics.chromatic_aberration import glass_curve
from bokehnet.optics.wavelength_sampling import WavelengthSampling

__all__ = ["LookFit", "fit_look"]

# Windows reach so many radii from the middle of a disc, and hold so many pixels in all of the steps.
_REACH, _PIXELS = 1.35, 1500
# Openings are told apart by the strongest discs, in grey, with fewer pixels and steps.
_CHOSEN, _FEW, _FEW_STEPS, _STEPS = 3, 500, 12, 20
_BLADES = (0, 5, 6, 7, 8, 9, 10, 11)
# A core this much darker than the rest of the disc is one of a mirror lens.
_DARK = 0.65
# Light from which a photograph is clipped, and blades must leave this share less than a round opening does.
_CLIPPED, _WORTH = 0.985, 0.985
# Blades whose edges lie less than this many pixels within the circle are a round opening.
_SHALLOW = 0.1
# Discs of which so many times as much is left as of the middle one are given up.
_STRAY = 2.5
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


@dataclass(frozen=True, slots=True, eq=False)
class _Window:
    """Pixels around one disc: columns and rows (N,), light (N, C), and the scale of the disc's light."""

    x: np.ndarray
    y: np.ndarray
    light: np.ndarray
    scale: np.ndarray


class _Problem:
    """Residuals of discs for a vector of look and places."""

    def __init__(
        self, names: Sequence[str], start: Look, windows: Sequence[_Window], size: tuple[int, int], side: int
    ) -> None:
        self.names, self.start, self.windows = list(names), start, windows
        self.size, self.side = size, side
        self.half = 0.5 * math.hypot(*size)
        channels = windows[0].light.shape[1]
        sampled, _ = WavelengthSampling(dispersion="rgb").at((np.arange(3) + 0.5) / 3)
        self.curve = glass_curve("N-BK7")(sampled) if channels == 3 else np.zeros(1)

    def look(self, values: np.ndarray) -> Look:
        found = dict(zip(self.names, values[: len(self.names)].tolist(), strict=True))
        return dataclasses.replace(self.start, **found)

    def shapes(self, look: Look, place: np.ndarray, x: np.ndarray, y: np.ndarray) -> list[np.ndarray]:
        """The disc at pixels, for each channel."""
        drawn = []
        for strength in self.curve:
            away = place[:2] - (np.array(self.size) - 1) / 2
            middle = place[:2] + look.lateral / 100 * strength * away
            radius = self.side * place[2] - look.axial / 100 * strength * self.half
            drawn.append(draw_disc(look, x, y, (middle[0], middle[1]), radius, self.size))
        return drawn

    def one(self, look: Look, place: np.ndarray, window: _Window) -> np.ndarray:
        """Residuals of one disc: what its shape and a plane do not explain, of its light."""
        x, y = window.x, window.y
        plane = np.stack([np.ones_like(x), (x - x.mean()) / 20, (y - y.mean()) / 20], -1)
        parts = []
        for channel, shape in enumerate(self.shapes(look, place, x, y)):
            basis = np.concatenate([shape[:, None], plane], -1)
            light = window.light[:, channel]
            factors = np.linalg.solve(basis.T @ basis + 1e-9 * np.eye(4), basis.T @ light)
            parts.append((basis @ factors - light) / window.scale[channel])
        return np.concatenate(parts)

    def places(self, values: np.ndarray) -> np.ndarray:
        return values[len(self.names) :].reshape(-1, 3)

    def residuals(self, values: np.ndarray) -> np.ndarray:
        look, places = self.look(values), self.places(values)
        return np.concatenate([self.one(look, p, w) for p, w in zip(places, self.windows, strict=True)])

    def jacobian(self, values: np.ndarray, left: np.ndarray) -> np.ndarray:
        found = np.zeros((len(left), len(values)))
        for column, name in enumerate(self.names):
            _, high, step = LOOK[name]
            step = step if values[column] + step <= high else -step
            moved = values.copy()
            moved[column] += step
            found[:, column] = (self.residuals(moved) - left) / step
        look, places, first = self.look(values), self.places(values), 0
        for number, window in enumerate(self.windows):
            rows = slice(first, first + window.light.size)
            for axis in range(3):
                place = places[number].copy()
                place[axis] += 0.02
                column = len(self.names) + 3 * number + axis
                found[rows, column] = (self.one(look, place, window) - left[rows]) / 0.02
            first = rows.stop
        return found

    def well_fitted(self, values: np.ndarray) -> np.ndarray:
        """Which discs are left no more than others, (discs,)."""
        look, pairs = self.look(values), zip(self.places(values), self.windows, strict=True)
        left = np.array([np.sqrt(np.mean(self.one(look, place, window) ** 2)) for place, window in pairs])
        return np.asarray(left <= _STRAY * np.median(left))

    def solve(self, places: np.ndarray, steps: int) -> Solution:
        look = [getattr(self.start, name) for name in self.names]
        bounds = np.array([LOOK[name][:2] for name in self.names]).reshape(-1, 2)
        reach = np.tile([0.4, 0.4, 0.4], len(places)) * np.repeat(places[:, 2], 3)
        flat = places.ravel()
        return solve(
            self.residuals,
            self.jacobian,
            np.concatenate([look, flat]),
            np.concatenate([bounds[:, 0], flat - reach]),
            np.concatenate([bounds[:, 1], flat + reach]),
            steps,
        )


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
    few = [_window(grey, disc, discs, _FEW) for disc in discs[:_CHOSEN]]
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
            free = [*names, "curvature", "rotation"] if count else names
            problem = _Problem(free, begin, few, size, side)
            found = problem.solve(rough[: len(few)], _FEW_STEPS)
            if count not in costs or found.cost < costs[count][0]:
                costs[count] = found.cost, problem.look(found.values), problem.places(found.values)
    best = min(costs, key=lambda count: costs[count][0])
    if 0 in costs and costs[best][0] > _WORTH * costs[0][0]:
        best = 0
    _, look, places = costs[best]
    given, left = discs, {n: math.sqrt(cost[0] / sum(w.light.size for w in few)) for n, cost in costs.items()}
    discs, rough = _placed(grey, look, places, discs, size, side)
    windows = [_window(image, disc, discs, _PIXELS) for disc in discs]
    free = [*names, "axial", "lateral"] + (["curvature", "rotation"] if best else [])
    problem = _Problem(free, look, windows, size, side)
    found = problem.solve(rough, _STEPS)
    kept = problem.well_fitted(found.values)
    if not kept.all():  # what stands out is no lamp, or two, or was not found
        windows = [window for window, good in zip(windows, kept, strict=True) if good]
        discs = [disc for disc, good in zip(discs, kept, strict=True) if good]
        places = problem.places(found.values)[kept]
        problem = _Problem(free, problem.look(found.values), windows, size, side)
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
            problem = _Problem([], look, [_window(grey, there, discs, _FEW)], size, side)
            solved = problem.solve(np.array([[disc.x, disc.y, radius]]), _FEW_STEPS)
            tried.append((solved.cost, solved.values))
        found.append(min(tried, key=lambda pair: pair[0])[1])
    all_places = np.stack(found)
    return [Disc(x=float(x), y=float(y), radius=float(r)) for x, y, r in all_places], all_places


def _window(image: np.ndarray, disc: Disc, discs: Sequence[Disc], most: int) -> _Window:
    """Pixels around a disc that are not clipped and not of others."""
    rows, columns = _box(image, disc)
    y, x = (axis.astype(float) for axis in np.mgrid[rows, columns])
    light = image[rows, columns]
    good = light.max(-1) < _CLIPPED
    for other in discs:
        if other is not disc:
            good &= np.hypot(x - other.x, y - other.y) > 1.15 * other.radius + 2
    if good.sum() < 50:
        raise LensError(
            f"lights: expected light below white around x {disc.x:.0f}, y {disc.y:.0f}, found it clipped: "
            f"take a darker exposure or leave this lamp out"
        )
    chosen = np.flatnonzero(good)
    # Evenly, in an order that no direction has.
    chosen = np.sort(np.random.default_rng(0).permutation(chosen)[:most])
    light = light.reshape(-1, light.shape[-1])[chosen].astype(float)
    scale = np.maximum(np.quantile(light, 0.9, axis=0) - np.quantile(light, 0.05, axis=0), 1e-6)
    return _Window(x.ravel()[chosen], y.ravel()[chosen], light, np.maximum(scale, 0.2 * scale.max()))


def _box(image: np.ndarray, disc: Disc) -> tuple[slice, slice]:
    reach = _REACH * disc.radius + 3
    rows = slice(max(0, int(disc.y - reach)), min(image.shape[0], int(disc.y + reach) + 2))
    return rows, slice(max(0, int(disc.x - reach)), min(image.shape[1], int(disc.x + reach) + 2))


def _core(grey: np.ndarray, disc: Disc) -> float:
    """A first radius of the dark core; 0 where there is none."""
    rows, columns = _box(grey, disc)
    y, x = np.mgrid[rows, columns]
    rho = np.hypot(x - disc.x, y - disc.y) / disc.radius
    light = grey[rows, columns]
    ground = float(np.quantile(light, 0.05))
    ring = float(np.median(light[(rho > 0.5) & (rho < 0.75)])) - ground
    core = float(np.median(light[rho < 0.12])) - ground
    return 0.3 if core < _DARK * ring else 0.0


def _drawn(
    image: np.ndarray, problem: _Problem, look: Look, places: np.ndarray, discs: Sequence[Disc]
) -> np.ndarray:
    drawn = np.array(image, np.float32)
    for disc, place in zip(discs, places, strict=True):
        rows, columns = _box(image, disc)
        y, x = (axis.astype(float) for axis in np.mgrid[rows, columns])
        plane = np.stack([np.ones(x.size), x.ravel() - disc.x, y.ravel() - disc.y], -1)
        for channel, shape in enumerate(problem.shapes(look, place, x, y)):
            basis = np.concatenate([shape.reshape(-1, 1), plane], -1)
            light = image[rows, columns, channel].ravel()
            good = light < _CLIPPED
            factors = np.linalg.lstsq(basis[good], light[good], rcond=None)[0]
            drawn[rows, columns, channel] = (basis @ factors).reshape(x.shape)
    return drawn
