"""``bokehnet render``: bokeh from a picture and its depth or disparity."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from bokehnet.cli.options import COMMON_OPTIONS, OptionValues, resolved_settings, with_options
from bokehnet.cli.parser import SectionedCommand, argument, completion
from bokehnet.cli.render.run_settings import RunSettings
from bokehnet.errors import ErrorCollector, ParameterError
from bokehnet.sequence.sequence import SequenceSettings
from bokehnet.settings.fields import field_settings
from bokehnet.settings.preset import presets
from bokehnet.settings.settings import group_types

if TYPE_CHECKING:
    from bokehnet.cli.render.frame import FrameJob
    from bokehnet.cli.render.summary import SummaryPrinter

__all__ = ["render"]

_EXAMPLES = """
bokehnet render photo.jpg --disparity map.png
bokehnet render portrait.heic --strength 70 -o out.jpg
bokehnet render shot.exr --depth shot.exr --focus-distance 2 -o out.exr
bokehnet render photo.jpg --disparity map.png --blur 40 --focus-at 600,400
"""


@click.command(cls=SectionedCommand, common=COMMON_OPTIONS, examples=_EXAMPLES)
@argument("image", type=click.Path(), metavar="IMAGE", help="All-in-focus picture or video; folder or glob.")
@click.option(
    "--output",
    "-o",
    type=click.Path(),
    metavar="FILE",
    help="Output file; its extension sets the format. Default: photo_bokeh.jpg beside photo.jpg, with a "
    "number if that file exists.",
)
@click.option(
    "--preset",
    metavar="NAME|FILE.toml",
    help="Look: a name listed by `bokehnet presets`, or a file. Options override it.",
    shell_complete=completion(presets),
)
@click.option("--settings", metavar="FILE.toml", help="Settings file. Preset and options override it.")
@click.option("--quiet", "-q", is_flag=True, help="Print only errors. Default: a one-line summary.")
@click.option("--verbose", "-v", is_flag=True, help="Print the time of each step as well, for each frame.")
@click.option("as_json", "--json", is_flag=True, help="Print the summary as one JSON object to stdout.")
@with_options([*group_types(), SequenceSettings, RunSettings])
def render(
    image: str,
    output: str | None,
    preset: str | None,
    settings: str | None,
    quiet: bool,
    verbose: bool,
    as_json: bool,
    option_values: OptionValues,
) -> None:
    """Render bokeh from an image and its depth or disparity.

    Prints a one-line summary to stderr: size, engine, focus, largest blur, repair of the map, time, and all
    that was assumed.
    """
    sequence, run = (
        SequenceSettings(**option_values.pop("sequence", {})),
        RunSettings(**option_values.pop("run", {})),
    )
    resolved = resolved_settings(settings, preset, option_values)
    target = Path() if _is_many(image) else _output(image, output, sequence)
    # After parsing, so that --help stays fast.
    from bokehnet.io.video.frames import is_video
    from bokehnet.render.output import check_lossy_options

    if is_video(image):
        check_lossy_options(target, resolved.output)
        from bokehnet.cli.render.video import render_video

        render_video(Path(image), target, resolved, sequence, run, quiet=quiet, as_json=as_json)
        return
    if sequence.frames is None and _is_many(image):
        from bokehnet.cli.render.batch import render_batch
        from bokehnet.cli.render.summary import SummaryPrinter

        if output is None:
            raise ParameterError("--output", expected="a folder for many pictures", shown="none")
        printer = SummaryPrinter(quiet=quiet, verbose=verbose, as_json=as_json)
        render_batch(image, Path(output), resolved, run, printer)
        return
    from bokehnet.cli.render.checks import check_inputs, check_job

    errors = ErrorCollector()
    with errors.collect():
        if run.video_codec is not None:
            raise ParameterError("IMAGE", expected="a video for --video-codec", shown=image)
    with errors.collect():
        if quiet and verbose:
            raise ParameterError("--quiet", "no --verbose with it", shown="both", remedy="leave one out")
    with errors.collect():
        if sequence.frames is None:
            _check_single(Path(image), sequence, run)
    with errors.collect():
        check_lossy_options(target, resolved.output)
    with errors.collect():
        if sequence.frames is None:
            check_job(Path(image), target, resolved)
    errors.raise_all()
    if sequence.frames is None:
        from bokehnet.cli.commands.models import ensure_depth

        check_inputs(Path(image), resolved)
        ensure_depth(Path(image), resolved)
    # Kernels are imported from here on.
    from bokehnet.cli.render.frame import FrameJob
    from bokehnet.cli.render.summary import SummaryPrinter

    printer = SummaryPrinter(quiet=quiet, verbose=verbose, as_json=as_json)
    job = FrameJob(image=Path(image), output=target, settings=resolved)
    if sequence.frames is None:
        _render_single(job, printer, quiet)
    else:
        _render_sequence(job, sequence, run, printer, quiet)


def _is_many(image: str) -> bool:
    """Return whether IMAGE is a folder, or a glob that is no file."""
    return Path(image).is_dir() or (any(mark in image for mark in "*?[") and not Path(image).exists())


def _output(image: str, output: str | None, sequence: SequenceSettings) -> Path:
    """Return the output file; its default name is free."""
    if output is not None:
        return Path(output)
    if sequence.frames is not None:
        raise ParameterError(
            "--output", expected="a name with a placeholder for the frame, such as out.####.png", shown="none"
        )
    from bokehnet.cli.render.default_output import default_output
    from bokehnet.io.formats.output_format import IMAGE_EXTENSIONS
    from bokehnet.io.video.frames import VIDEO_EXTENSIONS

    return default_output(Path(image), (*IMAGE_EXTENSIONS, *VIDEO_EXTENSIONS))


def _check_single(image: Path, sequence: SequenceSettings, run: RunSettings) -> None:
    """Raise ``ParameterError`` if options or the name of the picture belong to a sequence."""
    from bokehnet.sequence.frame_names import is_pattern

    given = [flag for group in (sequence, run) for flag in _given_flags(group)]
    given = [flag for flag in given if flag not in ("overwrite", "video-codec")]
    if given:
        options = ", ".join(f"--{flag}" for flag in given)
        raise ParameterError("sequence.frames", expected=f"frames such as 1-100 for {options}", shown="none")
    if is_pattern(image) and not image.exists():
        raise ParameterError(
            "sequence.frames",
            expected=f"frames such as 1001-1100, since {image} names a sequence",
            shown="none",
        )


def _given_flags(group: SequenceSettings | RunSettings) -> list[str]:
    """Return the flags whose values in ``group`` are not the defaults."""
    fields = field_settings(type(group))
    return [f"{field.flag}" for name, field in fields.items() if getattr(group, name) != field.default]


def _render_single(job: "FrameJob", printer: "SummaryPrinter", quiet: bool) -> None:
    from bokehnet.cli.progress import compile_notice
    from bokehnet.cli.render.frame import render_one

    with compile_notice(hidden=quiet):
        printer.print_single(render_one(job, quiet=quiet))


def _render_sequence(
    job: "FrameJob", sequence: SequenceSettings, run: RunSettings, printer: "SummaryPrinter", quiet: bool
) -> None:
    from bokehnet.cli.commands.models import ensure_model
    from bokehnet.cli.progress import compile_notice
    from bokehnet.cli.render.frame import context_jobs, frame_jobs, tracked_path

    path = tracked_path(job, sequence)
    jobs = frame_jobs(job, sequence, path)
    ensure_model(job.settings.input.depth_model)
    if run.ray is not None and run.jobs is not None:
        raise ParameterError("--ray", expected="either this or --jobs", shown="both", remedy="leave one out")
    from bokehnet.cli.render.shot.cluster_frames import render_on_cluster
    from bokehnet.cli.render.shot.workers import render_frames  # keeps single pictures fast

    cluster = None if run.ray is None else partial(render_on_cluster, address=run.ray)
    with compile_notice(hidden=quiet):
        render_frames(
            jobs,
            context=context_jobs(job, sequence, path),
            processes=run.jobs or 1,
            cluster=cluster,
            overwrite=run.overwrite,
            steady=run.steady == "on",
            printer=printer,
        )
