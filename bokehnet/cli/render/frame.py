"""Frames: jobs with their files, checks before rendering, and the rendering of one frame."""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

from bokehnet.cli.progress import stages, write_above
from bokehnet.cli.render.checks import check_job, picture_header
from bokehnet.cli.render.large_blur import confirm_large_blur, is_large_blur
from bokehnet.cli.render.summary import FrameSummary
from bokehnet.cli.render.warming import loading_kernels
from bokehnet.errors import ImageFileError, ParameterError
from bokehnet.inference.process_memory import freed_memory_kept, keep_freed_memory
from bokehnet.io.color.srgb import linear_to_srgb
from bokehnet.io.formats.finished import is_finished
from bokehnet.io.formats.heif import is_heif
from bokehnet.io.image import read_image
from bokehnet.io.selection.map_channels import picture_depth_channel
from bokehnet.progress import Progress, ignore_progress
from bokehnet.render.exposure.memory_bounds import check_memory
from bokehnet.render.output import check_output
from bokehnet.render.renderer import BokehRenderer
from bokehnet.scene.depth.depth_source import gives_metric_depth
from bokehnet.scene.focus_checks import check_focus, check_frames_aperture
from bokehnet.scene.scene import FocusedScene, read_scene
from bokehnet.sequence.frame_names import existing_frames, frame_path, is_pattern
from bokehnet.sequence.sequence import SequenceSettings, input_files, make_pull, settings_at_frame
from bokehnet.sequence.shot import Shot, frames_of_shot, probe_frames
from bokehnet.sequence.temporal_filter import REACH_FRAMES
from bokehnet.sequence.tracking import TrackedPoint, track_through
from bokehnet.settings.settings import RenderSettings

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

__all__ = [
    "FrameJob",
    "check_track",
    "context_jobs",
    "frame_jobs",
    "make_renderer",
    "render_frame",
    "render_one",
    "tracked_path",
    "write_track_notice",
]


@dataclass(frozen=True, kw_only=True, slots=True)
class FrameJob:
    """Job to render one frame.

    Attributes:
        image: File of the all-in-focus picture.
        output: File of the result.
        settings: Settings of the render.
        number: Frame number in its sequence.
        shot: Decisions common to all frames of the shot.
        is_probe: True if the frame decides about the repair of the shot.
    """

    image: Path
    output: Path
    settings: RenderSettings
    number: int = 0
    shot: Shot = field(default_factory=Shot)
    is_probe: bool = False

    @property
    def is_finished(self) -> bool:
        """True if the output is whole, readable and of the size of the picture."""
        return is_finished(self.output, self.image, self.settings.input.supersampled)

    def check(self) -> None:
        """Raise unless the settings are consistent and the result can be written; reads no picture."""
        check_job(self.image, self.output, self.settings)


def frame_jobs(
    job: FrameJob, sequence: SequenceSettings, path: Sequence[TrackedPoint] = ()
) -> dict[int, FrameJob]:
    """Return the job of each frame.

    Args:
        job: Job for all frames; its paths may have a placeholder for the frame number.
        sequence: Frame numbers, and settings that change over them.
        path: Positions of the tracked thing, see :func:`tracked_path`.

    Raises:
        ParameterError: All results would go to one file, or overwrite an input.
        BokehnetError: As :meth:`FrameJob.check`, for any frame.
    """
    frames = sequence.frames or ()
    if len(frames) > 1 and not is_pattern(job.output):
        raise ParameterError(
            "--output",
            expected="a name with a placeholder for the frame, such as out.####.png",
            shown=str(job.output),
        )
    jobs = _jobs_of(job, sequence, frames, path)
    inputs = {path for one in jobs.values() for path in (one.image, *input_files(one.settings).values())}
    for one in jobs.values():
        if one.output in inputs:
            raise ParameterError(
                "--output",
                expected="a name different from all inputs",
                shown=f"{one.output}, an input of a frame",
            )
        one.check()
        check_focus(one.settings, automatic=len(jobs) == 1)
    if len(jobs) > 1:
        _check_aperture(next(iter(jobs.values())))
    return jobs


def _check_aperture(first: FrameJob) -> None:
    """See :func:`check_frames_aperture`; files that cannot be read are reported with their frame."""
    with suppress(ImageFileError):
        own_depth = not is_heif(first.image) and picture_depth_channel(first.image) is not None
        check_frames_aperture(first.settings, picture_header(first.image)[1], own_depth=own_depth)


def context_jobs(
    job: FrameJob, sequence: SequenceSettings, path: Sequence[TrackedPoint] = ()
) -> dict[int, FrameJob]:
    """Return the jobs of the existing frames that :func:`decided_jobs` reads in addition to those to render.

    These are the frames within reach of the temporal filter, and those that decide about the repair of the
    shot: a part of a shot equals these frames of the entire shot. Arguments as for :func:`frame_jobs`.
    """
    selected = sequence.frames or ()
    patterns = [path for path in (job.image, *input_files(job.settings).values()) if is_pattern(path)]
    if not patterns:
        return {}
    shot = frames_of_shot(set.intersection(*map(existing_frames, patterns)), selected)
    probes = set(probe_frames(shot)) if shot else set()
    near = {number + offset for number in selected for offset in range(-REACH_FRAMES, REACH_FRAMES + 1)}
    frames = [number for number in shot if number in near or number in probes]
    jobs = _jobs_of(job, sequence, frames, path)
    return {number: replace(one, is_probe=number in probes) for number, one in jobs.items()}


def tracked_path(job: FrameJob, sequence: SequenceSettings) -> list[TrackedPoint]:
    """Return the positions of the thing to follow in the frames of ``sequence``; empty without one.

    Reads the pictures of all existing frames from the one in which the position is known. Writes a notice
    to stderr if the thing is lost.

    Raises:
        ParameterError: The position is no pixel of that frame, or the frame does not exist.
        BokehnetError: A picture cannot be read.
    """
    frames = sequence.frames or ()
    if sequence.track is None or not frames:
        return []
    x, y, start = (*sequence.track, frames[0])[:3]
    first, last = min(start, frames[0]), max(start, frames[-1])
    existing = existing_frames(job.image) if is_pattern(job.image) else range(first, last + 1)
    numbers = [number for number in sorted(existing) if first <= number <= last]

    def read(number: int) -> "npt.NDArray[np.float32]":
        light = read_image(frame_path(job.image, number))
        return linear_to_srgb(light.clip(0, 1)).astype("float32")

    if start not in numbers:
        raise ParameterError("sequence.track", expected="a frame that exists", shown=f"frame {start}")
    check_track(x, y, *read(start).shape[1::-1])
    path = track_through(read, numbers, x, y, start)
    write_track_notice(path, start)
    return path


def check_track(x: int, y: int, width: int, height: int) -> None:
    """Raise unless a pixel lies inside the picture."""
    if not (x < width and y < height):
        raise ParameterError(
            "sequence.track", expected=f"a pixel inside the picture of {width}x{height}", shown=f"{x},{y}"
        )


def write_track_notice(path: Sequence[TrackedPoint], start: int) -> None:
    """Write a line to stderr for each side of ``start`` on which the thing is lost."""
    for side in (
        [point for point in path if point.number >= start],
        [point for point in reversed(path) if point.number <= start],
    ):
        lost = next((point for point in side if point.is_lost), None)
        if lost is not None:
            write_above(
                f"bokehnet: note: --track loses the thing in frame {lost.number}; from there the focus stays "
                f"on the pixel {lost.x:.0f},{lost.y:.0f}"
            )


def _jobs_of(
    job: FrameJob, sequence: SequenceSettings, frames: Sequence[int], path: Sequence[TrackedPoint]
) -> dict[int, FrameJob]:
    base = job.settings
    metric = gives_metric_depth(base, blur_pulled=sequence.blur_from is not None)
    pull = make_pull(sequence.frames or (), sequence, metric=metric, path=path)
    maps = base.output.save_maps
    jobs = {}
    for frame in frames:
        settings = settings_at_frame(base, frame, pull)
        if maps is not None:
            settings = replace(settings, output=replace(settings.output, save_maps=maps / f"{frame:04d}"))
        jobs[frame] = FrameJob(
            image=frame_path(job.image, frame),
            output=frame_path(job.output, frame),
            settings=settings,
            number=frame,
        )
    return jobs


def make_renderer(settings: RenderSettings, threads: int = 0) -> BokehRenderer:
    """Return a renderer for some settings; raise now if its engine, networks or look are invalid.

    Without a memory bound the process keeps freed memory from now on.
    """
    if settings.engine.max_memory is None:
        keep_freed_memory()
    engine = settings.engine
    renderer = BokehRenderer(engine.name, weights=engine.weights, threads=threads, cache_bytes=0)
    renderer.check(settings)
    return renderer


def render_frame(
    job: FrameJob,
    renderer: BokehRenderer,
    begin: Callable[[str], Progress] = lambda label: ignore_progress,
    meanwhile: Callable[[BokehRenderer, RenderSettings], AbstractContextManager] | None = None,
    *,
    warn: bool = False,
) -> FrameSummary:
    """Read, render and write one frame; the output file appears complete or not at all.

    Args:
        job: Job of the frame.
        renderer: Renderer made for its settings.
        begin: Callback that begins a stage by its label and returns its progress callback.
        meanwhile: Factory of a context manager around reading and depth repair, which leave Python's
            interpreter lock free most of the time.
        warn: True to print the expected time of a very large blur, and to ask on a terminal.

    Raises:
        BokehnetError: A file cannot be read or written, or settings and files are inconsistent.
        click.Abort: The user declines a long render.
    """
    times = [perf_counter()]
    with nullcontext() if meanwhile is None else meanwhile(renderer, job.settings):
        report = begin("reading")
        source = job.shot.source(job.number, job.settings)
        check_memory(job.image, job.settings)
        scenes = [read_scene(job.image, job.settings, source=source, number=job.number, progress=report)]
        check_output(job.output, job.settings.output, scenes[0].frame)
        times.append(perf_counter())
        if warn and is_large_blur(job.settings, scenes[0]):
            _confirm(renderer.prepare(scenes[0], _unrepaired(job.settings)), job.settings)
            warn = False
        report = begin("depth")
        focused = renderer.prepare(job.shot.lit(scenes.pop()), job.settings, report, plan=job.shot.plan)
    times.append(perf_counter())
    report = begin("rendering")
    if warn:
        report = _confirming(report, focused, job.settings)
    with freed_memory_kept():
        result = renderer.render(focused, job.settings, report, overwrite=True)
    del focused
    times.append(perf_counter())
    report = begin("writing")
    if job.settings.output.save_maps is not None:
        result.save_maps(job.settings.output.save_maps, job.settings)
    result.save(job.output, report)
    times.append(perf_counter())
    durations = (end - begin for begin, end in pairwise(times))
    height, width = result.bokeh.shape[:2]
    return FrameSummary(
        output=str(job.output),
        width=width,
        height=height,
        report=result.report,
        seconds=dict(zip(("read", "prepare", "render", "write"), durations, strict=True)),
    )


def _confirming(report: Progress, focused: FocusedScene, settings: RenderSettings) -> Progress:
    """Return a progress callback that first prints the expected time of a very large blur.

    Its first call follows all checks of the engine.
    """
    pending = [True]

    def confirmed(done: int, total: int) -> None:
        if pending:
            pending.clear()
            _confirm(focused, settings)
        report(done, total)

    return confirmed


def _confirm(focused: FocusedScene, settings: RenderSettings) -> None:
    """See :func:`confirm_large_blur`."""
    width, height = (side // focused.supersampled for side in focused.image.shape[1::-1])
    radius = float(max(focused.defocus.max(), -focused.defocus.min())) / focused.supersampled
    confirm_large_blur(settings, width, height, radius)


def _unrepaired(settings: RenderSettings) -> RenderSettings:
    """Return settings that focus a scene at once, without estimates of its depth and light."""
    return settings.updated({"depth": {"repair": "off"}, "highlights": {"threshold": "off", "gain": None}})


def render_one(job: FrameJob, *, quiet: bool = False) -> FrameSummary:
    """Render a frame with a progress bar for each long stage, unless ``quiet``."""
    with stages(hidden=quiet) as begin:
        return render_frame(job, make_renderer(job.settings), begin, loading_kernels, warn=not quiet)
