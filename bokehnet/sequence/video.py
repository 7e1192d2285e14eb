"""A video rendered: its shot looked through once, its frames in segments, what is done kept until all is."""

import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from bokehnet.depth_repair.repair_plan import RepairPlan
from bokehnet.errors import ParameterError
from bokehnet.io.atomic import check_target
from bokehnet.io.video.frames import (
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
from bokehnet.progress import Progress
from bokehnet.render.renderer import BokehRenderer
from bokehnet.scene.depth.depth_source import DepthSource, NetworkDepth, RelativeDisparity
from bokehnet.scene.focus import check_focus
from bokehnet.scene.scene import Scene, make_scene
from bokehnet.sequence.resumable_folder import claim_folder, stamp
from bokehnet.sequence.sequence import Pull, input_files, settings_at_frame
from bokehnet.sequence.shot import Shot, decide_shot, gets_steady, open_source
from bokehnet.settings.settings import RenderSettings
from bokehnet.version import __version__

__all__ = ["VideoJob", "VideoReport"]

Array = npt.NDArray[np.float32]

# Frames of a segment: what a stop loses at most.
SEGMENT = 24

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
        codec: Of the result, one of :data:`bokehnet.io.video.frames.CODECS`.
        pull: What changes over the frames, of which the first is 1.
        steady: Whether relative maps are made steady along the motion of the shot.

    Examples:
        >>> from fractions import Fraction
        >>> from bokehnet.io.color.color_space import SRGB
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
    def count(self) -> int:
        """Frames of the video."""
        return len(self.info.times)

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
        folder, count = self.folder, self.count
        self._claim()
        shot = decide_shot(self, renderer, folder=folder, steady=self._gets_steady(), begin=begin)
        names = [folder / f"{first:06d}.npz" for first in range(0, count, SEGMENT)]
        missing = [index for index, name in enumerate(names) if not name.exists()]
        wanted = [n for part in missing for n in range(part * SEGMENT, min(count, (part + 1) * SEGMENT))]
        report, scenes = begin("rendering frames"), self.scenes(wanted, shot)

        def pictures(first: int) -> Iterator[tuple[int, Array]]:
            for number in range(first, min(count, first + SEGMENT)):
                report(number, count)
                settings = self.settings_of(number)
                focused = renderer.prepare(next(scenes), settings, plan=shot.plan)
                yield self.info.times[number], renderer.render(focused, settings).bokeh

        for part in missing:
            write_segment(names[part], self.info, pictures(part * SEGMENT), self.codec)
        report(count, count)
        join_segments(self.output, self.info, names, self.codec)
        shutil.rmtree(folder, ignore_errors=True)
        return VideoReport(frames=count, rendered=len(wanted), plan=shot.plan, steady=shot.steady is not None)

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
        for index in (0, self.count - 1):
            settings = self.settings_of(index)
            if settings.input.disparity is None or not is_video(settings.input.disparity):
                check_focus(settings)

    def _claim(self) -> None:
        """Make the folder, empty unless it is of this very job."""
        told = {
            "settings": self.settings.to_table(),
            "video": stamp(self.info.path),
            "codec": self.codec,
            "pull": {name: [list(key) for key in keys] for name, keys in self.pull.keys.items()},
            "steady": self.steady,
            "version": __version__,
            "maps": [stamp(path) for path in self._map_files()],
        }
        claim_folder(self.folder, told)

    def _map_files(self) -> list[Path]:
        """The files that tell the depth, of all frames."""
        given = self.settings.input.disparity
        if given is not None and given.is_dir():
            return _maps_in(given, self.count)
        frames = (settings_at_frame(self.settings, n) for n in range(1, self.count + 1))
        files = [path for one in frames for path in input_files(one).values()]
        return [path for path in dict.fromkeys(files) if path.exists()]

    def settings_of(self, index: int) -> RenderSettings:
        """Return all that is asked for of a frame, counted from 0."""
        return settings_at_frame(self._unpulled(index), index + 1, self.pull)

    def scenes(self, wanted: Sequence[int], shot: Shot) -> Iterator[Scene]:
        """Give those frames, rising, with the steady maps of ``shot``; see :class:`ShotFrames`."""
        if not wanted:
            return
        window = Window.whole(self.info.width, self.info.height)
        picked, first = set(wanted), wanted[0]
        lumas = None if shot.steady is not None else self._lumas(first)
        network: DepthSource | None = None
        for index, image in enumerate(read_video(self.info, first), first):
            luma = None if lumas is None else next(lumas)
            if index not in picked:
                continue
            settings = settings_at_frame(self._unpulled(index), index + 1)
            source = shot.source(index, settings) or network
            if luma is not None:
                reading = settings.depth
                source = RelativeDisparity(
                    map=luma, invert=reading.invert, value_range=reading.value_range, as_stored=True
                )
            elif source is None:
                source = open_source(settings)
                network = source if isinstance(source, NetworkDepth) else None
            yield make_scene(image, source, window=window, number=index + 1)

    def _unpulled(self, index: int) -> RenderSettings:
        """The settings of a frame, without what is pulled."""
        given = self.settings.input.disparity
        if given is None or not given.is_dir():
            return self.settings
        one = replace(self.settings.input, disparity=_maps_in(given, self.count)[index])
        depth = replace(self.settings.depth, as_stored=True)
        return replace(self.settings, input=one, depth=depth)

    def _lumas(self, first: int) -> Iterator[Array] | None:
        """Maps of a video of depth, from a frame on; None where there is no such video."""
        given = self.settings.input.disparity
        if given is None or not is_video(given):
            return None
        info = video_info(given)
        if len(info.times) != self.count:
            raise ParameterError(
                "input.disparity",
                expected=f"as many frames as {self.info.path} has, {self.count}",
                shown=f"{len(info.times)} in {given}",
            )
        return read_luma(info, first)

    def _gets_steady(self) -> bool:
        given = self.settings.input
        many = given.depth_model is not None or len(self._map_files()) > 1
        many = many or (given.disparity is not None and is_video(given.disparity))
        return self.steady and gets_steady(self.settings, many=many)


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
