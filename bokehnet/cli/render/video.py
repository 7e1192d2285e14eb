"""``bokehnet render`` for videos."""

import json
import sys
from dataclasses import asdict
from pathlib import Path
from time import perf_counter

from bokehnet.cli.commands.models import ensure_model
from bokehnet.cli.options import with_option_names
from bokehnet.cli.progress import compile_notice, stages
from bokehnet.cli.render.frame import make_renderer
from bokehnet.cli.render.run_settings import RunSettings
from bokehnet.errors import ParameterError
from bokehnet.io.video.frames import choose_codec, video_info
from bokehnet.scene.depth.depth_source import gives_metric_depth
from bokehnet.sequence.sequence import SequenceSettings, make_pull
from bokehnet.sequence.video import VideoJob
from bokehnet.settings.settings import RenderSettings

__all__ = ["render_video"]


def render_video(
    video: Path,
    output: Path,
    settings: RenderSettings,
    sequence: SequenceSettings,
    run: RunSettings,
    *,
    quiet: bool = False,
    as_json: bool = False,
) -> None:
    """Render a video, or continue an interrupted run of the same command.

    Raises:
        BokehnetError: An option does not apply to videos, or a file cannot be read or written.
    """
    for name, value in (("--frames", sequence.frames), ("--jobs", run.jobs), ("--ray", run.ray)):
        if value is not None:
            raise ParameterError(
                name, expected="no such option for a video, which is rendered whole", shown="one"
            )
    begun, info = perf_counter(), video_info(video)
    metric = gives_metric_depth(settings, blur_pulled=sequence.blur_from is not None)
    job = VideoJob(
        info=info,
        output=output,
        settings=settings,
        codec=choose_codec(output, info, run.video_codec),
        pull=make_pull(range(1, len(info.times) + 1), sequence, metric=metric),
        steady=run.steady == "on",
    )
    job.check()
    ensure_model(settings.input.depth_model)
    with compile_notice(hidden=quiet), stages(hidden=quiet) as begin:
        report = job.run(make_renderer(settings), begin)
    seconds = perf_counter() - begun
    if as_json:
        table = {"output": str(output), "codec": job.codec, "seconds": round(seconds, 3), **asdict(report)}
        print(json.dumps(table))  # noqa: T201
    elif not quiet:
        for note in report.notes:
            print(f"bokehnet: note: {with_option_names(note)}", file=sys.stderr)  # noqa: T201
        resumed = report.frames - report.rendered
        line = f"{output}: {report.frames} frames of {info.width}x{info.height}, {job.codec}"
        line += f", {resumed} of them rendered before" if resumed else ""
        line += ", maps smoothed in time" if report.steady else ""
        line += "".join(f", {words}" for words in report.reading)
        print(f"{line}, {seconds:.1f} s", file=sys.stderr)  # noqa: T201
