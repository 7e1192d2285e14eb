"""Many frames: which are to be rendered, by whom, and what became of them."""

import sys
from collections.abc import Generator, Mapping
from contextlib import closing
from dataclasses import replace
from typing import TYPE_CHECKING

import typer

from bokehnet.cli.frames import format_frames, frame_path, is_pattern
from bokehnet.cli.look import Renderer
from bokehnet.cli.workers import render_in_processes, try_frame
from bokehnet.errors import BokehnetError, ParameterError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bokehnet.cli.look import Look
    from bokehnet.cli.pull import Pull
    from bokehnet.cli.render_job import RenderJob

__all__ = ["jobs_of_frames", "render_sequence"]


def jobs_of_frames(job: "RenderJob", frames: "Sequence[int]", pull: "Pull") -> dict[int, "RenderJob"]:
    """Return what is to be rendered for each frame.

    Args:
        job: For all frames; its paths may have a place for the number.
        frames: Their numbers.
        pull: What changes from frame to frame.

    Raises:
        ParameterError: All results would go to one file, or over what they are made of.
        BokehnetError: As :meth:`RenderJob.check`, of any frame.
    """
    if len(frames) > 1 and not is_pattern(job.output):
        raise ParameterError(
            f"--output: expected a name with a place for the frame, such as out.####.png, got {job.output}"
        )
    for name in pull.keys:
        if getattr(job.focus, name) is not None:
            raise ParameterError(f"--{name.replace('_', '-')} and a pull of it: expected one of them")
    jobs = {
        frame: replace(
            job,
            image=frame_path(job.image, frame),
            output=frame_path(job.output, frame),
            source=job.source.at(frame),
            focus=job.focus.with_numbers(pull.at(frame)),
            save_maps=job.save_maps and job.save_maps / f"{frame:04d}",
            number=frame,
        )
        for frame in frames
    }
    inputs = {path for one in jobs.values() for path in (one.image, *one.source.files)}
    for one in jobs.values():
        if one.output in inputs:
            raise ParameterError(f"--output: {one.output} is read for a frame; choose another name")
        one.check()
    return jobs


def render_sequence(
    jobs: Mapping[int, "RenderJob"], look: "Look", *, processes: int = 1, overwrite: bool = False
) -> None:
    """Render the frames that are not there yet; files are written in one step, so what is there is complete.

    A frame that fails is told on stderr and does not stop the others.

    Args:
        jobs: By frame.
        look: What they have in common.
        processes: How many render at a time, with their share of the cores each.
        overwrite: Render again what is there.

    Raises:
        BokehnetError: Some frames failed, and which; or the renderer cannot be made.
    """
    from tqdm import tqdm

    from bokehnet.cli.progress import progress

    wanted = {frame: job for frame, job in jobs.items() if overwrite or not job.output.exists()}
    if there := len(jobs) - len(wanted):
        typer.echo(f"{there} of {len(jobs)} frames are there already; --overwrite renders them again")
    failed: list[int] = []
    renderer = Renderer(look)  # here first, so that wrong weights are told once
    if processes > 1 and len(wanted) > 1:
        del renderer
        outcomes = render_in_processes(wanted, look, min(processes, len(wanted)))
    else:
        outcomes = _render_here(wanted, renderer)
    with progress("rendering frames") as report, closing(outcomes):
        report(0, len(wanted))
        for done, (frame, failure) in enumerate(outcomes, start=1):
            if failure is not None:
                failed.append(frame)
                tqdm.write(f"bokehnet: frame {frame}: {failure}", file=sys.stderr)
            report(done, len(wanted))
    if failed:
        typer.echo(err=True)  # the bar that the lines above have cut through ends here
        raise BokehnetError(
            f"{len(failed)} of {len(wanted)} frames failed: {format_frames(failed)}; "
            "the same command tries them again"
        )


def _render_here(
    jobs: Mapping[int, "RenderJob"], renderer: Renderer
) -> Generator[tuple[int, str | None], None, None]:
    for frame, job in jobs.items():
        yield frame, try_frame(job, renderer)
