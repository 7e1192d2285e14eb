"""Progressive previews: a small draft at once, then the screen size, then the selected engine."""

import threading
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from time import perf_counter, sleep
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bokehnet.classical.scatter.aperture_scatter import prepare_tables
from bokehnet.classical.scatter.aperture_table import LARGEST_TABLE, MAX_CACHED_APERTURES
from bokehnet.errors import RenderCancelled
from bokehnet.progress import Progress, ignore_progress
from bokehnet.render.cancellation import CancelSignal
from bokehnet.render.look import make_aperture
from bokehnet.render.renderer import BokehRenderer
from bokehnet.scene.scene import Scene
from bokehnet.settings.settings import (
    ApertureSettings,
    ColorSettings,
    EngineSettings,
    LensSettings,
    RenderSettings,
)
from bokehnet.studio.background import BackgroundProcess
from bokehnet.studio.opened import Opened, Region
from bokehnet.studio.preview.display import to_rgba

__all__ = ["Canvas", "Picture", "Previews", "quick_settings"]

# Maximum time in seconds for the first picture at screen size, while dragging a slider and otherwise; if it
# would take longer, a smaller draft comes first, whose time is limited by the last number.
_MAX_DRAG_SECONDS, _MAX_FIRST_SECONDS, _MAX_DRAFT_SECONDS = 0.08, 0.13, 0.03

# Candidate sizes of the draft relative to the screen size.
_DRAFT_SCALES = (0.75, 0.5, 0.35, 0.25, 0.18)

# Number of checks for a new change after the draft, and seconds before each.
_IDLE_CHECKS, _IDLE_INTERVAL = 5, 0.01

_THUMBNAIL = "thumbnail"
_TABLE_PAUSE = 0.05  # s between the preparation of two aperture shapes

_REGION_MARGIN = 1.25  # margin around a region, in units of the largest blur radius


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Picture:
    """Picture for the page.

    Attributes:
        stage: ``draft``, ``scatter`` or ``final``; for overlays the name of their kind.
        rgba: Pixels, (H, W, 4).
        facts: Facts about the render, for display.
    """

    stage: str
    rgba: NDArray[np.uint8]
    facts: dict[str, Any]


@dataclass(frozen=True, kw_only=True, slots=True)
class Canvas:
    """Canvas of a page.

    Attributes:
        size: Width and height of the preview, pixels.
        space: Colour space.
        region: Region to show at full size; None shows the whole picture at ``size``.
        held: True while the user drags a slider.
    """

    size: tuple[int, int]
    space: str
    region: Region | None = None
    held: bool = False


def quick_settings(settings: RenderSettings) -> RenderSettings:
    """Return the settings without everything that needs rays: no lens, no colour fringes; engine scatter.

    Examples:
        >>> settings = RenderSettings().updated({"lens": {"coma": 2}, "aperture": {"blades": 6}})
        >>> quick_settings(settings).to_table()
        {'aperture': {'blades': 6}, 'engine': {'name': 'scatter'}}
    """
    table = settings.to_table()
    for group in (LensSettings.GROUP, ColorSettings.GROUP, EngineSettings.GROUP):
        table.pop(group, None)
    device = {} if settings.engine.device == "cpu" else {"device": settings.engine.device}
    return RenderSettings().updated({**table, "engine": {"name": "scatter", **device}})


def refine(
    scene: Scene, settings: RenderSettings, space: Any, shown: str, stage: str, *, report: Progress
) -> Picture:
    """Render with the selected engine; a task of the background process."""
    return _render(_renderer(), scene, settings, space, shown, stage, report)


@cache
def _renderer() -> BokehRenderer:
    """Return the renderer of the process, which caches its engines."""
    return BokehRenderer()


class Previews:
    """Renderer of previews: quick ones in this process, one at a time, final ones in the background.

    Args:
        background: Background process for final previews.
    """

    def __init__(self, background: BackgroundProcess) -> None:
        self._background = background
        self._turn = threading.Lock()
        # Seconds per pixel of recent pictures, by (screen size, plain discs).
        self._pace = {(True, True): 2e-7, (True, False): 3e-7, (False, True): 4e-7, (False, False): 6e-7}
        self._latest: dict[str, threading.Event] = {}
        # Aperture shapes whose tables are prepared in this process, except plain discs.
        self._ready: deque[ApertureSettings] = deque(maxlen=MAX_CACHED_APERTURES - 1)
        self._closed, self._settled = threading.Event(), threading.Event()

    def begin(self, client: str) -> threading.Event:
        """Return the cancellation signal of a new preview, and cancel the previous one of the same page."""
        signal = threading.Event()
        previous = self._latest.get(client)
        if previous is not None:
            previous.set()
        self._latest[client] = signal
        if client != _THUMBNAIL and _THUMBNAIL in self._latest:
            self._latest[_THUMBNAIL].set()
        return signal

    def begin_thumbnail(self) -> threading.Event:
        """Return the cancellation signal of a thumbnail, which any preview cancels."""
        return self.begin(_THUMBNAIL)

    def prepare_shapes(self, shapes: Iterable[ApertureSettings]) -> None:
        """Prepare the tables of aperture shapes after the first picture, one after the other."""
        threading.Thread(target=self._prepare_all_shapes, args=(tuple(shapes),), daemon=True).start()

    def close(self) -> None:
        """Stop preparing tables."""
        self._closed.set()
        self._settled.set()

    def _prepare_all_shapes(self, shapes: tuple[ApertureSettings, ...]) -> None:
        self._settled.wait()  # the tables take seconds of a core, for which the first picture should not wait
        for shape in shapes:
            if self._closed.wait(_TABLE_PAUSE):
                return
            self._prepare_shape(shape)

    def _prepare_shape(self, shape: ApertureSettings) -> None:
        if shape != ApertureSettings() and shape not in self._ready:
            prepare_tables(make_aperture(shape), LARGEST_TABLE)
            self._ready.append(shape)

    def stages(
        self,
        opened: Opened,
        settings: RenderSettings,
        canvas: Canvas,
        cancel: CancelSignal,
        progress: Progress,
    ) -> Iterator[Picture]:
        """Yield pictures of increasing quality up to that of the selected engine.

        Args:
            opened: Opened picture.
            settings: Settings of the render.
            canvas: Size, colour space and content of the preview.
            cancel: Cancellation signal.
            progress: Progress callback of the final picture.

        Raises:
            BokehnetError: The settings do not apply to the picture.
            RenderCancelled: ``cancel`` was set.
        """
        size, shown, region, held = canvas.size, canvas.space, canvas.region, canvas.held
        scene, inside = self._scene(opened, settings, size, region)
        scaled = opened.at_size(settings, 1.0 if region else size[0] / opened.size[0])
        quick, engine = quick_settings(scaled), settings.engine.name or "rays"
        ready = _is_plain(quick) or quick.aperture in self._ready
        small = size if region else self._draft_size(size, ready and _is_plain(quick), held)
        if small != size or not ready:
            reduced = opened.at_size(settings, small[0] / opened.size[0])
            draft = replace(quick_settings(reduced), aperture=quick.aperture if ready else ApertureSettings())
            view = scene if region else opened.view(small, settings)
            yield _crop(self._quick(opened, view, draft, shown, "draft", cancel), inside)
            if held:
                _wait_for_change(cancel)
        if ready:
            yield _crop(self._quick(opened, scene, quick, shown, "scatter", cancel), inside)
        else:  # preparing its shape is slow and must not delay the next change
            task = (scene, quick, opened.space, shown, "scatter")
            yield _crop(self._background.run(refine, *task, cancel=cancel), inside)
        if engine != "scatter":
            task = (scene, scaled, opened.space, shown, "final")
            yield _crop(self._background.run(refine, *task, progress=progress, cancel=cancel), inside)
        self._settled.set()
        if not ready and not cancel.is_set():
            self._prepare_shape(quick.aperture)

    def _draft_size(self, size: tuple[int, int], plain: bool, held: bool) -> tuple[int, int]:
        """Return the size of the first picture: the largest one within the time limit."""
        if size[0] * size[1] * self._pace[True, plain] < (_MAX_DRAG_SECONDS if held else _MAX_FIRST_SECONDS):
            return size
        seconds = size[0] * size[1] * self._pace[False, plain]
        scales = (scale for scale in _DRAFT_SCALES if scale**2 * seconds < _MAX_DRAFT_SECONDS)
        scale = next(scales, _DRAFT_SCALES[-1])
        return max(16, round(size[0] * scale)), max(16, round(size[1] * scale))

    def _quick(
        self,
        opened: Opened,
        scene: Scene,
        settings: RenderSettings,
        shown: str,
        stage: str,
        cancel: CancelSignal,
    ) -> Picture:
        with self._turn:
            if cancel.is_set():
                raise RenderCancelled("rendering was cancelled")
            begun = perf_counter()
            picture = _render(_renderer(), scene, settings, opened.space, shown, stage, ignore_progress)
            pace = (perf_counter() - begun) / (picture.rgba.shape[0] * picture.rgba.shape[1])
            kind = stage == "scatter", _is_plain(settings)
            self._pace[kind] += 0.3 * (pace - self._pace[kind])
            return picture

    def _scene(
        self, opened: Opened, settings: RenderSettings, size: tuple[int, int], region: Region | None
    ) -> tuple[Scene, Region | None]:
        """Return the scene to render, and the region of it to show."""
        if region is None:
            return opened.view(size, settings), None
        margin = round(_REGION_MARGIN * self._largest_blur(opened, settings)) + 8
        left, top = max(region.x - margin, 0), max(region.y - margin, 0)
        right = min(region.x + region.width + margin, opened.size[0])
        bottom = min(region.y + region.height + margin, opened.size[1])
        whole = Region(x=left, y=top, width=right - left, height=bottom - top)
        inside = Region(x=region.x - left, y=region.y - top, width=region.width, height=region.height)
        return opened.view(size, settings, whole), inside

    def _largest_blur(self, opened: Opened, settings: RenderSettings) -> float:
        """Return the largest blur radius in pixels of the file, estimated on a small view."""
        small = opened.fitted(96, 96)
        factor = small[0] / opened.size[0]
        quick = quick_settings(opened.at_size(settings, factor))
        defocus = _renderer().prepare(opened.view(small, settings), quick).defocus
        return min(float(np.abs(defocus).max()) / factor, 400.0)


def _render(
    renderer: BokehRenderer,
    scene: Scene,
    settings: RenderSettings,
    space: Any,
    shown: str,
    stage: str,
    report: Progress,
) -> Picture:
    begun = perf_counter()
    result = renderer.render(scene, settings, report)
    summary = result.report
    distance = summary.focus_distance
    facts = {
        "engine": summary.engine,
        "largest_blur": summary.largest_blur,
        "focus_disparity": summary.focus_disparity,
        "focus_distance": None if distance is None or not np.isfinite(distance) else distance,
        "notes": list(summary.notes),
    }
    rgba = to_rgba(result.bokeh, space, shown)
    return Picture(stage=stage, rgba=rgba, facts=facts | {"seconds": perf_counter() - begun})


def _wait_for_change(cancel: CancelSignal) -> None:
    """Wait briefly for the next change while a slider is dragged: a started render cannot be interrupted."""
    for _ in range(_IDLE_CHECKS):
        sleep(_IDLE_INTERVAL)
        if cancel.is_set():
            raise RenderCancelled("rendering was cancelled")


def _is_plain(settings: RenderSettings) -> bool:
    """Return whether the aperture is a plain disc, the fastest shape."""
    return settings.aperture == ApertureSettings()


def _crop(picture: Picture, part: Region | None) -> Picture:
    if part is None:
        return picture
    rows, columns = slice(part.y, part.y + part.height), slice(part.x, part.x + part.width)
    return Picture(
        stage=picture.stage, rgba=np.ascontiguousarray(picture.rgba[rows, columns]), facts=picture.facts
    )
