"""What is decided once for all frames of a shot: steady maps, and the plan of their repair."""

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from bokehnet.depth_repair.repair_plan import RepairPlan, common_plan
from bokehnet.errors import BokehnetError
from bokehnet.io.atomic import write_text
from bokehnet.progress import Progress
from bokehnet.render.renderer import BokehRenderer
from bokehnet.scene.depth.depth_map import DepthMap, Kind, Photo
from bokehnet.scene.depth.depth_source import DepthSource, NetworkDepth, depth_source
from bokehnet.scene.scene import Scene, fitted_map
from bokehnet.sequence.filtered_shot import SteadyShot
from bokehnet.settings.settings import RenderSettings

__all__ = ["Shot", "ShotFrames", "SteadyDepth", "decide_shot", "gets_steady", "open_source"]

Array = npt.NDArray[np.float32]

# Frames, evenly over the shot, that decide about the repair of its maps.
_PROBES = 5


@dataclass(frozen=True, kw_only=True, slots=True)
class Shot:
    """What was decided for a shot.

    Attributes:
        plan: About the repair of its maps; None where that is not left to us, or each frame decides.
        steady: Its steady maps; None where maps are taken as they are.

    Examples:
        >>> Shot().source(0, RenderSettings()) is None
        True
    """

    plan: RepairPlan | None = None
    steady: SteadyShot | None = None

    def source(self, index: int, settings: RenderSettings) -> DepthSource | None:
        """What tells the depth of a frame in place of what its settings name; None: they do."""
        if self.steady is None or not self.steady.has(index):
            return None
        own = depth_source(settings)
        return SteadyDepth(shot=self.steady, index=index, origin=own.origin, kind=own.kind or "relative")


@dataclass(frozen=True, kw_only=True, slots=True)
class SteadyDepth:
    """The steady map of a frame.

    Attributes:
        shot: Where it is kept.
        index: Of the frame in the shot.
        origin: The setting that names the maps it is made of.
        kind: Theirs.

    Examples:
        >>> maps = SteadyShot(Path("maps"))
        >>> image, values = np.ones((32, 32, 3), np.float32), np.full((32, 32), 0.25, np.float32)
        >>> maps.make([(image, values)] * 3, 3)
        >>> source = SteadyDepth(shot=maps, index=1, origin="input.disparity", kind="relative")
        >>> from bokehnet.scene.scene import make_scene
        >>> float(make_scene(image, source).depth.values[0, 0])
        0.25
    """

    shot: SteadyShot
    index: int
    origin: str
    kind: Kind

    @property
    def tells_focus(self) -> bool:
        """Where distances are known, the picture's file may."""
        return self.kind == "metric"

    def depth_map(self, photo: Photo) -> DepthMap:
        """See :class:`DepthSource`."""
        camera = photo.camera if self.kind == "metric" else None
        return DepthMap(values=self.shot.read(self.index), kind=self.kind, origin=self.origin, camera=camera)


class ShotFrames(Protocol):
    """The frames of a shot, wherever they are.

    Attributes:
        count: How many there are.

    Examples:
        >>> class Black:  # two equal frames of nothing
        ...     count = 2
        ...     def settings_of(self, index):
        ...         return RenderSettings().updated({"camera": {"blur": 1}, "focus": {"value": 0}})
        ...     def scenes(self, wanted, shot):
        ...         from bokehnet.scene.depth.depth_source import ConstantDisparity
        ...         from bokehnet.scene.scene import make_scene
        ...         flat = ConstantDisparity(value=0)
        ...         return (make_scene(np.zeros((32, 32, 3), np.float32), flat) for index in wanted)
        >>> decide_shot(Black(), BokehRenderer("scatter"), folder=None, steady=False).plan is None
        True
    """

    @property
    def count(self) -> int:
        """See the class."""
        ...

    def settings_of(self, index: int) -> RenderSettings:
        """Return all that is asked for of a frame, counted from 0."""
        ...

    def scenes(self, wanted: Sequence[int], shot: Shot) -> Iterator[Scene | None]:
        """Give those frames, rising, with the steady maps of ``shot``; None for what cannot be read."""
        ...


def gets_steady(settings: RenderSettings, *, many: bool) -> bool:
    """Whether the maps of a shot are such as can be made steady: relative, or guessed frame by frame.

    Maps of depth in metres and of blur are taken as exact, and so are those of supersampled pictures.

    Args:
        settings: Of any of its frames.
        many: Whether its frames have maps of their own.

    Examples:
        >>> from bokehnet.settings.settings import InputSettings
        >>> gets_steady(RenderSettings(input=InputSettings(disparity="d.####.png")), many=True)
        True
    """
    given = settings.input
    relative = given.disparity is not None or given.depth_model is not None
    return relative and many and given.supersampled == 1


def decide_shot(
    frames: ShotFrames,
    renderer: BokehRenderer,
    *,
    folder: Path | None,
    steady: bool,
    begin: Callable[[str], Progress] = lambda label: _untold,
) -> Shot:
    """Look through a shot, and decide what is to be the same in all its frames.

    Args:
        frames: The shot.
        renderer: Fit for its settings.
        folder: Keeps what is decided, for a run that goes on where this one was stopped; None keeps nothing.
        steady: Whether maps are made steady, in ``folder``, which must be given.
        begin: Is told of every stage; gives what its progress is reported to.

    Raises:
        BokehnetError: The folder cannot be written.

    Examples:
        >>> class Frames:  # what VideoJob is
        ...     count = 1
        ...     def settings_of(self, index):
        ...         return RenderSettings()
        ...     def scenes(self, wanted, shot):
        ...         return iter(())
        >>> decide_shot(Frames(), BokehRenderer("scatter"), folder=None, steady=False)
        Shot(plan=None, steady=None)
    """
    maps = SteadyShot(folder / "maps") if steady and folder is not None else None
    if maps is not None and not maps.is_done:
        maps.make(_maps_of(frames), frames.count, begin("steadying the maps"))
    shot = Shot(steady=maps)
    if frames.count < 2 or frames.settings_of(0).depth.repair != "auto":
        return shot
    kept = None if folder is None else folder / "repair.json"
    if kept is not None and kept.exists():
        told = json.loads(kept.read_text(encoding="utf-8"))
        plan = None if told is None else RepairPlan(**{**told, "offset": tuple(told.get("offset", (0, 0)))})
    else:
        plan = _plan(frames, renderer, shot, begin("looking at the shot"))
        if kept is not None:
            write_text(kept, json.dumps(None if plan is None else asdict(plan)))
    return Shot(plan=plan, steady=maps)


def open_source(settings: RenderSettings) -> DepthSource:
    """Return what the settings name as the source of depth, for many frames: a network is opened once.

    Examples:
        >>> from bokehnet.settings.settings import InputSettings
        >>> open_source(RenderSettings(input=InputSettings(disparity="d.png"))).origin
        'input.disparity'
    """
    source = depth_source(settings)
    return source.opened() if isinstance(source, NetworkDepth) else source


def _maps_of(frames: ShotFrames) -> Iterator[tuple[Array, Array] | None]:
    for index, scene in enumerate(frames.scenes(range(frames.count), Shot())):
        try:
            found = (
                None if scene is None else (scene.image, fitted_map(scene, frames.settings_of(index).depth))
            )
        except BokehnetError:  # which is told when the frame is rendered
            found = None
        yield found


def _plan(frames: ShotFrames, renderer: BokehRenderer, shot: Shot, report: Progress) -> RepairPlan | None:
    """What most of some frames ask for; None where none of them has a map that may be repaired."""
    last = frames.count - 1
    probes = sorted({round(share * last) for share in np.linspace(0, 1, _PROBES)})
    plans: list[RepairPlan] = []
    for done, (index, scene) in enumerate(zip(probes, frames.scenes(probes, shot), strict=True)):
        report(done, len(probes))
        try:
            found: Any = scene and renderer.prepare(scene, frames.settings_of(index)).repair_plan
        except BokehnetError:
            continue
        plans += [found] if found is not None else []
    report(len(probes), len(probes))
    return common_plan(plans) if plans else None


def _untold(done: int, total: int) -> None:
    """Progress that nobody follows."""
