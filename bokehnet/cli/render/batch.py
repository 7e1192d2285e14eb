"""Rendering of many unrelated pictures: a folder or a glob, with maps of the same names."""

import glob
from collections.abc import Mapping
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import Any

from bokehnet.cli.commands.models import ensure_model
from bokehnet.cli.options import message_of
from bokehnet.cli.progress import compile_notice, progress, write_above
from bokehnet.cli.render.frame import FrameJob, make_renderer
from bokehnet.cli.render.run_settings import RunSettings
from bokehnet.cli.render.shot.workers import render_here, render_in_processes
from bokehnet.cli.render.summary import FrameSummary, SummaryPrinter
from bokehnet.errors import BokehnetError, ParameterError
from bokehnet.io.formats.output_format import IMAGE_EXTENSIONS
from bokehnet.io.formats.whole_picture import WHOLE_EXTENSIONS
from bokehnet.sequence.sequence import input_files
from bokehnet.settings.settings import RenderSettings

__all__ = ["render_batch"]

_MAP_EXTENSIONS = (*IMAGE_EXTENSIONS, ".npy", ".npz")


def render_batch(
    image: str, output: Path, settings: RenderSettings, run: RunSettings, printer: SummaryPrinter
) -> None:
    """Render each picture for itself; a failure does not stop the others, and all are listed at the end.

    Args:
        image: Folder or glob of pictures.
        output: Folder for the results, which have the names of the pictures; created if absent.
        settings: Settings of all pictures; an input file may be a folder or a glob, whose files belong to the
            picture of the same name, such as ``a.jpg`` and ``a.png`` or ``a_depth.png``.
        run: Number of processes, and overwriting.
        printer: Printer of summaries.

    Raises:
        BokehnetError: Some pictures failed, or none exists.
    """
    if run.ray is not None or run.video_codec is not None:
        raise ParameterError("IMAGE", expected="a sequence for --ray, a video for --video-codec", shown=image)
    pictures = _files(image, IMAGE_EXTENSIONS, "IMAGE")
    if output.suffix or output.is_file():
        raise ParameterError("--output", expected="a folder for many pictures", shown=str(output))
    others = {}
    for name, path in input_files(settings).items():
        if _is_many(str(path)):
            others[name] = path
        elif not path.exists():  # once, not for each picture
            raise ParameterError(
                f"input.{name}", expected="a file, a folder or a glob", shown=f"none at {path}"
            )
    files_of = {name: _files(str(path), _MAP_EXTENSIONS, f"input.{name}") for name, path in others.items()}
    output.mkdir(parents=True, exist_ok=True)
    jobs: dict[int, FrameJob] = {}
    failed: dict[int, str] = {}
    for number, picture in enumerate(pictures):
        try:
            matched: dict[str, Any] = {}
            for name, files in files_of.items():
                matched[name] = _matching(picture, files, others[name])
            own = replace(settings, input=replace(settings.input, **matched))
            job = FrameJob(image=picture, output=_target(picture, pictures, output), settings=own)
            job.check()
            jobs[number] = job
        except BokehnetError as error:
            failed[number] = message_of(error)
    ensure_model(settings.input.depth_model)
    begun = perf_counter()
    pending = {number: job for number, job in jobs.items() if run.overwrite or not job.is_finished}
    done: dict[int, FrameSummary] = {}
    if pending:
        with compile_notice(hidden=printer.quiet):
            _render(pending, settings, run.jobs or 1, printer, done, failed)
    names = {number: str(picture) for number, picture in enumerate(pictures)}
    printer.print_batch(
        {names[number]: summary for number, summary in done.items()},
        existing=len(jobs) - len(pending),
        failed={names[number]: message for number, message in failed.items()},
        seconds=perf_counter() - begun,
    )
    if failed:
        raise BokehnetError(f"{len(failed)} of {len(pictures)} pictures failed")


def _render(
    jobs: Mapping[int, FrameJob],
    settings: RenderSettings,
    processes: int,
    printer: SummaryPrinter,
    done: dict[int, FrameSummary],
    failed: dict[int, str],
) -> None:
    """Render all jobs, and add their summaries and error messages."""
    renderer = make_renderer(settings)
    if processes > 1 and len(jobs) > 1:
        outcomes = render_in_processes(jobs, settings, min(processes, len(jobs)), quiet=printer.quiet)
    else:
        outcomes = render_here(jobs, renderer)
    with progress("rendering pictures", hidden=printer.quiet) as report, closing(outcomes):
        for count, (number, outcome) in enumerate(outcomes, start=1):
            if isinstance(outcome, str):
                failed[number] = outcome
            else:
                done[number] = outcome
                if printer.verbose:
                    write_above(f"bokehnet: {outcome.line()} ({outcome.steps()})")
            report(count, len(jobs))


def _is_many(text: str) -> bool:
    """Return whether a text is a folder or a glob, and no file."""
    return Path(text).is_dir() or (glob.has_magic(text) and not Path(text).exists())


def _files(text: str, extensions: tuple[str, ...], option: str) -> list[Path]:
    """Return the files of a folder or a glob with one of the extensions, sorted; hidden ones are ignored."""
    paths = Path(text).iterdir() if Path(text).is_dir() else map(Path, glob.glob(text))
    files = sorted(
        path for path in paths if path.suffix.lower() in extensions and path.name[0] != "." and path.is_file()
    )
    if not files:
        raise ParameterError(option, expected="a folder or glob with pictures", shown=f"none in {text}")
    return files


def _matching(picture: Path, files: list[Path], origin: Path) -> Path:
    """Return the file with the name of the picture, or else the only one that continues it after _, - or ."""
    same = [path for path in files if path.stem == picture.stem]
    longer = [path for path in files if path.name.startswith(tuple(picture.stem + mark for mark in "_-."))]
    matches = same or longer
    if len(matches) != 1:
        names = ", ".join(path.name for path in matches) or "none"
        raise ParameterError(
            "IMAGE", expected=f"one map named {picture.stem}.* in {origin} for {picture.name}", shown=names
        )
    return matches[0]


def _target(picture: Path, pictures: list[Path], output: Path) -> Path:
    """Return the output file; pictures of one stem keep their extensions within the name."""
    extension = picture.suffix.lower()
    if extension in WHOLE_EXTENSIONS:
        extension = ".jpg"
    twins = sum(other.stem == picture.stem for other in pictures)
    stem = picture.stem if twins == 1 else f"{picture.stem}.{picture.suffix[1:]}"
    return output / f"{stem}{extension}"
