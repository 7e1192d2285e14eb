"""``bokehnet render`` for videos."""

import json
import sys
from dataclasses import asdict
from pathlib import Path
from time import perf_counter

from bokehnet.cli.commands.models import ensure_model
from bokehnet.cli.options import with_option_names
from bokehnet.cli.progress import compile_notice, stages
from bokehnet.cli.render.frame import check_track, make_renderer, write_track_notice
from bokehnet.cli.render.run_settings import RunSettings
from bokehnet.cli.render.summary import assumed
from bokehnet.errors import ParameterError
from bokehnet.io.color.srgb import linear_to_srgb
from bokehnet.io.video.frames import choose_codec, read_video, video_info
from bokehnet.scene.depth.depth_source import gives_metric_depth
from bokehnet.sequence.sequence import SequenceSettings, make_pull
from bokehnet.sequence.tracking import TrackedPoint, track_point
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
    begun, info = perf_counter(), video_info(video, settings.input.color_space)
    path: list[TrackedPoint] = []
    if sequence.track is not None:
        x, y, start = (*sequence.track, 1)[:3]
        if start != 1:
            raise ParameterError(
                "--track", expected="a pixel of a video's first frame", shown=f"frame {start}"
            )
        check_track(x, y, info.width, info.height)
        encoded = (linear_to_srgb(light.clip(0, 1)) for light in read_video(info))
        path = list(track_point(enumerate(encoded, 1), x, y))
        write_track_notice(path, 1)
    metric = gives_metric_depth(settings, blur_pulled=sequence.blur_from is not None)
    job = VideoJob(
        info=info,
        output=output,
        settings=settings,
        codec=choose_codec(output, info, run.video_codec),
        pull=make_pull(range(1, len(info.times) + 1), sequence, metric=metric, path=path),
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
        print(f"{line}, {seconds:.1f} s{assumed(report.assumptions)}", file=sys.stderr)  # noqa: T201
