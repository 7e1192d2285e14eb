"""Decisions for all frames of a shot: filtered maps, the plan of their repair, and clipped light."""

import json
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from bokehnet.depth_repair.repair_plan import RepairPlan, common_plan
from bokehnet.errors import BokehnetError
from bokehnet.io.files.atomic import write_text
from bokehnet.light.temporal import FrameLight, steady_sums
from bokehnet.progress import Progress, ignore_progress
from bokehnet.render.renderer import BokehRenderer
from bokehnet.scene.depth.depth_map import DepthMap, Kind, Photo
from bokehnet.scene.depth.depth_source import DepthSource, NetworkDepth, depth_source
from bokehnet.scene.preparation.recovered_light import frame_light, is_photograph
from bokehnet.scene.scene import Scene, map_at_picture_size
from bokehnet.sequence.filtered_shot import FilteredShot, MapRemarks
from bokehnet.sequence.temporal_filter import REACH_FRAMES
from bokehnet.settings.settings import RenderSettings

__all__ = [
    "FilteredDepth",
    "Shot",
    "ShotFrames",
    "analyse_shot",
    "can_filter_maps",
    "frames_of_shot",
    "open_source",
    "probe_frames",
]

Array = npt.NDArray[np.float32]

_PROBE_FRAMES = 5  # frames, evenly spaced over the shot, that decide about the repair of its maps


@dataclass(frozen=True, kw_only=True, slots=True)
class Shot:
    """Decisions for a shot.

    Attributes:
        plan: Plan of the repair of its maps; None if the settings fix it, or each frame decides.
        steady: Filtered maps; None if the maps are used unfiltered.
        around: Number of frames that were read in addition to those to render.
        light: Light of the clipped regions of each frame by number, (regions, 3).

    Examples:
        >>> Shot().source(0, RenderSettings()) is None
        True
    """

    plan: RepairPlan | None = None
    steady: FilteredShot | None = None
    around: int = 0
    light: Mapping[int, npt.NDArray[np.float64]] = field(default_factory=dict)

    def for_frame(self, number: int) -> "Shot":
        """Return the decisions for one frame, without the light of the others."""
        return replace(self, light={key: sums for key, sums in self.light.items() if key == number})

    def lit(self, scene: Scene) -> Scene:
        """Return the scene of a frame with the clipped light of its shot."""
        sums = self.light.get(scene.number)
        return scene if sums is None else replace(scene, light_sums=sums)

    def source(self, number: int, settings: RenderSettings) -> DepthSource | None:
        """Return the source of filtered depth of a frame; None if its settings define the source."""
        if self.steady is None or not self.steady.has(number):
            return None
        own = depth_source(settings)
        return FilteredDepth(shot=self.steady, number=number, origin=own.origin, kind=own.kind or "relative")


@dataclass(frozen=True, kw_only=True, slots=True)
class FilteredDepth:
    """Depth source that reads the filtered map of a frame.

    Attributes:
        shot: Filtered maps of the shot.
        number: Number of the frame in the shot.
        origin: Setting that names the original maps.
        kind: Kind of the original maps.

    Examples:
        >>> maps = FilteredShot(Path("maps"))
        >>> image, values = np.ones((32, 32, 3), np.float32), np.full((32, 32), 0.25, np.float32)
        >>> maps.filter([(image, values)] * 3, range(3))
        >>> source = FilteredDepth(shot=maps, number=1, origin="input.disparity", kind="relative")
        >>> from bokehnet.scene.scene import make_scene
        >>> float(make_scene(image, source).depth.values[0, 0])
        0.25
    """

    shot: FilteredShot
    number: int
    origin: str
    kind: Kind

    @property
    def tells_focus(self) -> bool:
        """True if the picture's file may define the focus, because distances are metric."""
        return self.kind == "metric"

    def depth_map(self, photo: Photo) -> DepthMap:
        """See :class:`DepthSource`."""
        assumptions, notes = self.shot.remarks(self.number)
        return DepthMap(
            values=self.shot.read(self.number),
            kind=self.kind,
            origin=self.origin,
            camera=photo.camera if self.kind == "metric" else None,
            notes=notes,
            assumptions=assumptions,
        )


class ShotFrames(Protocol):
    """Frames of a shot, from any source.

    Attributes:
        numbers: Numbers of all frames that may be read, ascending: those to render, those within reach of the
            temporal filter, and those that decide about the repair.
        selected: Numbers of the frames to render.
        probes: Numbers of the frames that decide about the repair.
        are_files: True if each frame is a file, which can be a photograph whose clipped light is estimated.

    Examples:
        >>> class Black:  # two equal black frames
        ...     numbers = selected = probes = (0, 1)
        ...     are_files = False
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
    def numbers(self) -> Sequence[int]:
        """Numbers of all frames that may be read, ascending."""
        ...

    @property
    def selected(self) -> Collection[int]:
        """Numbers of the frames to render."""
        ...

    @property
    def probes(self) -> Collection[int]:
        """Numbers of the frames that decide about the repair."""
        ...

    @property
    def are_files(self) -> bool:
        """True if each frame is a file, which can be a photograph whose clipped light is estimated."""
        ...

    def settings_of(self, index: int) -> RenderSettings:
        """Return the settings of a frame, by its index in ``numbers``."""
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
        ...     numbers = selected = probes = (0,)
        ...     are_files = False
        ...     def settings_of(self, index):
        ...         return RenderSettings()
        ...     def scenes(self, indices, shot):
        ...         return iter(())
        >>> analyse_shot(Frames(), BokehRenderer("scatter"), folder=None, steady=False)
        Shot(plan=None, steady=None, around=0, light={})
    """
    maps = FilteredShot(folder / "maps") if steady and folder is not None else None
    near = _frames_within_reach(frames)
    numbers, lights = [frames.numbers[index] for index in near], dict[int, FrameLight | None]()
    if maps is not None and not maps.is_done:
        remarks: dict[int, MapRemarks] = {}
        maps.filter(
            _frames_with_maps(frames, near, lights, remarks),
            numbers,
            begin("steadying the maps"),
            selected=frames.selected,
            remarks=remarks,
        )
    light = _light(frames, near, lights, folder, begin)
    shot = Shot(
        steady=maps,
        around=0 if maps is None else len(frames.numbers) - len(frames.selected),
        light=light,
    )
    if len(frames.numbers) < 2 or frames.settings_of(0).depth.repair != "auto":
        return shot
    plan_file = None if folder is None else folder / "repair.json"
    if plan_file is not None and plan_file.exists():
        table = json.loads(plan_file.read_text(encoding="utf-8"))
        plan = (
            None if table is None else RepairPlan(**{**table, "offset": tuple(table.get("offset", (0, 0)))})
        )
    else:
        plan = _plan(frames, renderer, begin("looking at the shot"))
        if plan is not None and steady:  # what the filter leaves of it differs from the noise of the probes
            plan = replace(plan, noise=None)
        if plan_file is not None:
            write_text(plan_file, json.dumps(None if plan is None else asdict(plan)))
    return replace(shot, plan=plan)


def open_source(settings: RenderSettings) -> DepthSource:
    """Return the depth source of the settings for many frames: a network is opened once.

    Examples:
        >>> from bokehnet.settings.settings import InputSettings
        >>> open_source(RenderSettings(input=InputSettings(disparity="d.png"))).origin
        'input.disparity'
    """
    source = depth_source(settings)
    return source.opened() if isinstance(source, NetworkDepth) else source


def probe_frames(numbers: Sequence[int]) -> list[int]:
    """Return the frames that decide about the repair of a shot: five, evenly spaced.

    Examples:
        >>> probe_frames(range(101, 142))
        [101, 111, 121, 131, 141]
    """
    last = len(numbers) - 1
    return sorted({numbers[round(fraction * last)] for fraction in np.linspace(0, 1, _PROBE_FRAMES)})


def frames_of_shot(existing: Collection[int], selected: Collection[int]) -> list[int]:
    """Return the existing frames of the shots that some frames belong to, ascending.

    Frames that are farther apart than the reach of the temporal filter belong to different shots.

    Examples:
        >>> frames_of_shot([1, 2, 3, 1001, 1002], selected=[2])
        [1, 2, 3]
    """
    shots: list[list[int]] = []
    for number in sorted(existing):
        if shots and number - shots[-1][-1] <= REACH_FRAMES:
            shots[-1].append(number)
        else:
            shots.append([number])
    return [number for shot in shots if not set(selected).isdisjoint(shot) for number in shot]


def _frames_within_reach(frames: ShotFrames) -> list[int]:
    """Return the indices of the frames within reach of those to render."""
    selected = np.sort(np.fromiter(frames.selected, np.int64))
    numbers = np.asarray(frames.numbers, np.int64)
    after = np.searchsorted(selected, numbers - REACH_FRAMES)  # first selected frame not too far before
    near = (after < len(selected)) & (
        selected[np.minimum(after, len(selected) - 1)] <= numbers + REACH_FRAMES
    )
    return [int(index) for index in np.flatnonzero(near)]


def _light(
    frames: ShotFrames,
    indices: Sequence[int],
    lights: dict[int, FrameLight | None],
    folder: Path | None,
    begin: Callable[[str], Progress],
) -> Mapping[int, npt.NDArray[np.float64]]:
    """Return the clipped light of a shot, which ``folder`` keeps for a resumed run.

    Args:
        frames: Frames of the shot.
        indices: Indices of the frames within reach of those to render.
        lights: Light by number of frame, if it has been measured; filled otherwise.
        folder: Folder of the decisions; None keeps nothing.
        begin: Called at the start of the measurement with its label; returns its progress callback.
    """
    file = None if folder is None else folder / "light.json"
    if file is not None and file.exists():
        table = json.loads(file.read_text(encoding="utf-8"))
        return {int(key): np.array(sums, np.float64).reshape(-1, 3) for key, sums in table.items()}
    if not lights and _has_light(frames, indices):
        progress = begin("measuring clipped light")
        for done, _ in enumerate(_frames_with_maps(frames, indices, lights, {})):
            progress(done + 1, len(indices))
    light = steady_sums(lights, frames.selected)
    if file is not None and lights:
        write_text(file, json.dumps({str(key): sums.tolist() for key, sums in light.items()}))
    return light


def _has_light(frames: ShotFrames, indices: Sequence[int]) -> bool:
    """Return whether clipped light of these frames is estimated; reads the first one."""
    if not frames.are_files or len(indices) < 2:
        return False
    if frames.settings_of(indices[0]).highlights.threshold != "auto":
        return False
    first = next(frames.scenes(indices[:1], Shot()), None)
    return first is not None and is_photograph(first)


def _frames_with_maps(
    frames: ShotFrames,
    indices: Sequence[int],
    lights: dict[int, FrameLight | None],
    remarks: dict[int, MapRemarks],
) -> Iterator[tuple[Array, Array] | None]:
    """Yield pictures and maps of frames, None for unreadable ones.

    Fills ``lights`` with their clipped light and ``remarks`` with the remarks on their maps, by number.
    """
    for index, scene in zip(indices, frames.scenes(indices, Shot()), strict=True):
        try:
            frame = None
            if scene is not None:
                settings = frames.settings_of(index)
                frame = scene.image, map_at_picture_size(scene, settings.depth)
                remarks[frames.numbers[index]] = scene.depth.assumptions, scene.depth.notes
                if settings.highlights.threshold == "auto":
                    lights[frames.numbers[index]] = frame_light(scene, frame[1], settings.input)
        except BokehnetError:  # reported when the frame is rendered
            frame = None
        yield frame


def _plan(frames: ShotFrames, renderer: BokehRenderer, report: Progress) -> RepairPlan | None:
    """Return the common repair plan of the probe frames; None if no map of them may be repaired.

    Probes keep their unfiltered maps, so that a part of a shot reads no other frames around them.
    """
    probes = [index for index, number in enumerate(frames.numbers) if number in set(frames.probes)]
    plans: list[RepairPlan] = []
    for done, (index, scene) in enumerate(zip(probes, frames.scenes(probes, Shot()), strict=True)):
        report(done, len(probes))
        try:
            probe_plan: Any = scene and renderer.prepare(scene, frames.settings_of(index)).repair_plan
        except BokehnetError:
            continue
        plans += [probe_plan] if probe_plan is not None else []
    report(len(probes), len(probes))
    return common_plan(plans) if plans else None
