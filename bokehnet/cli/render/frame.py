"""Frames: the files of each, what may be asked for, and the rendering of one."""

import os
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from time import perf_counter

from bokehnet.cli.progress import stages
from bokehnet.cli.render.summary import FrameSummary
from bokehnet.cli.render.warming import loading_kernels
from bokehnet.errors import ImageFileError, ParameterError
from bokehnet.inference.process_memory import keep_freed
from bokehnet.io.formats.whole_picture import WHOLE_EXTENSIONS
from bokehnet.io.image import check_writable
from bokehnet.io.overwrite_guard import check_not_over
from bokehnet.progress import Progress
from bokehnet.render.memory_bounds import check_memory
from bokehnet.render.output import check_output
from bokehnet.render.renderer import BokehRenderer
from bokehnet.scene.depth.depth_source import tells_distances
from bokehnet.scene.focus import check_focus
from bokehnet.scene.scene import read_scene
from bokehnet.sequence.frame_names import frame_path, is_pattern
from bokehnet.sequence.sequence import SequenceSettings, input_files, make_pull, settings_at_frame
from bokehnet.sequence.shot import Shot
from bokehnet.settings.settings import RenderSettings

__all__ = ["FrameJob", "frame_jobs", "make_renderer", "render_frame", "render_one"]


@dataclass(frozen=True, kw_only=True, slots=True)
class FrameJob:
    """One frame to render.

    Attributes:
        image: The all-in-focus picture.
        output: Where the result goes.
        settings: All else.
        number: Of the frame in its sequence.
        shot: What was decided for all of its frames.
        index: Of the frame in the shot, counted from 0.
    """

    image: Path
    output: Path
    settings: RenderSettings
    number: int = 0
    shot: Shot = field(default_factory=Shot)
    index: int = 0

    def check(self) -> None:
        """Raise unless the settings fit together and the result can be written; no picture is read."""
        check_focus(self.settings)
        check_writable(self.output)
        check_output(self.output, self.settings.output)
        if self.settings.engine.max_memory is not None and self.output.suffix.lower() in WHOLE_EXTENSIONS:
            raise ParameterError(
                "engine.max_memory",
                "none for AVIF and HEIC, whose encoders hold whole pictures",
                self.settings.engine.max_memory,
                "leave it out, or write .jpg, .png or .tif",
            )
        try:
            read, fine = input_files(self.settings).values(), self.settings.input.supersampled > 1
            check_not_over(self.output, self.image, read, reduced=fine)
        except ParameterError as error:
            raise error.renamed("--output") from error
        folder = self.settings.output.save_maps
        if folder is None:
            return
        nearest = next(path for path in (folder, *folder.absolute().parents) if path.exists())
        if not nearest.is_dir():
            raise ImageFileError(f"`output.save_maps`: expected a folder, found the file {nearest}")
        if not os.access(nearest, os.W_OK | os.X_OK):
            raise ImageFileError(f"`output.save_maps`: the folder {nearest} is not writable")


def frame_jobs(job: FrameJob, sequence: SequenceSettings) -> dict[int, FrameJob]:
    """Return what is to be rendered for each frame.

    Args:
        job: For all frames; its paths may have a place for the number.
        sequence: Which frames, and what changes over them.

    Raises:
        ParameterError: All results would go to one file, or over what they are made of.
        BokehnetError: As :meth:`FrameJob.check`, of any frame.
    """
    frames = sequence.frames or ()
    if len(frames) > 1 and not is_pattern(job.output):
        raise ParameterError(
            "--output",
            expected="a name with a place for the frame, such as out.####.png",
            shown=str(job.output),
        )
    given = job.settings
    metric = tells_distances(given, blur_pulled=sequence.blur_from is not None)
    pull = make_pull(frames, sequence, metric=metric)
    maps = given.output.save_maps
    jobs = {}
    for frame in frames:
        settings = settings_at_frame(given, frame, pull)
        if maps is not None:
            settings = replace(settings, output=replace(settings.output, save_maps=maps / f"{frame:04d}"))
        jobs[frame] = FrameJob(
            image=frame_path(job.image, frame),
            output=frame_path(job.output, frame),
            settings=settings,
            number=frame,
        )
    read = {path for one in jobs.values() for path in (one.image, *input_files(one.settings).values())}
    for one in jobs.values():
        if one.output in read:
            raise ParameterError(
                "--output",
                expected="another name than those that are read",
                shown=f"{one.output}, read for a frame",
            )
        one.check()
    return jobs


def make_renderer(settings: RenderSettings, threads: int = 0) -> BokehRenderer:
    """Return a renderer whose engine, networks and look are there: what is wrong with them is told now.

    Without a bound on memory the process keeps what it frees from now on.
    """
    if settings.engine.max_memory is None:
        keep_freed()
    renderer = BokehRenderer(settings.engine.name, weights=settings.engine.weights, threads=threads)
    renderer.check(settings)
    return renderer


def render_frame(
    job: FrameJob,
    renderer: BokehRenderer,
    begin: Callable[[str], Progress] = lambda label: _untold,
    meanwhile: Callable[[BokehRenderer, RenderSettings], AbstractContextManager] | None = None,
) -> FrameSummary:
    """Read, render and write one frame; the output appears complete or not at all.

    Args:
        job: The frame.
        renderer: Fit for its settings.
        begin: Is told of every stage; gives what its progress is reported to.
        meanwhile: Makes what surrounds the reading and the repair of the map, much of which is done outside
            Python.

    Raises:
        BokehnetError: A file cannot be read or written, or numbers and files do not fit together.
    """
    times = [perf_counter()]
    with nullcontext() if meanwhile is None else meanwhile(renderer, job.settings):
        report = begin("reading")
        source = job.shot.source(job.index, job.settings)
        check_memory(job.image, job.settings)
        scenes = [read_scene(job.image, job.settings, source=source, number=job.number, progress=report)]
        check_output(job.output, job.settings.output, scenes[0].frame)
        times.append(perf_counter())
        report = begin("depth")
        focused = renderer.prepare(scenes.pop(), job.settings, report, plan=job.shot.plan)
    times.append(perf_counter())
    result = renderer.render(focused, job.settings, begin("rendering"), overwrite=True)
    del focused
    times.append(perf_counter())
    report = begin("writing")
    if job.settings.output.save_maps is not None:
        result.save_maps(job.settings.output.save_maps, job.settings)
    result.save(job.output, report)
    times.append(perf_counter())
    taken = (end - begin for begin, end in pairwise(times))
    height, width = result.bokeh.shape[:2]
    return FrameSummary(
        output=str(job.output),
        width=width,
        height=height,
        report=result.report,
        seconds=dict(zip(("read", "prepare", "render", "write"), taken, strict=True)),
    )


def _untold(done: int, total: int) -> None:
    """Progress that nobody follows."""


def render_one(job: FrameJob, *, quiet: bool = False) -> FrameSummary:
    """Render a frame with a bar for each stage that takes long, unless it is to be quiet."""
    with stages(hidden=quiet) as begin:
        return render_frame(job, make_renderer(job.settings), begin, loading_kernels)
