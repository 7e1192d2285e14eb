"""The look of a lens from a pair: a sharp picture with its disparity, and the same view out of focus.

The scatter of the sharp picture is laid on the blurred one, where nothing hides anything, by least squares
over blur, focus and the shape of the opening. Every number of blades is tried.
"""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bokehnet.checks import check_rank
from bokehnet.classical.error_map import geometric_error_map
from bokehnet.classical.scatter_renderer import scatter
from bokehnet.errors import LensError, ShapeError
from bokehnet.lenses.fit.disc_model import LOOK, Look, edge_depth
from bokehnet.lenses.fit.least_squares import Solution, solve
from bokehnet.optics.aperture import Aperture

__all__ = ["PairFit", "fit_pair"]

# Pixels of the longer side that are worked on, first and last; shares of the map and radii, of the first
# picture's width, from which blur is searched.
_COARSE, _FINE = 160, 640
_FOCI, _RADII = np.linspace(0, 1, 9), (0.006, 0.012, 0.025, 0.045, 0.08)
_STARTS, _STEPS, _FEW_STEPS = 3, 12, 4
_BLADES = (0, 5, 6, 7, 8, 9)
# Blades must leave this share less than a round opening does, and lie so many pixels within the circle.
_WORTH, _SHALLOW = 0.985, 0.1
# Least share of pixels that no edge reaches, below which all are taken; light from which it is clipped.
_ALONE, _CLIPPED = 0.05, 0.985
_SHAPE = ("curvature", "rotation", "spherical_profile", "obstruction", "cats_eye")
# Steps of derivatives: of blur, of its own; of focus, of the map's range; of shapes wide enough for the
# tables that the scatter makes of them.
_STEP = {"blur": 0.01, "focus": 0.004, "curvature": 0.03, "rotation": 1.0, "obstruction": 0.02}
_SHAPE_STEP = 0.02


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class PairFit:
    """What a pair tells.

    Attributes:
        look: The opening; colours and softness are not fitted.
        blur: Pixels of blur radius per unit of the map, at the size of the picture.
        focus: Value of the map that is in focus.
        deviation: Standard deviation of each fitted parameter by what is left, pixels taken as independent.
        left: Root mean square of what is left, in square roots of light.
        others: What other numbers of blades leave, by number.
        drawn: The blurred picture as it was fitted, (h, w, 3), at the size that was worked on.
        taken: Where pixels were compared, (h, w).

    Examples:
        >>> drawn, taken = np.zeros((2, 3, 3)), np.ones((2, 3), bool)
        >>> told = {"deviation": {"blur": 0.1}, "left": 0.01, "others": {0: 0.02}}
        >>> fit = PairFit(look=Look(blades=6), blur=12.0, focus=0.3, drawn=drawn, taken=taken, **told)
        >>> fit.look.blades, fit.others[0] > fit.left  # a round opening leaves more
        (6, True)
    """

    look: Look
    blur: float
    focus: float
    deviation: dict[str, float]
    left: float
    others: dict[int, float]
    drawn: np.ndarray
    taken: np.ndarray


class _Pair:
    """Both pictures at one size, and how the blurred one is made of the sharp one."""

    def __init__(self, image: np.ndarray, share: np.ndarray, blurred: np.ndarray, longest: int) -> None:
        self.factor = max(1, math.ceil(max(image.shape[:2]) / longest))
        self.image, self.share, self.blurred = (_pooled(x, self.factor) for x in (image, share, blurred))
        self.taken = self.blurred.max(-1) < _CLIPPED
        self.root = np.sqrt(np.maximum(self.blurred, 0))

    def spare_edges(self, blur: float, focus: float) -> None:
        """Leave out what a depth edge reaches."""
        free = geometric_error_map((blur * (self.share - focus)).astype(np.float32)) < 0.5
        if (free & self.taken).mean() > _ALONE:
            self.taken = self.taken & free

    def draw(self, blur: float, focus: float, look: Look) -> np.ndarray:
        shape = {name: getattr(look, name) for name in _SHAPE}
        defocus = (blur * (self.share - focus)).astype(np.float32)
        aperture = Aperture(blades=look.blades, **shape)
        drawn = scatter(self.image, defocus, aperture=aperture)
        wanted, found = (x[self.taken].astype(float) for x in (self.blurred, drawn))
        gain = (wanted * found).sum(0) / np.maximum((found * found).sum(0), 1e-12)
        return np.asarray(np.maximum(drawn * gain, 0))

    def fit(
        self, names: Sequence[str], blur: float, focus: float, look: Look, steps: int
    ) -> tuple[Solution, float, float, Look]:
        """Solve for blur, focus and what of the look is named."""

        def parts(values: np.ndarray) -> tuple[float, float, Look]:
            named = dict(zip(names, values[2:].tolist(), strict=True))
            return float(values[0]), float(values[1]), dataclasses.replace(look, **named)

        def residuals(values: np.ndarray) -> np.ndarray:
            return np.asarray((np.sqrt(self.draw(*parts(values))) - self.root)[self.taken].ravel())

        def jacobian(values: np.ndarray, left: np.ndarray) -> np.ndarray:
            found = np.empty((len(left), len(values)))
            for column, name in enumerate(("blur", "focus", *names)):
                step = _STEP.get(name, _SHAPE_STEP) * (values[0] if name == "blur" else 1.0)
                moved = values.copy()
                moved[column] += step if values[column] + step <= high[column] else -step
                found[:, column] = (residuals(moved) - left) / (moved[column] - values[column])
            return found

        bounds = [(0.3, 400.0), (-0.2, 1.2), *(LOOK[name][:2] for name in names)]
        low, high = np.array(bounds).T
        start = np.array([blur, focus, *(getattr(look, name) for name in names)])
        solution = solve(residuals, jacobian, start, low, high, steps)
        return solution, *parts(solution.values)


def fit_pair(
    image: np.ndarray, disparity: np.ndarray, blurred: np.ndarray, *, blades: Sequence[int] = _BLADES
) -> PairFit:
    """Fit blur, focus and the opening of the lens that blurred a picture.

    Args:
        image: The sharp picture, scene-linear, (H, W, 3).
        disparity: Its map, near is large, in any unit, (H, W).
        blurred: The same view out of focus, scene-linear, (H, W, 3); the exposure of each colour may differ.
        blades: Numbers of blades that are tried; 0 is a round opening.

    Raises:
        ShapeError: Sizes differ.
        LensError: The map is flat, so that focus cannot be told from blur, or all is clipped.

    Examples:
        >>> image = np.full((48, 64, 3), 0.5, np.float32)
        >>> fit_pair(image, np.ones((48, 64), np.float32), image)
        Traceback (most recent call last):
        bokehnet.errors.LensError: disparity: expected things at several depths, got a flat map
    """
    for name, values, rank in (("image", image, 3), ("disparity", disparity, 2), ("blurred", blurred, 3)):
        check_rank(name, values, rank, "(H, W, 3)" if rank == 3 else "(H, W)")
    if not image.shape == blurred.shape == (*disparity.shape, 3):
        raise ShapeError(
            f"expected a picture, a map and a blurred picture of one size, got {image.shape}, "
            f"{disparity.shape}, {blurred.shape}"
        )
    lowest, highest = float(disparity.min()), float(disparity.max())
    if not highest > lowest:
        raise LensError("disparity: expected things at several depths, got a flat map")
    share = ((disparity - lowest) / (highest - lowest)).astype(np.float32)
    coarse = _Pair(image, share, blurred, _COARSE)
    if coarse.taken.mean() < _ALONE:
        raise LensError(f"blurred: expected light below white, got {1 - coarse.taken.mean():.0%} clipped")
    blur, focus = _first_guess(coarse)
    fine = _Pair(image, share, blurred, _FINE)
    blur *= coarse.factor / fine.factor
    fine.spare_edges(blur, focus)
    found = _best_look(fine, blur, focus, blades)
    return dataclasses.replace(
        found,
        blur=found.blur * fine.factor / (highest - lowest),
        focus=lowest + found.focus * (highest - lowest),
    )


def _first_guess(pair: _Pair) -> tuple[float, float]:
    """Blur in pixels over the whole range of the map, and focus as a share of it, of a round opening."""
    round_one, tried = Look(), []
    for focus in _FOCI:
        for radius in _RADII:
            blur = radius * max(pair.share.shape) / max(focus, 1 - focus)
            left = (np.sqrt(pair.draw(blur, focus, round_one)) - pair.root)[pair.taken]
            tried.append((float(left.ravel() @ left.ravel()), blur, float(focus)))
    tried.sort()
    fitted = [pair.fit((), blur, focus, round_one, _STEPS) for _, blur, focus in tried[:_STARTS]]
    _, blur, focus, _ = min(fitted, key=lambda found: found[0].cost)
    return blur, focus


def _best_look(pair: _Pair, blur: float, focus: float, blades: Sequence[int]) -> PairFit:
    """Blur and focus as :func:`_first_guess` has them; the number of blades that leaves least."""
    count = 3 * int(pair.taken.sum())
    even = ("spherical_profile", "cats_eye")
    # Plain discs are drawn by another kernel, across which no derivative can be taken.
    begin = Look(spherical_profile=0.02, cats_eye=0.3)
    first, blur, focus, start = pair.fit(even, blur, focus, begin, _STEPS)
    found = {0: (first.cost, blur, focus, start)}
    for number in blades:
        for turn in (0.0, 0.5) if number else ():
            shape = dataclasses.replace(start, blades=number, curvature=0.2, rotation=turn * 360 / number)
            # An opening with blades is smaller than its circle.
            wider = blur * math.sqrt(math.pi / (number * math.sin(2 * math.pi / number) / 2)) ** 0.8
            solution, own_blur, own_focus, own = pair.fit(
                ("curvature", "rotation"), wider, focus, shape, _FEW_STEPS
            )
            if number not in found or solution.cost < found[number][0]:
                found[number] = solution.cost, own_blur, own_focus, own
    left = {number: math.sqrt(cost / count) for number, (cost, *_) in found.items()}
    best = min(found, key=lambda number: found[number][0])
    if best and 0 in blades and found[best][0] > _WORTH * found[0][0]:
        best = 0
    names = [*even, "obstruction"] + (["curvature", "rotation"] if best else [])
    _, blur, focus, look = found[best]
    solution, blur, focus, look = pair.fit(
        names, blur, focus, dataclasses.replace(look, obstruction=0.1), _STEPS
    )
    if best and edge_depth(best, look.curvature) * blur * max(focus, 1 - focus) < _SHALLOW and 0 in blades:
        return dataclasses.replace(_best_look(pair, blur, focus, (0,)), others=left)
    if best:
        period = 360 / best
        look = dataclasses.replace(look, rotation=(look.rotation + period / 2) % period - period / 2)
    return PairFit(
        look=look,
        blur=blur,
        focus=focus,
        deviation=dict(zip(("blur", "focus", *names), solution.deviation.tolist(), strict=True)),
        left=math.sqrt(solution.cost / count),
        others=left,
        drawn=pair.draw(blur, focus, look),
        taken=pair.taken,
    )


def _pooled(values: np.ndarray, factor: int) -> np.ndarray:
    """Means of blocks, float32; rows and columns that fill no block are left out."""
    height, width = (size // factor for size in values.shape[:2])
    cut = values[: height * factor, : width * factor]
    blocks = cut.reshape(height, factor, width, factor, *values.shape[2:])
    return np.ascontiguousarray(blocks.mean((1, 3)), np.float32)
