"""Comparison of engines on one picture, optionally with a reference: scores, crops, errors."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from time import perf_counter
from typing import cast

import numpy as np

from bokehnet.baselines.registry import BASELINES
from bokehnet.checks import check_choice, check_same_size
from bokehnet.classical.error_map import geometric_error_map
from bokehnet.engine_registry import ENGINES
from bokehnet.errors import ParameterError
from bokehnet.io.color.srgb import linear_to_srgb, srgb_to_linear
from bokehnet.progress import Progress
from bokehnet.render.renderer import BokehRenderer
from bokehnet.scene.scene import Scene
from bokehnet.scores.flip import flip_map
from bokehnet.scores.similarity import psnr, ssim_map
from bokehnet.settings.settings import EngineName, RenderSettings
from bokehnet.tools.contact_sheet import contact_sheet
from bokehnet.tools.peak_memory import PeakMemory

__all__ = ["EngineComparison", "Scores", "compare_engines", "comparison_sheet", "largest_difference_crops"]

# Amplification of the error of the encoded picture in sheets.
_ERROR_GAIN = 4.0

_MIN_SIDE_PX = 11  # window size of SSIM

Crop = tuple[int, int, int, int]


@dataclass(frozen=True, kw_only=True, slots=True)
class Scores:
    """Similarity of a picture to the truth, both clipped and sRGB-encoded.

    Attributes:
        psnr: Peak signal-to-noise ratio, dB.
        edge_psnr: PSNR of the pixels in reach of a depth discontinuity, dB; NaN if there are none.
        ssim: Structural similarity, up to 1 (best).
        flip: FLIP error, 0 (best) to 1.

    Examples:
        >>> Scores(psnr=38.0, edge_psnr=33.5, ssim=0.97, flip=0.05).edge_psnr
        33.5
    """

    psnr: float
    edge_psnr: float
    ssim: float
    flip: float


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class EngineComparison:
    """Picture, cost and scores of one engine.

    Attributes:
        engine: Name of the engine.
        bokeh: Scene-linear result, (H, W, 3).
        seconds: Render time, s, without compilation of kernels.
        scores: Scores against the truth; None without truth.
        error: Absolute error of the encoded picture, mean of the channels, (H, W); None without truth.
        memory: Peak memory of the rendering including the result, bytes; None except on Linux.

    Examples:
        >>> EngineComparison(engine="rays", bokeh=np.zeros((4, 4, 3)), seconds=0.5).line
        'rays  0.50 s'
    """

    engine: str
    bokeh: np.ndarray
    seconds: float
    scores: Scores | None = None
    error: np.ndarray | None = None
    memory: int | None = None

    @property
    def line(self) -> str:
        """Engine, scores and cost in one line."""
        costs = f"{self.seconds:.2f} s" + ("" if self.memory is None else f"  {self.memory / 1e6:.0f} MB")
        if self.scores is None:
            return f"{self.engine}  {costs}"
        scores = self.scores
        edge = "" if math.isnan(scores.edge_psnr) else f"  edge {scores.edge_psnr:.2f} dB"
        numbers = f"{scores.psnr:.2f} dB{edge}  SSIM {scores.ssim:.4f}  FLIP {scores.flip:.4f}"
        return f"{self.engine}  {numbers}  {costs}"


def _encoded(picture: np.ndarray) -> np.ndarray:
    return np.asarray(linear_to_srgb(np.clip(picture, 0, 1)), np.float64)


def compare_engines(
    scene: Scene,
    settings: RenderSettings,
    engines: Sequence[str],
    truth: np.ndarray | None = None,
    progress: Progress | None = None,
) -> list[EngineComparison]:
    """Render a scene with each of several engines.

    Args:
        scene: Scene from ``read_scene`` or ``make_scene``.
        settings: Settings except the engine.
        engines: Names of engines or of ``bokehnet.baselines``.
        truth: Reference, scene-linear, (H, W, 3).
        progress: Called with (engines done, total engines).

    Raises:
        ParameterError: No engine, a repeated one, or one that does not support the settings.
        ShapeError: The truth and the picture differ in size.

    Examples:
        >>> from bokehnet.tools.demo import demo_settings, small_demo_scene
        >>> results = compare_engines(small_demo_scene(), demo_settings("middle"), ["scatter", "rectangle"])
        >>> [result.engine for result in results]
        ['scatter', 'rectangle']
    """
    if not engines or len(set(engines)) < len(engines):
        shown = ", ".join(engines) or "none"
        raise ParameterError("engines", "one or more engines, each once", shown=shown)
    for name in engines:  # check all before the first one renders
        check_choice("engines", name, (*ENGINES, *BASELINES))
        _renderer(name).check(settings)
    if truth is not None:
        check_same_size("image", scene.image, "truth", truth)
        if min(truth.shape[:2]) < _MIN_SIDE_PX:
            shown = f"{truth.shape[1]}x{truth.shape[0]}"
            raise ParameterError("truth", f"at least {_MIN_SIDE_PX} pixels high and wide", shown=shown)
    results = []
    for done, name in enumerate(engines):
        if progress is not None:
            progress(done, len(engines))
        results.append(_run_engine(scene, settings, name, truth))
    if progress is not None:
        progress(len(engines), len(engines))
    return results


def _run_engine(
    scene: Scene, settings: RenderSettings, engine: str, truth: np.ndarray | None
) -> EngineComparison:
    renderer = _renderer(engine)
    renderer.warm_up(settings)
    peak, start = PeakMemory(), perf_counter()
    rendered = renderer.render(scene, settings)
    seconds = perf_counter() - start
    result = EngineComparison(
        engine=rendered.report.engine, bokeh=rendered.bokeh, seconds=seconds, memory=peak.extra
    )
    if truth is None:
        return result
    expected, actual = _encoded(truth), _encoded(rendered.bokeh)
    defocus = rendered.defocus
    assert defocus is not None  # render() was called without overwrite
    near_edge = geometric_error_map(defocus, softness=0) > 0.5
    if near_edge.shape != actual.shape[:2]:
        near_edge = np.zeros(actual.shape[:2], bool)
    scores = Scores(
        psnr=psnr(expected, actual),
        edge_psnr=psnr(expected, actual, near_edge),
        ssim=float(ssim_map(expected, actual).mean()),
        flip=float(flip_map(expected, actual).mean()),
    )
    return replace(result, scores=scores, error=np.abs(expected - actual).mean(axis=2))


def _renderer(engine: str) -> BokehRenderer:
    """Return the renderer of an engine, or of a method of the literature, which no type lists."""
    return BokehRenderer(cast(EngineName, engine))


def largest_difference_crops(
    results: Sequence[EngineComparison], size: int = 160, count: int = 2
) -> list[Crop]:
    """Return squares (left, top, width, height) where the engines differ most, from the truth or each other.

    Args:
        results: Results of the engines.
        size: Side, pixels; smaller in small pictures.
        count: Maximum number of squares; they do not overlap.

    Examples:
        >>> bokeh, error = np.zeros((40, 60, 3)), np.zeros((40, 60))
        >>> error[20:30, 40:50] = 1
        >>> results = [EngineComparison(engine="rays", bokeh=bokeh, seconds=1, error=error)]
        >>> largest_difference_crops(results, size=10, count=1)
        [(40, 20, 10, 10)]
    """
    if results[0].error is not None:
        difference = np.mean([result.error for result in results if result.error is not None], axis=0)
    else:
        difference = np.ptp([_encoded(result.bokeh) for result in results], axis=0).mean(axis=2)
    height, width = difference.shape
    side = min(size, height, width)
    total = np.pad(difference.astype(np.float64).cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
    sums = total[side:, side:] - total[:-side, side:] - total[side:, :-side] + total[:-side, :-side]
    crops: list[Crop] = []
    for _ in range(count):
        top, left = np.unravel_index(int(np.argmax(sums)), sums.shape)
        if not np.isfinite(sums[top, left]):
            break
        crops.append((int(left), int(top), side, side))
        sums[max(0, top - side + 1) : top + side, max(0, left - side + 1) : left + side] = -np.inf
    return crops


def comparison_sheet(
    image: np.ndarray,
    results: Sequence[EngineComparison],
    crops: Sequence[Crop],
    truth: np.ndarray | None = None,
) -> np.ndarray:
    """Return a sheet with a row of crops for the picture and the truth, and one for each engine.

    Args:
        image: Picture, scene-linear, (H, W, 3).
        results: Results of the engines.
        crops: Crops (left, top, width, height), all of one size.
        truth: Reference, scene-linear, (H, W, 3); with it an error picture, amplified four times, follows
            each crop.

    Returns:
        Scene-linear, (H', W', 3) float32.

    Examples:
        >>> image = np.zeros((40, 60, 3), np.float32)
        >>> results = [EngineComparison(engine="rays", bokeh=image, seconds=1)]
        >>> comparison_sheet(image, results, [(0, 0, 20, 20)]).shape[2]
        3
    """

    def cut(picture: np.ndarray, crop: Crop) -> np.ndarray:
        left, top, width, height = crop
        pixels = picture[top : top + height, left : left + width]
        return np.asarray(pixels.repeat(2, axis=0).repeat(2, axis=1), np.float32)

    first = []
    for crop in crops:
        first.append(("in focus", cut(image, crop)))
        if truth is not None:
            first.append(("truth", cut(truth, crop)))
    rows = [first]
    for result in results:
        row = []
        for n, crop in enumerate(crops):
            row.append((result.engine if n == 0 else "", cut(result.bokeh, crop)))
            if result.error is not None:
                grey = srgb_to_linear(np.clip(_ERROR_GAIN * result.error, 0, 1))
                edge = result.scores.edge_psnr if result.scores else math.nan
                score = "" if result.scores is None else f"{result.scores.psnr:.2f} dB, edge {edge:.2f} dB"
                label = score if n == 0 else f"{result.seconds:.2f} s"
                row.append((label, cut(np.repeat(grey[..., None], 3, axis=2), crop)))
        rows.append(row)
    return contact_sheet(rows)
