"""``bokehnet render``: bokeh from a picture and its depth or disparity."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bokehnet.cli.options import OptionValues, resolved_settings, with_options
from bokehnet.cli.render.run_settings import RunSettings
from bokehnet.errors import ParameterError
from bokehnet.sequence.sequence import SequenceSettings
from bokehnet.settings.preset import presets
from bokehnet.settings.settings import group_types

if TYPE_CHECKING:
    from bokehnet.cli.render.frame import FrameJob
    from bokehnet.cli.render.summary import SummaryPrinter

__all__ = ["render"]


@with_options([*group_types(), SequenceSettings, RunSettings])
def render(
    image: Annotated[
        str,
        typer.Argument(
            metavar="IMAGE", help="All-in-focus picture or video; EXR and HDR are read as linear."
        ),
    ],
    output: Annotated[
        str,
        typer.Option("--output", "-o", metavar="FILE", help="Output file; its extension sets the format."),
    ],
    preset: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|FILE.toml",
            help="Look: a name listed by `bokehnet presets`, or a file. Options override it.",
            autocompletion=presets,
        ),
    ] = None,
    settings: Annotated[
        str | None,
        typer.Option(metavar="FILE.toml", help="Settings file. Preset and options override it."),
    ] = None,
    quiet: Annotated[
        bool, typer.Option("--quiet", "-q", help="Print only errors. Default: a one-line summary.")
    ] = False,
    verbose: Annotated[
        bool, typer.Option("--verbose", "-v", help="Print the time of each step as well, for each frame.")
    ] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the summary as one JSON object to stdout.")
    ] = False,
    *,
    option_values: OptionValues,
) -> None:
    """Render bokeh from an image and its depth or disparity.

    Prints a one-line summary to stderr: size, engine, focus, largest blur, repair of the map, time.
    """
    sequence, run = (
        SequenceSettings(**option_values.pop("sequence", {})),
        RunSettings(**option_values.pop("run", {})),
    )
    resolved = resolved_settings(settings, preset, option_values)
    from bokehnet.cli.render.frame import FrameJob  # after parsing, so --help stays fast
    from bokehnet.cli.render.summary import make_summary_printer
    from bokehnet.io.video.frames import is_video

    printer = make_summary_printer(quiet=quiet, verbose=verbose, as_json=as_json)
    if is_video(image):
        from bokehnet.cli.render.video import render_video

        render_video(Path(image), Path(output), resolved, sequence, run, quiet=quiet, as_json=as_json)
        return
    if run.video_codec is not None:
        raise ParameterError("IMAGE", expected="a video for --video-codec", shown=image)
    job = FrameJob(image=Path(image), output=Path(output), settings=resolved)
    if sequence.frames is None:
        _check_single(job, sequence, run)
        _render_single(job, printer, quiet)
    else:
        _render_sequence(job, sequence, run, printer, quiet)


def _check_single(job: "FrameJob", sequence: SequenceSettings, run: RunSettings) -> None:
    """Raise ``ParameterError`` if options or the name of the picture belong to a sequence."""
    from bokehnet.sequence.frame_names import is_pattern

    if (sequence, run) != (SequenceSettings(), RunSettings()):
        raise ParameterError(
            "sequence.frames",
            expected="frames, which --jobs, --overwrite, --pull, --ray, --steady "
            "and the options -from and -to need",
            shown="none",
        )
    if is_pattern(job.image) and not job.image.exists():
        raise ParameterError(
            "sequence.frames",
            expected=f"frames such as 1001-1100, since {job.image} names a sequence",
            shown="none",
        )


def _render_single(job: "FrameJob", printer: "SummaryPrinter", quiet: bool) -> None:
    from bokehnet.cli.commands.models import ensure_model
    from bokehnet.cli.progress import compile_notice
    from bokehnet.cli.render.frame import render_one

    job.check()
    ensure_model(job.settings.input.depth_model)
    with compile_notice(hidden=quiet):
        printer.print_single(render_one(job, quiet=quiet))


def _render_sequence(
    job: "FrameJob", sequence: SequenceSettings, run: RunSettings, printer: "SummaryPrinter", quiet: bool
) -> None:
    from bokehnet.cli.commands.models import ensure_model
    from bokehnet.cli.progress import compile_notice
    from bokehnet.cli.render.frame import context_jobs, frame_jobs

    jobs = frame_jobs(job, sequence)
    ensure_model(job.settings.input.depth_model)
    if run.ray is not None and run.jobs is not None:
        raise ParameterError("--ray", expected="either this or --jobs", shown="both", remedy="leave one out")
    from bokehnet.cli.render.cluster_frames import render_on_cluster
    from bokehnet.cli.render.workers import render_frames  # keeps single pictures fast

    cluster = None if run.ray is None else partial(render_on_cluster, address=run.ray)
    with compile_notice(hidden=quiet):
        render_frames(
            jobs,
            context=context_jobs(job, sequence),
            processes=run.jobs or 1,
            cluster=cluster,
            overwrite=run.overwrite,
            steady=run.steady == "on",
            printer=printer,
        )
