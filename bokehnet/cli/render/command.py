"""``bokehnet render``: bokeh from a picture and its depth or disparity."""

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from bokehnet.cli.options import Given, resolved_settings, with_options
from bokehnet.cli.render.run_settings import RunSettings
from bokehnet.errors import ParameterError
from bokehnet.sequence.sequence import SequenceSettings
from bokehnet.settings.preset import presets
from bokehnet.settings.settings import group_types

__all__ = ["render"]


@with_options([*group_types(), SequenceSettings, RunSettings])
def render(
    image: Annotated[
        str, typer.Argument(metavar="IMAGE", help="All-in-focus picture; EXR and HDR are read as linear.")
    ],
    output: Annotated[
        str,
        typer.Option(
            "--output", "-o", metavar="FILE", help="Where the result goes; its extension picks the format."
        ),
    ],
    preset: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|FILE.toml",
            help="A look, as bokehnet presets lists them; options given beside it prevail.",
            autocompletion=presets,
        ),
    ] = None,
    settings: Annotated[
        str | None,
        typer.Option(metavar="FILE.toml", help="Settings by groups; preset and options prevail."),
    ] = None,
    quiet: Annotated[
        bool, typer.Option("--quiet", "-q", help="Say nothing but errors; default: one line when it is done.")
    ] = False,
    verbose: Annotated[
        bool, typer.Option("--verbose", "-v", help="Say what each step took, too; of each frame.")
    ] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print one JSON object on stdout in place of the line.")
    ] = False,
    *,
    given: Given,
) -> None:
    """Render bokeh from an image and its depth or disparity.

    What was done is told in one line on stderr: size, engine, focus, largest blur, repair of the map, time.
    """
    sequence, run = SequenceSettings(**given.pop("sequence", {})), RunSettings(**given.pop("run", {}))
    resolved = resolved_settings(settings, preset, given)
    from bokehnet.cli.commands.models import ensure_model
    from bokehnet.cli.progress import compile_notice
    from bokehnet.cli.render.frame import (  # after parsing, so --help stays fast
        FrameJob,
        frame_jobs,
        render_one,
    )
    from bokehnet.cli.render.summary import make_talk
    from bokehnet.io.video.frames import is_video
    from bokehnet.sequence.frame_names import is_pattern

    talk = make_talk(quiet=quiet, verbose=verbose, as_json=as_json)

    if is_video(image):
        from bokehnet.cli.render.video import render_video

        render_video(Path(image), Path(output), resolved, sequence, run, quiet=quiet, as_json=as_json)
        return
    if run.video_codec is not None:
        raise ParameterError("IMAGE", expected="a video for --video-codec", shown=image)
    job = FrameJob(image=Path(image), output=Path(output), settings=resolved)
    if sequence.frames is None:
        if (sequence, run) != (SequenceSettings(), RunSettings()):
            raise ParameterError(
                "sequence.frames",
                expected="frames, which --jobs, --overwrite, --pull, --ray, --steady, "
                "and what ends in -from and -to need",
                shown="none",
            )
        if is_pattern(job.image) and not job.image.exists():
            raise ParameterError(
                "sequence.frames",
                expected=f"frames such as 1001-1100, since {image} names a sequence",
                shown="none",
            )
        job.check()
        ensure_model(resolved.input.depth_model)
        with compile_notice(hidden=quiet):
            talk.of_one(render_one(job, quiet=quiet))
        return
    wanted = frame_jobs(job, sequence)
    ensure_model(resolved.input.depth_model)
    if run.ray is not None and run.jobs is not None:
        raise ParameterError("--ray", expected="either this or --jobs", shown="both", remedy="leave one out")
    from bokehnet.cli.render.cluster_frames import render_on_cluster
    from bokehnet.cli.render.workers import render_frames  # which single pictures start faster without

    elsewhere = None if run.ray is None else partial(render_on_cluster, address=run.ray)
    with compile_notice(hidden=quiet):
        render_frames(
            wanted,
            processes=run.jobs or 1,
            elsewhere=elsewhere,
            overwrite=run.overwrite,
            steady=run.steady == "on",
            talk=talk,
        )
