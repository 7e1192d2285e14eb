"""``bokehnet render``: bokeh from a picture and its depth or disparity."""

from collections.abc import Container, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from bokehnet.cli.options import COMMON_OPTIONS, OptionValues, resolved_settings, with_options
from bokehnet.cli.parser import SectionedCommand, argument, completion
from bokehnet.cli.render.run_settings import RunSettings
from bokehnet.engine_registry import CLASSICAL, DEFAULT_ENGINE, ENGINES
from bokehnet.errors import ErrorCollector, ParameterError
from bokehnet.sequence.sequence import SequenceSettings
from bokehnet.settings.fields import field_settings
from bokehnet.settings.preset import presets
from bokehnet.settings.settings import RenderSettings, group_types

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


def _is_many(image: str) -> bool:
    """Return whether IMAGE is a folder, or a glob that is no file."""
    return Path(image).is_dir() or (any(mark in image for mark in "*?[") and not Path(image).exists())


def _conflicts(
    image: str,
    output: str | None,
    quiet: bool,
    verbose: bool,
    option_values: OptionValues,
    invalid: Container[str] = (),
    **_others: object,
) -> Iterator[ParameterError]:
    """Yield the contradictions between arguments, flags and the options of sequences.

    Args:
        image: IMAGE.
        output: Output file.
        quiet: True for ``--quiet``.
        verbose: True for ``--verbose``.
        option_values: Values of the valid options.
        invalid: Groups with invalid options, whose contradictions are left out.
    """
    from bokehnet.io.video.frames import is_video
    from bokehnet.sequence.frame_names import is_pattern

    if quiet and verbose:
        yield ParameterError("--quiet", "no --verbose with it", shown="both", remedy="leave one out")
    own = {group: option_values.get(group, {}) for group in ("sequence", "run")}
    frames = own["sequence"].get("frames")
    if is_video(image) or "sequence" in invalid:
        return
    if output is None and frames is not None:
        expected = "a name with a placeholder for the frame, such as out.####.png"
        yield ParameterError("--output", expected, shown="none")
    if frames is None and _is_many(image):
        if output is None:
            yield ParameterError("--output", expected="a folder for many pictures", shown="none")
        return
    if own["run"].get("video_codec") is not None:
        yield ParameterError("IMAGE", expected="a video for --video-codec", shown=image)
    if frames is not None:
        return
    if flags := _flags_of_sequences(option_values):
        yield ParameterError("sequence.frames", f"frames such as 1-100 for {', '.join(flags)}", shown="none")
    elif is_pattern(Path(image)) and not Path(image).exists():
        expected = f"frames such as 1001-1100, since {image} names a sequence"
        yield ParameterError("sequence.frames", expected, shown="none")


def _flags_of_sequences(option_values: OptionValues) -> list[str]:
    """Return the options that only sequences have, of those whose values are not the defaults."""
    flags = []
    for group in (SequenceSettings, RunSettings):
        values = option_values.get(group.GROUP, {})
        for name, field in field_settings(group).items():
            is_set = values.get(name, field.default) != field.default
            if is_set and name not in ("overwrite", "video_codec"):
                flags.append(f"--{field.flag}")
    return flags


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
@with_options([*group_types(), SequenceSettings, RunSettings], conflicts=_conflicts)
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
    errors = ErrorCollector()
    errors.add(_conflicts(image, output, quiet, verbose, option_values))
    sequence = SequenceSettings(**option_values.pop("sequence", {}))
    run = RunSettings(**option_values.pop("run", {}))
    target = _default_output(image) if output is None else Path(output)
    # After parsing, so that --help stays fast.
    from bokehnet.cli.render.checks import check_inputs, check_job
    from bokehnet.io.video.frames import is_video
    from bokehnet.render.output import check_lossy_options

    is_single = not is_video(image) and not _is_many(image) and sequence.frames is None
    with errors.collect():
        resolved = resolved_settings(settings, preset, option_values)
        with errors.collect():
            _check_weights(option_values, resolved)
        with errors.collect():
            if sequence.frames is not None or not _is_many(image):
                check_lossy_options(target, resolved.output)
        with errors.collect():
            if is_single:
                check_job(Path(image), target, resolved)
    errors.raise_all()
    if is_video(image):
        from bokehnet.cli.render.video import render_video

        render_video(Path(image), target, resolved, sequence, run, quiet=quiet, as_json=as_json)
        return
    if sequence.frames is None and _is_many(image):
        from bokehnet.cli.render.batch import render_batch
        from bokehnet.cli.render.summary import SummaryPrinter

        printer = SummaryPrinter(quiet=quiet, verbose=verbose, as_json=as_json)
        render_batch(image, target, resolved, run, printer)
        return
    if is_single:
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


def _default_output(image: str) -> Path:
    from bokehnet.cli.render.default_output import default_output
    from bokehnet.io.formats.output_format import IMAGE_EXTENSIONS
    from bokehnet.io.video.frames import VIDEO_EXTENSIONS

    return default_output(Path(image), (*IMAGE_EXTENSIONS, *VIDEO_EXTENSIONS))


def _check_weights(option_values: OptionValues, resolved: RenderSettings) -> None:
    """Raise ``ParameterError`` if --weights is set for an engine without networks.

    Weights of a settings file wait for an engine that uses them.
    """
    weights = option_values.get("engine", {}).get("weights")
    engine = resolved.engine.name or DEFAULT_ENGINE
    if weights is not None and engine in CLASSICAL:
        others = [name for name in ENGINES if name not in CLASSICAL]
        raise ParameterError(
            "engine.weights",
            f"none for engine {engine}",
            shown=str(weights),
            remedy=f"use engine {', '.join(others[:-1])} or {others[-1]}",
        )


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
