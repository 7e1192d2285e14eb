"""Frames of a shot on a Ray cluster: each is a task, and a task whose worker dies is done again elsewhere."""

from collections.abc import Generator, Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from bokehnet.cli.render.frame import FrameJob, make_renderer
from bokehnet.cli.render.summary import FrameSummary
from bokehnet.cli.render.workers import try_frame
from bokehnet.cluster import as_they_end, connected
from bokehnet.render.renderer import BokehRenderer
from bokehnet.sequence.sequence import input_files
from bokehnet.settings.settings import RenderSettings

__all__ = ["render_on_cluster"]

# Frames under way for each core: enough that none waits for another.
_AHEAD = 2

# The renderer of a worker, by its settings; one shot needs one.
_warm: dict[str, BokehRenderer] = {}


def render_on_cluster(
    jobs: Mapping[int, FrameJob], settings: RenderSettings, address: str
) -> Generator[tuple[int, FrameSummary | str], None, None]:
    """Render ``jobs`` by frame, and yield each when it is done, with what was done or why it failed.

    Workers read and write the files themselves, so their machines must see the same folders; a frame that is
    done twice, since its worker died late, is written twice with the same bytes. When the caller stops, by
    Ctrl-C too, frames under way are given up and leave no half of a file.

    Args:
        jobs: By frame; started in their order.
        settings: What makes a renderer for all of them.
        address: Of a cluster that runs, as :func:`bokehnet.cluster.connected` takes it.

    Raises:
        MissingExtraError: Ray is not installed.
        ParameterError: There is no cluster at ``address``.
    """
    with connected(address, "--ray") as (ray, cores):
        settings = _with_absolute_paths(settings)
        tasks = ((frame, (_absolute(job), settings)) for frame, job in jobs.items())
        yield from as_they_end(ray, _render, tasks, _AHEAD * cores)


def _render(task: tuple[FrameJob, RenderSettings]) -> FrameSummary | str:
    """Render a frame in a worker, whose renderer stays warm."""
    job, settings = task
    key = str(settings.to_table())
    if key not in _warm:
        _warm.clear()
        _warm[key] = make_renderer(settings, threads=1)
    return try_frame(job, _warm[key])


def _absolute(job: FrameJob) -> FrameJob:
    """The same with paths that do not depend on where a worker was started."""
    files: dict[str, Any] = {name: path for name, path in input_files(job.settings).items() if path.exists()}
    settings = replace(job.settings, input=replace(job.settings.input, **files))
    return replace(
        job, image=job.image.absolute(), output=job.output.absolute(), settings=_with_absolute_paths(settings)
    )


def _with_absolute_paths(settings: RenderSettings) -> RenderSettings:
    """The same with files that are there, and the folder of maps, named from the root."""
    groups: dict[str, Any] = {}
    for group in fields(settings):
        values = getattr(settings, group.name)
        told = {field.name: getattr(values, field.name) for field in fields(values)}
        groups[group.name] = replace(
            values,
            **{
                name: value.absolute()
                for name, value in told.items()
                if isinstance(value, Path) and (value.exists() or name == "save_maps")
            },
        )
    lens = groups["lens"]
    if lens.name is not None and Path(lens.name).is_file():
        groups["lens"] = replace(lens, name=str(Path(lens.name).absolute()))
    return replace(settings, **groups)
