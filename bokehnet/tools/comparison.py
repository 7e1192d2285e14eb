"""One picture by several engines, beside the truth where it is known: scores, crops, errors."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from time import perf_counter

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
from bokehnet.settings.settings import RenderSettings
from bokehnet.tools.contact_sheet import contact_sheet
from bokehnet.tools.peak_memory import PeakMemory

__all__ = ["Compared", "Scores", "compare_engines", "comparison_sheet", "interesting_places"]

# How many times an error of the encoded picture is shown.
_ERROR_GAIN = 4.0

_SMALLEST = 11  # pixels, that SSIM needs

Crop = tuple[int, int, int, int]


@dataclass(frozen=True, kw_only=True, slots=True)
class Scores:
    """How close a picture is to the truth, both clipped and sRGB-encoded.

    Attributes:
        psnr: dB.
        edge_psnr: The same of pixels that a depth discontinuity reaches; NaN where there are none.
        ssim: Up to 1, which is best.
        flip: 0, which is best, to 1.

    Examples:
        >>> Scores(psnr=38.0, edge_psnr=33.5, ssim=0.97, flip=0.05).edge_psnr
        33.5
    """

    psnr: float
    edge_psnr: float
    ssim: float
    flip: float


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Compared:
    """What one engine made.

    Attributes:
        engine: Its name.
        bokeh: Scene-linear, (H, W, 3).
        seconds: That the rendering took, once its kernels were there.
        scores: Against the truth; None where it is not known.
        error: Absolute error of the encoded picture, mean of the channels, (H, W); None likewise.
        memory: Bytes that the rendering held at its peak, the result among them; None but on Linux.

    Examples:
        >>> Compared(engine="rays", bokeh=np.zeros((4, 4, 3)), seconds=0.5).line
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
        """All numbers in a line."""
        costs = f"{self.seconds:.2f} s" + ("" if self.memory is None else f"  {self.memory / 1e6:.0f} MB")
        if self.scores is None:
            return f"{self.engine}  {costs}"
        found = self.scores
        edge = "" if math.isnan(found.edge_psnr) else f"  edge {found.edge_psnr:.2f} dB"
        numbers = f"{found.psnr:.2f} dB{edge}  SSIM {found.ssim:.4f}  FLIP {found.flip:.4f}"
        return f"{self.engine}  {numbers}  {costs}"


def _shown(picture: np.ndarray) -> np.ndarray:
    return np.asarray(linear_to_srgb(np.clip(picture, 0, 1)), np.float64)


def compare_engines(
    scene: Scene,
    settings: RenderSettings,
    engines: Sequence[str],
    truth: np.ndarray | None = None,
    progress: Progress | None = None,
) -> list[Compared]:
    """Render a scene by each of some engines.

    Args:
        scene: From ``read_scene`` or ``make_scene``.
        settings: All but the engine.
        engines: Names, ours or those of ``bokehnet.baselines``.
        truth: What a lens sees, scene-linear, (H, W, 3).
        progress: Called with (engines done, engines in all).

    Raises:
        ParameterError: No engine, one twice, or one that does not know what the settings ask for.
        ShapeError: The truth has another size than the picture.

    Examples:
        >>> from bokehnet.tools.demo import demo_settings, small_demo_scene
        >>> found = compare_engines(small_demo_scene(), demo_settings("middle"), ["scatter", "rectangle"])
        >>> [one.engine for one in found]
        ['scatter', 'rectangle']
    """
    if not engines or len(set(engines)) < len(engines):
        shown = ", ".join(engines) or "none"
        raise ParameterError("engines", "one or more engines, each once", shown=shown)
    for name in engines:  # all of them before the first takes its time
        check_choice("engines", name, (*ENGINES, *BASELINES))
        BokehRenderer(name).check(settings)
    if truth is not None:
        check_same_size("image", scene.image, "truth", truth)
        if min(truth.shape[:2]) < _SMALLEST:
            shown = f"{truth.shape[1]}x{truth.shape[0]}"
            raise ParameterError("truth", f"at least {_SMALLEST} pixels high and wide", shown=shown)
    found = []
    for done, name in enumerate(engines):
        if progress is not None:
            progress(done, len(engines))
        found.append(_one(scene, settings, name, truth))
    if progress is not None:
        progress(len(engines), len(engines))
    return found


def _one(scene: Scene, settings: RenderSettings, engine: str, truth: np.ndarray | None) -> Compared:
    renderer = BokehRenderer(engine)
    renderer.warm_up(settings)
    peak, start = PeakMemory(), perf_counter()
    result = renderer.render(scene, settings)
    seconds = perf_counter() - start
    made = Compared(engine=result.report.engine, bokeh=result.bokeh, seconds=seconds, memory=peak.extra)
    if truth is None:
        return made
    wanted, got = _shown(truth), _shown(result.bokeh)
    defocus = result.defocus
    assert defocus is not None  # nothing was to be overwritten
    near = geometric_error_map(defocus, softness=0) > 0.5
    if near.shape != got.shape[:2]:
        near = np.zeros(got.shape[:2], bool)
    scores = Scores(
        psnr=psnr(wanted, got),
        edge_psnr=psnr(wanted, got, near),
        ssim=float(ssim_map(wanted, got).mean()),
        flip=float(flip_map(wanted, got).mean()),
    )
    return replace(made, scores=scores, error=np.abs(wanted - got).mean(axis=2))


def interesting_places(found: Sequence[Compared], size: int = 160, count: int = 2) -> list[Crop]:
    """Squares (left, top, width, height) in which the engines differ most from the truth or each other.

    Args:
        found: What the engines made.
        size: Side, pixels; smaller in small pictures.
        count: How many, at most; they do not overlap.

    Examples:
        >>> bokeh, error = np.zeros((40, 60, 3)), np.zeros((40, 60))
        >>> error[20:30, 40:50] = 1
        >>> found = [Compared(engine="rays", bokeh=bokeh, seconds=1, error=error)]
        >>> interesting_places(found, size=10, count=1)
        [(40, 20, 10, 10)]
    """
    if found[0].error is not None:
        apart = np.mean([one.error for one in found if one.error is not None], axis=0)
    else:
        apart = np.ptp([_shown(one.bokeh) for one in found], axis=0).mean(axis=2)
    height, width = apart.shape
    side = min(size, height, width)
    total = np.pad(apart.astype(np.float64).cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
    sums = total[side:, side:] - total[:-side, side:] - total[side:, :-side] + total[:-side, :-side]
    places: list[Crop] = []
    for _ in range(count):
        top, left = np.unravel_index(int(np.argmax(sums)), sums.shape)
        if not np.isfinite(sums[top, left]):
            break
        places.append((int(left), int(top), side, side))
        sums[max(0, top - side + 1) : top + side, max(0, left - side + 1) : left + side] = -np.inf
    return places


def comparison_sheet(
    image: np.ndarray,
    found: Sequence[Compared],
    places: Sequence[Crop],
    truth: np.ndarray | None = None,
) -> np.ndarray:
    """One sheet: a row for the picture and the truth, and one for each engine, all cut at the same places.

    Args:
        image: The picture, scene-linear, (H, W, 3).
        found: What the engines made of it.
        places: Crops (left, top, width, height), all of one size.
        truth: Scene-linear, (H, W, 3); then a picture of errors, four times as strong, follows each crop.

    Returns:
        Scene-linear, (H', W', 3) float32.

    Examples:
        >>> image = np.zeros((40, 60, 3), np.float32)
        >>> found = [Compared(engine="rays", bokeh=image, seconds=1)]
        >>> comparison_sheet(image, found, [(0, 0, 20, 20)]).shape[2]
        3
    """

    def cut(picture: np.ndarray, place: Crop) -> np.ndarray:
        left, top, width, height = place
        part = picture[top : top + height, left : left + width]
        return np.asarray(part.repeat(2, axis=0).repeat(2, axis=1), np.float32)

    first = []
    for place in places:
        first.append(("in focus", cut(image, place)))
        if truth is not None:
            first.append(("truth", cut(truth, place)))
    rows = [first]
    for one in found:
        row = []
        for n, place in enumerate(places):
            row.append((one.engine if n == 0 else "", cut(one.bokeh, place)))
            if one.error is not None:
                grey = srgb_to_linear(np.clip(_ERROR_GAIN * one.error, 0, 1))
                edge = one.scores.edge_psnr if one.scores else math.nan
                score = "" if one.scores is None else f"{one.scores.psnr:.2f} dB, edge {edge:.2f} dB"
                label = score if n == 0 else f"{one.seconds:.2f} s"
                row.append((label, cut(np.repeat(grey[..., None], 3, axis=2), place)))
        rows.append(row)
    return contact_sheet(rows)
