"""From a change to pixels: a small picture at once, the screen's size next, then the engine's own."""

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
from bokehnet.progress import Progress
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
from bokehnet.studio.display import to_rgba
from bokehnet.studio.helper import Helper
from bokehnet.studio.opened import Opened, Region

__all__ = ["Picture", "Previews", "quick_settings"]

# Seconds that the picture at the size of the screen may take to be the first, while the hand goes on and
# else; where it would take more, a small one comes before, of a size that takes so long as the last number.
_WHOLE_HELD, _WHOLE, _AT_ONCE = 0.08, 0.13, 0.03

# Sides of the first picture over those of the screen's.
_FIRST = (0.75, 0.5, 0.35, 0.25, 0.18)

# Looks for the next change after the first picture, and the seconds before each.
_MOMENTS, _MOMENT = 5, 0.01

_THUMBNAIL = "thumbnail"
_BETWEEN = 0.05  # seconds between two shapes that are laid out ahead

_MARGIN = 1.25  # of a part of the picture, in its largest blur radii


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Picture:
    """A picture for the page.

    Attributes:
        stage: ``draft``, ``scatter`` or ``final``; what is drawn beside them has the name of its kind.
        rgba: (H, W, 4).
        facts: What was decided, for people.
    """

    stage: str
    rgba: NDArray[np.uint8]
    facts: dict[str, Any]


def quick_settings(settings: RenderSettings) -> RenderSettings:
    """Return the settings that the quickest engine can follow: no rays, so no glass and no parted colours.

    Examples:
        >>> settings = RenderSettings().updated({"lens": {"coma": 2}, "aperture": {"blades": 6}})
        >>> quick_settings(settings).to_table()
        {'aperture': {'blades': 6}, 'engine': {'name': 'scatter'}}
    """
    table = settings.to_table()
    for gone in (LensSettings.GROUP, ColorSettings.GROUP, EngineSettings.GROUP):
        table.pop(gone, None)
    device = {} if settings.engine.device == "cpu" else {"device": settings.engine.device}
    return RenderSettings().updated({**table, "engine": {"name": "scatter", **device}})


def refine(
    scene: Scene, settings: RenderSettings, space: Any, shown: str, stage: str, *, report: Progress
) -> Picture:
    """Render by the engine that is asked for; a task of the helper."""
    return _render(_renderer(), scene, settings, space, shown, stage, report)


@cache
def _renderer() -> BokehRenderer:
    """One for the process, which keeps its engines."""
    return BokehRenderer()


class Previews:
    """Renders previews: quick ones here, one at a time, the engine's own in the helper.

    Args:
        helper: Refines.
    """

    def __init__(self, helper: Helper) -> None:
        self._helper = helper
        self._turn = threading.Lock()
        # Seconds a pixel of the last pictures, by whether they were of the screen's size and discs are plain.
        self._pace = {(True, True): 2e-7, (True, False): 3e-7, (False, True): 4e-7, (False, False): 6e-7}
        self._latest: dict[str, threading.Event] = {}
        # Shapes of the opening that are laid out here, beside plain discs.
        self._ready: deque[ApertureSettings] = deque(maxlen=MAX_CACHED_APERTURES - 1)
        self._closed = threading.Event()

    def begin(self, client: str) -> threading.Event:
        """Return the signal that ends a preview; that of the same page before it is set."""
        signal = threading.Event()
        before = self._latest.get(client)
        if before is not None:
            before.set()
        self._latest[client] = signal
        if client != _THUMBNAIL and _THUMBNAIL in self._latest:
            self._latest[_THUMBNAIL].set()
        return signal

    def begin_thumbnail(self) -> threading.Event:
        """The same for one of the looks, which any preview ends."""
        return self.begin(_THUMBNAIL)

    def lay_out_ahead(self, shapes: Iterable[ApertureSettings]) -> None:
        """Lay shapes of the opening out in the background, one after the other."""
        threading.Thread(target=self._lay_out_all, args=(tuple(shapes),), daemon=True).start()

    def close(self) -> None:
        """Lay nothing out any more."""
        self._closed.set()

    def _lay_out_all(self, shapes: tuple[ApertureSettings, ...]) -> None:
        for shape in shapes:
            if self._closed.wait(_BETWEEN):
                return
            self._lay_out(shape)

    def _lay_out(self, shape: ApertureSettings) -> None:
        if shape != ApertureSettings() and shape not in self._ready:
            prepare_tables(make_aperture(shape), LARGEST_TABLE)
            self._ready.append(shape)

    def stages(
        self,
        opened: Opened,
        settings: RenderSettings,
        size: tuple[int, int],
        shown: str,
        cancel: CancelSignal,
        progress: Progress,
        region: Region | None = None,
        held: bool = False,
    ) -> Iterator[Picture]:
        """Yield pictures, each better than the one before, until it is the engine's or cancelled.

        Args:
            opened: What is looked at.
            settings: All that is asked for.
            size: Of the preview, width and height, pixels.
            shown: Space of the canvas.
            cancel: Once it is set, this ends by ``RenderCancelled``.
            progress: Of the engine's picture.
            region: A part to be shown in full, in place of the whole at ``size``.
            held: Whether the hand goes on, as while a slider is dragged.

        Raises:
            BokehnetError: The settings do not fit to the picture.
            RenderCancelled: ``cancel`` was set.
        """
        scene, inside = self._scene(opened, settings, size, region)
        wanted = opened.at_size(settings, 1.0 if region else size[0] / opened.size[0])
        quick, engine = quick_settings(wanted), settings.engine.name or "rays"
        ready = _is_plain(quick) or quick.aperture in self._ready
        small = size if region else self._first_size(size, ready and _is_plain(quick), held)
        if small != size or not ready:
            few = opened.at_size(settings, small[0] / opened.size[0])
            first = replace(quick_settings(few), aperture=quick.aperture if ready else ApertureSettings())
            view = scene if region else opened.view(small, settings)
            yield _cut(self._quick(opened, view, first, shown, "draft", cancel), inside)
            if held:
                _rest(cancel)
        if ready:
            yield _cut(self._quick(opened, scene, quick, shown, "scatter", cancel), inside)
        else:  # its shape takes long to be laid out, which must not keep the next change waiting
            task = (scene, quick, opened.space, shown, "scatter")
            yield _cut(self._helper.run(refine, *task, cancel=cancel), inside)
        if engine != "scatter":
            task = (scene, wanted, opened.space, shown, "final")
            yield _cut(self._helper.run(refine, *task, progress=progress, cancel=cancel), inside)
        if not ready and not cancel.is_set():
            self._lay_out(quick.aperture)

    def _first_size(self, size: tuple[int, int], plain: bool, held: bool) -> tuple[int, int]:
        """Size of the first picture: as large as it can be within its time."""
        if size[0] * size[1] * self._pace[True, plain] < (_WHOLE_HELD if held else _WHOLE):
            return size
        seconds = size[0] * size[1] * self._pace[False, plain]
        share = next((side for side in _FIRST if side**2 * seconds < _AT_ONCE), _FIRST[-1])
        return max(16, round(size[0] * share)), max(16, round(size[1] * share))

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
            picture = _render(_renderer(), scene, settings, opened.space, shown, stage, _untold)
            pace = (perf_counter() - begun) / (picture.rgba.shape[0] * picture.rgba.shape[1])
            kind = stage == "scatter", _is_plain(settings)
            self._pace[kind] += 0.3 * (pace - self._pace[kind])
            return picture

    def _scene(
        self, opened: Opened, settings: RenderSettings, size: tuple[int, int], region: Region | None
    ) -> tuple[Scene, Region | None]:
        """What is rendered, and the part of it that is shown."""
        if region is None:
            return opened.view(size, settings), None
        around = round(_MARGIN * self._largest(opened, settings)) + 8
        left, top = max(region.x - around, 0), max(region.y - around, 0)
        right = min(region.x + region.width + around, opened.size[0])
        bottom = min(region.y + region.height + around, opened.size[1])
        whole = Region(x=left, y=top, width=right - left, height=bottom - top)
        inside = Region(x=region.x - left, y=region.y - top, width=region.width, height=region.height)
        return opened.view(size, settings, whole), inside

    def _largest(self, opened: Opened, settings: RenderSettings) -> float:
        """Largest blur radius in pixels of the file, found on a small view."""
        small = opened.fitted(96, 96)
        factor = small[0] / opened.size[0]
        told = quick_settings(opened.at_size(settings, factor))
        defocus = _renderer().prepare(opened.view(small, settings), told).defocus
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
    found = result.report
    distance = found.focus_distance
    facts = {
        "engine": found.engine,
        "largest_blur": found.largest_blur,
        "focus_disparity": found.focus_disparity,
        "focus_distance": None if distance is None or not np.isfinite(distance) else distance,
        "notes": list(found.notes),
    }
    rgba = to_rgba(result.bokeh, space, shown)
    return Picture(stage=stage, rgba=rgba, facts=facts | {"seconds": perf_counter() - begun})


def _rest(cancel: CancelSignal) -> None:
    """Wait a moment for the next change, as while a slider is dragged: what is begun cannot be given up."""
    for _ in range(_MOMENTS):
        sleep(_MOMENT)
        if cancel.is_set():
            raise RenderCancelled("rendering was cancelled")


def _is_plain(settings: RenderSettings) -> bool:
    """Whether points of light become plain discs, the quickest shape."""
    return settings.aperture == ApertureSettings()


def _cut(picture: Picture, part: Region | None) -> Picture:
    if part is None:
        return picture
    rows, columns = slice(part.y, part.y + part.height), slice(part.x, part.x + part.width)
    return Picture(
        stage=picture.stage, rgba=np.ascontiguousarray(picture.rgba[rows, columns]), facts=picture.facts
    )


def _untold(done: int, total: int) -> None:
    """Progress that nobody follows."""
