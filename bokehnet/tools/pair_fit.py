"""Fit the look of a lens to an image pair: a sharp picture with disparity, and the same view out of focus.

The sharp picture is blurred by scatter and compared with the blurred one, away from occlusions, by least
squares over blur, focus and aperture shape. Every number of blades is tried.
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

# Longer side, pixels, of the first and last pass; initial focus as a fraction of the map's range, and initial
# radii as a fraction of the longer side of the picture.
_COARSE_SIDE_PX, _FINE_SIDE_PX = 160, 640
_INITIAL_FOCUS, _INITIAL_RADII = np.linspace(0, 1, 9), (0.006, 0.012, 0.025, 0.045, 0.08)
_STARTS, _ITERATIONS, _BLADE_ITERATIONS = 3, 12, 4
_BLADES = (0, 5, 6, 7, 8, 9)
# An aperture with blades needs at most this fraction of the cost of a disc, and at least this deviation from
# the circle.
_MAX_COST_RATIO, _MIN_EDGE_DEPTH_PX = 0.985, 0.1
# Minimum fraction of pixels away from depth edges, below which all are used; light above it is clipped.
_MIN_EDGE_FREE_FRACTION, _CLIPPING_LEVEL = 0.05, 0.985
_SHAPE = ("curvature", "rotation", "spherical_profile", "obstruction", "cats_eye")
# Steps of finite differences: of blur relative to it; of focus relative to the map's range; of shape
# parameters wide enough for the lookup tables of the scatter.
_STEP = {"blur": 0.01, "focus": 0.004, "curvature": 0.03, "rotation": 1.0, "obstruction": 0.02}
_SHAPE_STEP = 0.02


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class PairFit:
    """Result of a fit to an image pair.

    Attributes:
        look: Aperture shape; colours and softness are not fitted.
        blur: Blur radius in pixels per unit of the map, at the size of the picture.
        focus: Value of the map in focus.
        deviation: Standard deviation of each fitted parameter, for independent pixel residuals.
        residual: Root mean square residual, in square roots of light.
        residuals: Root mean square residual by number of blades.
        rendered: Blurred picture of the fit, (h, w, 3), at the size of the fit.
        mask: EngineResult pixels, (h, w).

    Examples:
        >>> rendered, mask = np.zeros((2, 3, 3)), np.ones((2, 3), bool)
        >>> errors = {"deviation": {"blur": 0.1}, "residual": 0.01, "residuals": {0: 0.02}}
        >>> fit = PairFit(look=Look(blades=6), blur=12.0, focus=0.3, rendered=rendered, mask=mask, **errors)
        >>> fit.look.blades, fit.residuals[0] > fit.residual  # a disc fits worse
        (6, True)
    """

    look: Look
    blur: float
    focus: float
    deviation: dict[str, float]
    residual: float
    residuals: dict[int, float]
    rendered: np.ndarray
    mask: np.ndarray


class _Pair:
    """Image pair at reduced size, with the model of the blurred picture."""

    def __init__(self, image: np.ndarray, disparity: np.ndarray, blurred: np.ndarray, max_side: int) -> None:
        self.factor = max(1, math.ceil(max(image.shape[:2]) / max_side))
        arrays = (image, disparity, blurred)
        self.image, self.disparity, self.blurred = (_pooled(x, self.factor) for x in arrays)
        self.mask = self.blurred.max(-1) < _CLIPPING_LEVEL
        self.root = np.sqrt(np.maximum(self.blurred, 0))

    def exclude_edges(self, blur: float, focus: float) -> None:
        """Exclude pixels in reach of depth edges from the comparison."""
        edge_free = geometric_error_map((blur * (self.disparity - focus)).astype(np.float32)) < 0.5
        if (edge_free & self.mask).mean() > _MIN_EDGE_FREE_FRACTION:
            self.mask = self.mask & edge_free

    def render(self, blur: float, focus: float, look: Look) -> np.ndarray:
        shape = {name: getattr(look, name) for name in _SHAPE}
        defocus = (blur * (self.disparity - focus)).astype(np.float32)
        aperture = Aperture(blades=look.blades, **shape)
        rendered = scatter(self.image, defocus, aperture=aperture)
        target, model = (x[self.mask].astype(float) for x in (self.blurred, rendered))
        gain = (target * model).sum(0) / np.maximum((model * model).sum(0), 1e-12)
        return np.asarray(np.maximum(rendered * gain, 0))

    def fit(
        self, names: Sequence[str], blur: float, focus: float, look: Look, iterations: int
    ) -> tuple[Solution, float, float, Look]:
        """Fit blur, focus and the named parameters of the look."""

        def unpack(values: np.ndarray) -> tuple[float, float, Look]:
            shape = dict(zip(names, values[2:].tolist(), strict=True))
            return float(values[0]), float(values[1]), dataclasses.replace(look, **shape)

        def residuals(values: np.ndarray) -> np.ndarray:
            return np.asarray((np.sqrt(self.render(*unpack(values))) - self.root)[self.mask].ravel())

        def jacobian(values: np.ndarray, residual: np.ndarray) -> np.ndarray:
            derivatives = np.empty((len(residual), len(values)))
            for column, name in enumerate(("blur", "focus", *names)):
                step = _STEP.get(name, _SHAPE_STEP) * (values[0] if name == "blur" else 1.0)
                moved = values.copy()
                moved[column] += step if values[column] + step <= high[column] else -step
                derivatives[:, column] = (residuals(moved) - residual) / (moved[column] - values[column])
            return derivatives

        bounds = [(0.3, 400.0), (-0.2, 1.2), *(LOOK[name][:2] for name in names)]
        low, high = np.array(bounds).T
        start = np.array([blur, focus, *(getattr(look, name) for name in names)])
        solution = solve(residuals, jacobian, start, low, high, iterations)
        return solution, *unpack(solution.values)


def fit_pair(
    image: np.ndarray, disparity: np.ndarray, blurred: np.ndarray, *, blades: Sequence[int] = _BLADES
) -> PairFit:
    """Fit blur, focus and aperture shape of the lens that blurred a picture.

    Args:
        image: Sharp picture, scene-linear, (H, W, 3).
        disparity: Disparity of the picture, larger is nearer, in any unit, (H, W).
        blurred: Same view out of focus, scene-linear, (H, W, 3); the exposure of each colour may differ.
        blades: Numbers of blades to try; 0 is a disc.

    Raises:
        ShapeError: The sizes differ.
        LensError: The map is constant, so that focus and blur are ambiguous, or all pixels are clipped.

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
    relative = ((disparity - lowest) / (highest - lowest)).astype(np.float32)
    coarse = _Pair(image, relative, blurred, _COARSE_SIDE_PX)
    if coarse.mask.mean() < _MIN_EDGE_FREE_FRACTION:
        raise LensError(f"blurred: expected light below white, got {1 - coarse.mask.mean():.0%} clipped")
    blur, focus = _initial_blur_and_focus(coarse)
    fine = _Pair(image, relative, blurred, _FINE_SIDE_PX)
    blur *= coarse.factor / fine.factor
    fine.exclude_edges(blur, focus)
    fit = _best_look(fine, blur, focus, blades)
    return dataclasses.replace(
        fit,
        blur=fit.blur * fine.factor / (highest - lowest),
        focus=lowest + fit.focus * (highest - lowest),
    )


def _initial_blur_and_focus(pair: _Pair) -> tuple[float, float]:
    """Return blur in pixels over the range of the map, and focus as a fraction of it, for a disc aperture."""
    disc, candidates = Look(), []
    for focus in _INITIAL_FOCUS:
        for radius in _INITIAL_RADII:
            blur = radius * max(pair.disparity.shape) / max(focus, 1 - focus)
            residual = (np.sqrt(pair.render(blur, focus, disc)) - pair.root)[pair.mask]
            candidates.append((float(residual.ravel() @ residual.ravel()), blur, float(focus)))
    candidates.sort()
    fits = [pair.fit((), blur, focus, disc, _ITERATIONS) for _, blur, focus in candidates[:_STARTS]]
    _, blur, focus, _ = min(fits, key=lambda fit: fit[0].cost)
    return blur, focus


def _best_look(pair: _Pair, blur: float, focus: float, blades: Sequence[int]) -> PairFit:
    """Return the fit with the best number of blades, from :func:`_initial_blur_and_focus`."""
    count = 3 * int(pair.mask.sum())
    smooth = ("spherical_profile", "cats_eye")
    # Another kernel renders plain discs; finite differences must not cross from one kernel to the other.
    begin = Look(spherical_profile=0.02, cats_eye=0.3)
    first, blur, focus, start = pair.fit(smooth, blur, focus, begin, _ITERATIONS)
    fits = {0: (first.cost, blur, focus, start)}
    for number in blades:
        for turn in (0.0, 0.5) if number else ():
            shape = dataclasses.replace(start, blades=number, curvature=0.2, rotation=turn * 360 / number)
            # An aperture with blades is smaller than its circle.
            wider = blur * math.sqrt(math.pi / (number * math.sin(2 * math.pi / number) / 2)) ** 0.8
            solution, own_blur, own_focus, own = pair.fit(
                ("curvature", "rotation"), wider, focus, shape, _BLADE_ITERATIONS
            )
            if number not in fits or solution.cost < fits[number][0]:
                fits[number] = solution.cost, own_blur, own_focus, own
    residuals = {number: math.sqrt(cost / count) for number, (cost, *_) in fits.items()}
    best = min(fits, key=lambda number: fits[number][0])
    if best and 0 in blades and fits[best][0] > _MAX_COST_RATIO * fits[0][0]:
        best = 0
    names = [*smooth, "obstruction"] + (["curvature", "rotation"] if best else [])
    _, blur, focus, look = fits[best]
    solution, blur, focus, look = pair.fit(
        names, blur, focus, dataclasses.replace(look, obstruction=0.1), _ITERATIONS
    )
    edge_depth_px = edge_depth(best, look.curvature) * blur * max(focus, 1 - focus) if best else 0.0
    if best and edge_depth_px < _MIN_EDGE_DEPTH_PX and 0 in blades:
        return dataclasses.replace(_best_look(pair, blur, focus, (0,)), residuals=residuals)
    if best:
        period = 360 / best
        look = dataclasses.replace(look, rotation=(look.rotation + period / 2) % period - period / 2)
    return PairFit(
        look=look,
        blur=blur,
        focus=focus,
        deviation=dict(zip(("blur", "focus", *names), solution.deviation.tolist(), strict=True)),
        residual=math.sqrt(solution.cost / count),
        residuals=residuals,
        rendered=pair.render(blur, focus, look),
        mask=pair.mask,
    )


def _pooled(values: np.ndarray, factor: int) -> np.ndarray:
    """Return the means of blocks, float32; rows and columns that fill no block are dropped."""
    height, width = (size // factor for size in values.shape[:2])
    cut = values[: height * factor, : width * factor]
    blocks = cut.reshape(height, factor, width, factor, *values.shape[2:])
    return np.ascontiguousarray(blocks.mean((1, 3)), np.float32)
