"""Decisions for all frames of a shot: temporally filtered maps, and the plan of their repair."""

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from bokehnet.depth_repair.repair_plan import RepairPlan, common_plan
from bokehnet.errors import BokehnetError
from bokehnet.io.files.atomic import write_text
from bokehnet.progress import Progress, ignore_progress
from bokehnet.render.renderer import BokehRenderer
from bokehnet.scene.depth.depth_map import DepthMap, Kind, Photo
from bokehnet.scene.depth.depth_source import DepthSource, NetworkDepth, depth_source
from bokehnet.scene.scene import Scene, map_at_picture_size
from bokehnet.sequence.filtered_shot import FilteredShot
from bokehnet.settings.settings import RenderSettings

__all__ = ["FilteredDepth", "Shot", "ShotFrames", "analyse_shot", "can_filter_maps", "open_source"]

Array = npt.NDArray[np.float32]

_PROBE_FRAMES = 5  # frames, evenly spaced over the shot, that decide about the repair of its maps


@dataclass(frozen=True, kw_only=True, slots=True)
class Shot:
    """Decisions for a shot.

    Attributes:
        plan: Plan of the repair of its maps; None if the settings fix it, or each frame decides.
        steady: Filtered maps; None if the maps are used unfiltered.

    Examples:
        >>> Shot().source(0, RenderSettings()) is None
        True
    """

    plan: RepairPlan | None = None
    steady: FilteredShot | None = None

    def source(self, index: int, settings: RenderSettings) -> DepthSource | None:
        """Return the source of filtered depth of a frame; None if its settings define the source."""
        if self.steady is None or not self.steady.has(index):
            return None
        own = depth_source(settings)
        return FilteredDepth(shot=self.steady, index=index, origin=own.origin, kind=own.kind or "relative")


@dataclass(frozen=True, kw_only=True, slots=True)
class FilteredDepth:
    """Depth source that reads the filtered map of a frame.

    Attributes:
        shot: Filtered maps of the shot.
        index: Index of the frame in the shot.
        origin: Setting that names the original maps.
        kind: Kind of the original maps.

    Examples:
        >>> maps = FilteredShot(Path("maps"))
        >>> image, values = np.ones((32, 32, 3), np.float32), np.full((32, 32), 0.25, np.float32)
        >>> maps.filter([(image, values)] * 3, 3)
        >>> source = FilteredDepth(shot=maps, index=1, origin="input.disparity", kind="relative")
        >>> from bokehnet.scene.scene import make_scene
        >>> float(make_scene(image, source).depth.values[0, 0])
        0.25
    """

    shot: FilteredShot
    index: int
    origin: str
    kind: Kind

    @property
    def tells_focus(self) -> bool:
        """True if the picture's file may define the focus, because distances are metric."""
        return self.kind == "metric"

    def depth_map(self, photo: Photo) -> DepthMap:
        """See :class:`DepthSource`."""
        camera = photo.camera if self.kind == "metric" else None
        return DepthMap(values=self.shot.read(self.index), kind=self.kind, origin=self.origin, camera=camera)


class ShotFrames(Protocol):
    """Frames of a shot, from any source.

    Attributes:
        count: Number of frames.

    Examples:
        >>> class Black:  # two equal black frames
        ...     count = 2
        ...     def settings_of(self, index):
        ...         return RenderSettings().updated({"camera": {"blur": 1}, "focus": {"value": 0}})
        ...     def scenes(self, indices, shot):
        ...         from bokehnet.scene.depth.depth_source import ConstantDisparity
        ...         from bokehnet.scene.scene import make_scene
        ...         flat = ConstantDisparity(value=0)
        ...         return (make_scene(np.zeros((32, 32, 3), np.float32), flat) for index in indices)
        >>> analyse_shot(Black(), BokehRenderer("scatter"), folder=None, steady=False).plan is None
        True
    """

    @property
    def count(self) -> int:
        """Number of frames."""
        ...

    def settings_of(self, index: int) -> RenderSettings:
        """Return the settings of a frame, counted from 0."""
        ...

    def scenes(self, indices: Sequence[int], shot: Shot) -> Iterator[Scene | None]:
        """Yield these frames, ascending, with the filtered maps of ``shot``; None for unreadable frames."""
        ...


def can_filter_maps(settings: RenderSettings, *, many: bool) -> bool:
    """Return whether the maps of a shot can be filtered: relative maps, and estimates per frame.

    Maps of depth in metres and of blur are treated as exact, and so are those of supersampled pictures.

    Args:
        settings: Settings of any of its frames.
        many: True if its frames have maps of their own.

    Examples:
        >>> from bokehnet.settings.settings import InputSettings
        >>> can_filter_maps(RenderSettings(input=InputSettings(disparity="d.####.png")), many=True)
        True
    """
    inputs = settings.input
    relative = inputs.disparity is not None or inputs.depth_model is not None
    return relative and many and inputs.supersampled == 1


def analyse_shot(
    frames: ShotFrames,
    renderer: BokehRenderer,
    *,
    folder: Path | None,
    steady: bool,
    begin: Callable[[str], Progress] = lambda label: ignore_progress,
) -> Shot:
    """Analyse a shot, and decide on the steps that must be equal in all its frames.

    Args:
        frames: Frames of the shot.
        renderer: Renderer for the settings of the frames.
        folder: Folder that keeps the decisions for a resumed run; None keeps nothing.
        steady: True filters the maps, in ``folder``, which must not be None.
        begin: Called at the start of each stage with its label; returns its progress callback.

    Raises:
        BokehnetError: The folder cannot be written.

    Examples:
        >>> class Frames:  # a minimal shot; see VideoJob
        ...     count = 1
        ...     def settings_of(self, index):
        ...         return RenderSettings()
        ...     def scenes(self, indices, shot):
        ...         return iter(())
        >>> analyse_shot(Frames(), BokehRenderer("scatter"), folder=None, steady=False)
        Shot(plan=None, steady=None)
    """
    maps = FilteredShot(folder / "maps") if steady and folder is not None else None
    if maps is not None and not maps.is_done:
        maps.filter(_frames_with_maps(frames), frames.count, begin("steadying the maps"))
    shot = Shot(steady=maps)
    if frames.count < 2 or frames.settings_of(0).depth.repair != "auto":
        return shot
    plan_file = None if folder is None else folder / "repair.json"
    if plan_file is not None and plan_file.exists():
        table = json.loads(plan_file.read_text(encoding="utf-8"))
        plan = (
            None if table is None else RepairPlan(**{**table, "offset": tuple(table.get("offset", (0, 0)))})
        )
    else:
        plan = _plan(frames, renderer, shot, begin("looking at the shot"))
        if plan_file is not None:
            write_text(plan_file, json.dumps(None if plan is None else asdict(plan)))
    return Shot(plan=plan, steady=maps)


def open_source(settings: RenderSettings) -> DepthSource:
    """Return the depth source of the settings for many frames: a network is opened once.

    Examples:
        >>> from bokehnet.settings.settings import InputSettings
        >>> open_source(RenderSettings(input=InputSettings(disparity="d.png"))).origin
        'input.disparity'
    """
    source = depth_source(settings)
    return source.opened() if isinstance(source, NetworkDepth) else source


def _frames_with_maps(frames: ShotFrames) -> Iterator[tuple[Array, Array] | None]:
    for index, scene in enumerate(frames.scenes(range(frames.count), Shot())):
        try:
            frame = None
            if scene is not None:
                depth_settings = frames.settings_of(index).depth
                frame = scene.image, map_at_picture_size(scene, depth_settings)
        except BokehnetError:  # reported when the frame is rendered
            frame = None
        yield frame


def _plan(frames: ShotFrames, renderer: BokehRenderer, shot: Shot, report: Progress) -> RepairPlan | None:
    """Return the common repair plan of the probe frames; None if no map of them may be repaired."""
    last = frames.count - 1
    probes = sorted({round(fraction * last) for fraction in np.linspace(0, 1, _PROBE_FRAMES)})
    plans: list[RepairPlan] = []
    for done, (index, scene) in enumerate(zip(probes, frames.scenes(probes, shot), strict=True)):
        report(done, len(probes))
        try:
            probe_plan: Any = scene and renderer.prepare(scene, frames.settings_of(index)).repair_plan
        except BokehnetError:
            continue
        plans += [probe_plan] if probe_plan is not None else []
    report(len(probes), len(probes))
    return common_plan(plans) if plans else None
