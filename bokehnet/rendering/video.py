"""A video rendered: its shot looked through once, its frames in segments, what is done kept until all is."""

import hashlib
import json
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path

import numpy as np
import numpy.typing as npt

from bokehnet.errors import ParameterError
from bokehnet.inference.engine import Progress
from bokehnet.inference.repair_plan import RepairPlan, common_plan
from bokehnet.inference.steady_shot import SteadyShot
from bokehnet.io.atomic import check_target, remove_leftovers, write_text
from bokehnet.io.video import (
    VIDEO_EXTENSIONS,
    VideoInfo,
    is_video,
    join_segments,
    read_luma,
    read_video,
    video_info,
    write_segment,
)
from bokehnet.io.window import Window
from bokehnet.rendering.depth_source import DepthSource, RelativeDisparity, depth_source
from bokehnet.rendering.focus import check_focus
from bokehnet.rendering.renderer import BokehRenderer
from bokehnet.rendering.scene import Scene, fitted_map, make_scene
from bokehnet.rendering.sequence import Pull, input_files, settings_at_frame
from bokehnet.rendering.settings import RenderSettings
from bokehnet.version import __version__

__all__ = ["VideoJob", "VideoReport"]

Array = npt.NDArray[np.float32]

# Frames of a segment: what a stop loses at most.
SEGMENT = 24

# Frames, evenly over the shot, that decide about the repair of its maps.
_PROBES = 5

_MAPS = (".png", ".exr", ".tif", ".tiff", ".pfm", ".jpg", ".jpeg", ".webp")


@dataclass(frozen=True, kw_only=True, slots=True)
class VideoReport:
    """What was done.

    Attributes:
        frames: Of the video.
        rendered: Of these, in this run.
        plan: What was decided about the repair of the maps; None where they are left alone.
        steady: Whether the maps were made steady.

    Examples:
        >>> report = VideoReport(frames=240, rendered=48, plan=None, steady=True)
        >>> f"{report.frames - report.rendered} frames were there already"
        '192 frames were there already'
    """

    frames: int
    rendered: int
    plan: RepairPlan | None
    steady: bool


@dataclass(frozen=True, kw_only=True, slots=True)
class VideoJob:
    """A video to render.

    Attributes:
        info: Of the video.
        output: Where the result goes.
        settings: All else; ``input.disparity`` may be a folder of maps, one for each frame in the order of
            their names, or a video.
        codec: Of the result, one of :data:`bokehnet.io.video.CODECS`.
        pull: What changes over the frames, of which the first is 1.
        steady: Whether relative maps are made steady along the motion of the shot.

    Examples:
        >>> from fractions import Fraction
        >>> from bokehnet.io.color_space import SRGB
        >>> shape = {"width": 640, "height": 360, "pixels": "yuv420p", "codes": (1, 1, 1), "full": False}
        >>> rate = {"times": (0, 1, 2), "time_base": Fraction(1, 25), "rate": Fraction(25)}
        >>> info = VideoInfo(path=Path("clip.mp4"), space=SRGB, **shape, **rate)
        >>> job = VideoJob(info=info, output=Path("out.mp4"), settings=RenderSettings(), codec="h264")
        >>> job.folder.name  # what is done is kept there until all is
        '.bokehnet-video-out.mp4'
    """

    info: VideoInfo
    output: Path
    settings: RenderSettings
    codec: str
    pull: Pull = field(default_factory=Pull)
    steady: bool = True

    @property
    def folder(self) -> Path:
        """Where segments and maps are kept until all is done."""
        return self.output.with_name(f".bokehnet-video-{self.output.name}")

    def run(
        self,
        renderer: BokehRenderer,
        begin: Callable[[str], Progress] = lambda label: _untold,
    ) -> VideoReport:
        """Render what is not rendered yet, and join it.

        A run that is stopped leaves what it has done in :attr:`folder`; the same job goes on from there. The
        folder of another job, as with other settings or another file, is emptied first.

        Args:
            renderer: Fit for the settings.
            begin: Is told of every stage; gives what its progress is reported to.

        Raises:
            BokehnetError: A file cannot be read or written, or numbers and files do not fit together.
        """
        count, folder = len(self.info.times), self.folder
        self._claim()
        steady = self._steady_shot()
        if steady is not None:
            steady.make(self._maps_of_shot(), count, begin("steadying the maps"))
        plan = self._plan(renderer, steady, begin)
        names = [folder / f"{first:06d}.npz" for first in range(0, count, SEGMENT)]
        missing = [index for index, name in enumerate(names) if not name.exists()]
        report, rendered = begin("rendering frames"), 0
        if missing:
            scenes = self._scenes(steady, missing[0] * SEGMENT)
            for index in range(missing[0], len(names)):
                first, last = index * SEGMENT, min(count, (index + 1) * SEGMENT)
                part = islice(scenes, last - first)
                if index not in missing:
                    for _ in part:
                        pass
                    continue

                def pictures(first: int = first, part: Iterator[Scene] = part) -> Iterator[tuple[int, Array]]:
                    nonlocal rendered
                    for number, scene in enumerate(part, first):
                        report(number, count)
                        settings = settings_at_frame(self._settings(number), number + 1, self.pull)
                        focused = renderer.prepare(scene, settings, plan=plan)
                        result = renderer.render(focused, settings)
                        rendered += 1
                        yield self.info.times[number], result.bokeh

                write_segment(names[index], self.info, pictures(), self.codec)
        report(count, count)
        join_segments(self.output, self.info, names, self.codec)
        shutil.rmtree(folder, ignore_errors=True)
        return VideoReport(frames=count, rendered=rendered, plan=plan, steady=steady is not None)

    def check(self) -> None:
        """Raise unless the settings fit together and the result can be written; no frame is read."""
        given = self.settings
        if given.output.save_maps is not None:
            raise ParameterError("output.save_maps", expected="none for a video", shown="a folder")
        if given.input.supersampled > 1 or given.input.matte is not None:
            raise ParameterError(
                "input.matte" if given.input.matte is not None else "input.supersampled",
                expected="none for a video",
                shown="one",
            )
        check_target(self.output)
        if self.output.suffix.lower() not in VIDEO_EXTENSIONS:
            raise ParameterError(
                "--output", expected=f"one of {', '.join(VIDEO_EXTENSIONS)}", shown=str(self.output)
            )
        if self.output.resolve() == self.info.path.resolve():
            raise ParameterError("--output", expected="another file than the video", shown=str(self.output))
        for index in (0, len(self.info.times) - 1):
            settings = settings_at_frame(self._settings(index), index + 1, self.pull)
            if settings.input.disparity is None or not is_video(settings.input.disparity):
                check_focus(settings)

    def _claim(self) -> None:
        """Make the folder, empty unless it is of this very job."""
        state = self.info.path.stat()
        told = {
            "settings": self.settings.to_table(),
            "video": [str(self.info.path.resolve()), state.st_size, state.st_mtime_ns],
            "codec": self.codec,
            "pull": {name: [list(key) for key in keys] for name, keys in self.pull.keys.items()},
            "steady": self.steady,
            "version": __version__,
            "maps": [[str(path), path.stat().st_size, path.stat().st_mtime_ns] for path in self._map_files()],
        }
        digest = hashlib.sha256(json.dumps(told, sort_keys=True, default=str).encode()).hexdigest()
        mark = self.folder / "job.txt"
        if mark.exists() and mark.read_text(encoding="utf-8") == digest:
            remove_leftovers(self.folder)
            return
        shutil.rmtree(self.folder, ignore_errors=True)
        self.folder.mkdir(parents=True)
        write_text(mark, digest)

    def _map_files(self) -> list[Path]:
        """The files that tell the depth, of all frames."""
        given = self.settings.input.disparity
        if given is not None and given.is_dir():
            return _maps_in(given, len(self.info.times))
        numbers = range(1, len(self.info.times) + 1)
        files = [path for n in numbers for path in input_files(settings_at_frame(self.settings, n)).values()]
        return [path for path in dict.fromkeys(files) if path.exists()]

    def _settings(self, index: int) -> RenderSettings:
        """The settings of a frame, without what is pulled."""
        given = self.settings.input.disparity
        if given is None or not given.is_dir():
            return self.settings
        one = replace(self.settings.input, disparity=_maps_in(given, len(self.info.times))[index])
        return replace(self.settings, input=one, depth=replace(self.settings.depth, as_stored=True))

    def _sources(self, first: int) -> Iterator[DepthSource]:
        """What tells the depth of each frame from one on."""
        given, reading = self.settings.input.disparity, self.settings.depth
        if given is not None and is_video(given):
            info = video_info(given)
            if len(info.times) != len(self.info.times):
                raise ParameterError(
                    "input.disparity",
                    expected=f"as many frames as {self.info.path} has, {len(self.info.times)}",
                    shown=f"{len(info.times)} in {given}",
                )
            for values in islice(read_luma(info), first, None):
                yield RelativeDisparity(
                    map=values, invert=reading.invert, value_range=reading.value_range, as_stored=True
                )
            return
        for index in range(first, len(self.info.times)):
            yield depth_source(settings_at_frame(self._settings(index), index + 1))

    def _raw_scenes(self, first: int) -> Iterator[Scene]:
        window = Window.whole(self.info.width, self.info.height)
        pairs = zip(read_video(self.info, first), self._sources(first), strict=True)
        for number, (image, source) in enumerate(pairs, first + 1):
            yield make_scene(image, source, window=window, number=number)

    def _scenes(self, steady: SteadyShot | None, first: int) -> Iterator[Scene]:
        for index, scene in enumerate(self._raw_scenes(first), first):
            if steady is None:
                yield scene
            else:
                depth = replace(scene.depth, values=steady.read(index), filtered=None)
                yield replace(scene, depth=depth)

    def _steady_shot(self) -> SteadyShot | None:
        """Where steady maps are kept; None where maps are exact, one for all frames, or not to be touched."""
        given = self.settings.input
        many = given.depth_model is not None or len(self._map_files()) > 1
        many = many or (given.disparity is not None and is_video(given.disparity))
        relative = given.disparity is not None or given.depth_model is not None
        return SteadyShot(self.folder / "maps") if self.steady and relative and many else None

    def _maps_of_shot(self) -> Iterator[tuple[Array, Array]]:
        for scene in self._raw_scenes(0):
            yield scene.image, fitted_map(scene, self.settings.depth)

    def _plan(
        self, renderer: BokehRenderer, steady: SteadyShot | None, begin: Callable[[str], Progress]
    ) -> RepairPlan | None:
        """What is decided about the repair of maps, once; it is kept beside the segments."""
        if self.settings.depth.repair != "auto":
            return None
        kept, count = self.folder / "repair.json", len(self.info.times)
        if kept.exists():
            found = json.loads(kept.read_text(encoding="utf-8"))
            return None if found is None else RepairPlan(**found)
        probes = {round(share * (count - 1)) for share in np.linspace(0, 1, _PROBES)}
        plans, report = [], begin("looking at the shot")
        for index, scene in enumerate(self._scenes(steady, 0)):
            if index in probes:
                settings = settings_at_frame(self._settings(index), index + 1, self.pull)
                found = renderer.prepare(scene, settings).repair_plan
                plans += [] if found is None else [found]
            report(index + 1, count)
        plan = common_plan(plans) if plans else None
        told = None
        if plan is not None:
            told = {"repaired": plan.repaired, "softness": plan.softness, "shift": plan.shift}
        write_text(kept, json.dumps(told))
        return plan


def _maps_in(folder: Path, count: int) -> list[Path]:
    """The maps in a folder, in the order of their names, one for each of so many frames."""
    found = sorted(path for path in folder.iterdir() if path.suffix.lower() in _MAPS and path.name[0] != ".")
    if len(found) != count:
        raise ParameterError(
            "input.disparity",
            expected=f"a folder with a map for each of {count} frames",
            shown=f"{len(found)} in {folder}",
        )
    return found


def _untold(done: int, total: int) -> None:
    """Progress that nobody follows."""
