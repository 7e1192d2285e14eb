"""Rendering of videos: the shot is analysed once, its frames are rendered in segments and can be resumed."""

import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from bokehnet.depth_repair.repair_plan import RepairPlan
from bokehnet.errors import ParameterError
from bokehnet.io.files.atomic import check_target
from bokehnet.io.maps import StoredMap
from bokehnet.io.video.display_matrix import DisplayMatrix
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
from bokehnet.progress import Progress, ignore_progress
from bokehnet.render.renderer import BokehRenderer
from bokehnet.render.result import RenderReport
from bokehnet.scene.depth.depth_map import DepthMap, Kind, Photo
from bokehnet.scene.depth.depth_source import DepthSource, NetworkDepth, RelativeDisparity
from bokehnet.scene.focus_checks import check_focus, check_frames_aperture
from bokehnet.scene.scene import Scene, make_scene
from bokehnet.sequence.resumable_folder import claim_folder, file_signature
from bokehnet.sequence.sequence import Pull, input_files, settings_at_frame
from bokehnet.sequence.shot import (
    FilteredDepth,
    Shot,
    analyse_shot,
    can_filter_maps,
    open_source,
    probe_frames,
)
from bokehnet.settings.settings import RenderSettings
from bokehnet.version import __version__

__all__ = ["VideoJob", "VideoReport"]

Array = npt.NDArray[np.float32]

# Frames of a segment, the most that an interruption loses.
SEGMENT_FRAMES = 24

_MAP_EXTENSIONS = (".png", ".exr", ".tif", ".tiff", ".pfm", ".npy", ".npz", ".jpg", ".jpeg", ".webp")


@dataclass(frozen=True, kw_only=True, slots=True)
class VideoReport:
    """Summary of a rendered video.

    Attributes:
        frames: Number of frames of the video.
        rendered: Number of frames rendered in this run.
        plan: Plan of the repair of the maps; None if they are not repaired.
        steady: True if the maps were filtered over time.
        notes: Notices about the first rendered frame.
        assumptions: Assumptions about it.

    Examples:
        >>> report = VideoReport(frames=240, rendered=48, plan=None, steady=True)
        >>> f"{report.frames - report.rendered} frames existed already"
        '192 frames existed already'
    """

    frames: int
    rendered: int
    plan: RepairPlan | None
    steady: bool
    notes: tuple[str, ...] = ()
    assumptions: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True, slots=True)
class StoredDepth:
    """Depth source that turns maps of the size of the stored picture like the picture.

    Maps of the size of the shown picture stay as they are.

    Attributes:
        source: Source of the maps.
        display: Transformation of the picture, which exchanges its axes.

    Examples:
        >>> from bokehnet.io.video.display_matrix import DisplayMatrix
        >>> from bokehnet.scene.scene import make_scene
        >>> ramp = np.tile(np.linspace(0.1, 0.9, 48, dtype=np.float32), (32, 1))
        >>> stored = RelativeDisparity(map=ramp, as_stored=True)
        >>> source = StoredDepth(source=stored, display=DisplayMatrix(transposed=True))
        >>> make_scene(np.ones((48, 32, 3), np.float32), source).depth.values.shape
        (48, 32)
    """

    source: DepthSource
    display: DisplayMatrix

    @property
    def origin(self) -> str:
        """Setting that names the maps."""
        return self.source.origin

    @property
    def kind(self) -> Kind | None:
        """Kind of the maps."""
        return self.source.kind

    @property
    def tells_focus(self) -> bool:
        """True if the picture's file may define the focus."""
        return self.source.tells_focus

    def depth_map(self, photo: Photo) -> DepthMap:
        """See :class:`DepthSource`."""
        depth = self.source.depth_map(photo)
        shown = photo.image.shape[:2]
        if depth.values.shape == shown or depth.values.shape != shown[::-1]:
            return depth
        return replace(depth, values=self.display.shown(depth.values))


@dataclass(frozen=True, kw_only=True, slots=True)
class VideoJob:
    """Video to render.

    Attributes:
        info: Header data of the video.
        output: File to write.
        settings: Settings of all frames; ``input.disparity`` may be a folder of maps, one for each frame in
            the order of their names, or a video.
        codec: Codec of the result, one of :data:`bokehnet.io.video.frames.CODECS`.
        pull: Settings that change over the frames, the first of which is 1.
        steady: True filters relative maps along the motion of the shot.

    Examples:
        >>> from fractions import Fraction
        >>> from bokehnet.io.color.color_space import SRGB
        >>> shape = {"width": 640, "height": 360, "pixels": "yuv420p", "codes": (1, 1, 1), "full": False}
        >>> rate = {"times": (0, 1, 2), "time_base": Fraction(1, 25), "rate": Fraction(25)}
        >>> info = VideoInfo(path=Path("clip.mp4"), space=SRGB, **shape, **rate)
        >>> job = VideoJob(info=info, output=Path("out.mp4"), settings=RenderSettings(), codec="h264")
        >>> job.folder.name  # holds the segments until the video is complete
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
        """Number of frames of the video."""
        return len(self.info.times)

    @property
    def numbers(self) -> Sequence[int]:
        """Indices of all frames; see :class:`ShotFrames`."""
        return range(self.count)

    @property
    def selected(self) -> Sequence[int]:
        """Indices of the frames to render: all."""
        return range(self.count)

    @property
    def probes(self) -> Sequence[int]:
        """Indices of the frames that decide about the repair."""
        return probe_frames(range(self.count))

    @property
    def are_files(self) -> bool:
        """False: the clipped light of videos is not estimated; see :class:`ShotFrames`."""
        return False

    @property
    def folder(self) -> Path:
        """Folder of segments and maps until the video is complete."""
        return self.output.with_name(f".bokehnet-video-{self.output.name}")

    def run(
        self,
        renderer: BokehRenderer,
        begin: Callable[[str], Progress] = lambda label: ignore_progress,
    ) -> VideoReport:
        """Render the missing segments, and join all segments.

        An interrupted run leaves its results in :attr:`folder`; the same job resumes from there. The folder
        of another job, such as one with other settings or another file, is emptied first.

        Args:
            renderer: Renderer for the settings.
            begin: Called at the start of each stage with its label; returns its progress callback.

        Raises:
            BokehnetError: A file cannot be read or written, or frame counts do not match.
        """
        folder, count = self.folder, self.count
        self._claim()
        shot = analyse_shot(self, renderer, folder=folder, steady=self._can_filter_maps(), begin=begin)
        names = [folder / f"{first:06d}.npz" for first in range(0, count, SEGMENT_FRAMES)]
        missing = [index for index, name in enumerate(names) if not name.exists()]
        indices = [
            index
            for part in missing
            for index in range(part * SEGMENT_FRAMES, min(count, (part + 1) * SEGMENT_FRAMES))
        ]
        report, scenes = begin("rendering frames"), self.scenes(indices, shot)
        reports: list[RenderReport] = []  # of the first frame

        def pictures(first: int) -> Iterator[tuple[int, Array]]:
            for number in range(first, min(count, first + SEGMENT_FRAMES)):
                report(number, count)
                settings = self.settings_of(number)
                focused = renderer.prepare(next(scenes), settings, plan=shot.plan)
                result = renderer.render(focused, settings)
                reports.append(result.report)
                del reports[1:]
                yield self.info.times[number], result.bokeh

        for part in missing:
            write_segment(names[part], self.info, pictures(part * SEGMENT_FRAMES), self.codec)
        report(count, count)
        join_segments(self.output, self.info, names, self.codec)
        shutil.rmtree(folder, ignore_errors=True)
        return VideoReport(
            frames=count,
            rendered=len(indices),
            plan=shot.plan,
            steady=shot.steady is not None,
            notes=(*self.info.notes, *(reports[0].notes if reports else ())),
            assumptions=tuple(reports[0].assumptions) if reports else (),
        )

    def check(self) -> None:
        """Raise unless the settings are consistent and the result can be written; reads no frame."""
        settings = self.settings
        if settings.output.save_maps is not None:
            raise ParameterError("output.save_maps", expected="none for a video", shown="a folder")
        if settings.input.supersampled > 1 or settings.input.matte is not None:
            raise ParameterError(
                "input.matte" if settings.input.matte is not None else "input.supersampled",
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
                check_focus(settings, automatic=False)
                check_frames_aperture(settings, None, own_depth=False)

    def _claim(self) -> None:
        """Create the folder, empty unless it belongs to the same job."""
        job = {
            "settings": self.settings.to_table(),
            "video": file_signature(self.info.path),
            "codec": self.codec,
            "pull": {name: [list(key) for key in keys] for name, keys in self.pull.keys.items()},
            "steady": self.steady,
            "version": __version__,
            "maps": [file_signature(path) for path in self._map_files()],
        }
        claim_folder(self.folder, job)

    def _map_files(self) -> list[Path]:
        """Return the depth files of all frames."""
        disparity = self.settings.input.disparity
        if disparity is not None and disparity.is_dir():
            return _maps_in(disparity, self.count)
        frames = (settings_at_frame(self.settings, n) for n in range(1, self.count + 1))
        files = [path for one in frames for path in input_files(one).values()]
        return [path for path in dict.fromkeys(files) if path.exists()]

    def settings_of(self, index: int) -> RenderSettings:
        """Return the settings of a frame, counted from 0."""
        return settings_at_frame(self._unpulled(index), index + 1, self.pull)

    def scenes(self, indices: Sequence[int], shot: Shot) -> Iterator[Scene]:
        """Yield these frames, ascending, with the filtered maps of ``shot``; see :class:`ShotFrames`."""
        if not indices:
            return
        window = self.info.window
        selected, first = set(indices), indices[0]
        lumas = None if shot.steady is not None else self._lumas(first)
        network: DepthSource | None = None
        for index, image in enumerate(read_video(self.info, first), first):
            luma = None if lumas is None else next(lumas)
            if index not in selected:
                continue
            settings = settings_at_frame(self._unpulled(index), index + 1)
            source = shot.source(index, settings) or network
            if luma is not None:
                source = luma
            elif source is None:
                source = open_source(settings)
                network = source if isinstance(source, NetworkDepth) else None
            if self.info.display.transposed and not isinstance(source, NetworkDepth | FilteredDepth):
                source = StoredDepth(source=source, display=self.info.display)
            yield make_scene(image, source, window=window, number=index + 1)

    def _unpulled(self, index: int) -> RenderSettings:
        """Return the settings of a frame, without the values of the pull."""
        disparity = self.settings.input.disparity
        if disparity is None or not disparity.is_dir():
            return self.settings
        inputs = replace(self.settings.input, disparity=_maps_in(disparity, self.count)[index])
        depth = replace(self.settings.depth, as_stored=True)
        return replace(self.settings, input=inputs, depth=depth)

    def _lumas(self, first: int) -> Iterator[RelativeDisparity] | None:
        """Yield the sources of the maps of a depth video, from a frame on; None if the maps are no video."""
        disparity = self.settings.input.disparity
        if disparity is None or not is_video(disparity):
            return None
        info = video_info(disparity)
        if len(info.times) != self.count:
            raise ParameterError(
                "input.disparity",
                expected=f"as many frames as {self.info.path} has, {self.count}",
                shown=f"{len(info.times)} in {disparity}",
            )
        reading, largest = self.settings.depth, 2**info.bits - 1
        return (
            RelativeDisparity(
                map=StoredMap(values=luma, largest_integer=largest, name=f"{disparity}: frame {number}"),
                invert=reading.invert,
                value_range=reading.value_range,
                as_stored=True,
                no_data=reading.no_data,
                holes=reading.holes,
            )
            for number, luma in enumerate(read_luma(info, first), first + 1)
        )

    def _can_filter_maps(self) -> bool:
        inputs = self.settings.input
        many = inputs.depth_model is not None or len(self._map_files()) > 1
        many = many or (inputs.disparity is not None and is_video(inputs.disparity))
        return self.steady and can_filter_maps(self.settings, many=many)


def _maps_in(folder: Path, count: int) -> list[Path]:
    """Return the maps in a folder, in the order of their names, one for each of ``count`` frames."""
    maps = sorted(
        path for path in folder.iterdir() if path.suffix.lower() in _MAP_EXTENSIONS and path.name[0] != "."
    )
    if len(maps) != count:
        raise ParameterError(
            "input.disparity",
            expected=f"a folder with a map for each of {count} frames",
            shown=f"{len(maps)} in {folder}",
        )
    return maps
