"""Frames of a shot on a Ray cluster: one task each, repeated elsewhere if its worker dies."""

from collections.abc import Generator, Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from bokehnet.cli.render.frame import FrameJob, make_renderer
from bokehnet.cli.render.shot.workers import try_frame
from bokehnet.cli.render.summary import FrameSummary
from bokehnet.processes.cluster import cluster_connection, results_as_completed
from bokehnet.render.renderer import BokehRenderer
from bokehnet.sequence.sequence import input_files
from bokehnet.settings.settings import RenderSettings

__all__ = ["render_on_cluster"]

# Running tasks per core: enough to keep all cores busy.
_TASKS_PER_CORE = 2

# Renderer of a worker by its settings; one shot needs a single one.
_renderers: dict[str, BokehRenderer] = {}


def render_on_cluster(
    jobs: Mapping[int, FrameJob], settings: RenderSettings, address: str
) -> Generator[tuple[int, FrameSummary | str], None, None]:
    """Render ``jobs`` and yield each frame on completion, with its summary or its error message.

    Workers read and write the files themselves, so their machines must see the same folders. A frame that is
    repeated because its worker died is written twice with the same bytes. When the caller stops, also by
    Ctrl-C, running frames are cancelled and leave no partial files.

    Args:
        jobs: Frame number to job; started in this order.
        settings: Settings for the renderer of all jobs.
        address: Address of a running cluster, as for :func:`bokehnet.processes.cluster.cluster_connection`.

    Raises:
        MissingExtraError: Ray is not installed.
        ParameterError: There is no cluster at ``address``.
    """
    with cluster_connection(address, "--ray") as (ray, cores):
        settings = _with_absolute_paths(settings)
        tasks = ((frame, (_absolute(job), settings)) for frame, job in jobs.items())
        yield from results_as_completed(ray, _render, tasks, _TASKS_PER_CORE * cores)


def _render(task: tuple[FrameJob, RenderSettings]) -> FrameSummary | str:
    """Render a frame in a worker, which keeps its renderer."""
    job, settings = task
    key = str(settings.to_table())
    if key not in _renderers:
        _renderers.clear()
        _renderers[key] = make_renderer(settings, threads=1)
    return try_frame(job, _renderers[key])


def _absolute(job: FrameJob) -> FrameJob:
    """Return the job with absolute paths, independent of a worker's current folder."""
    files: dict[str, Any] = {name: path for name, path in input_files(job.settings).items() if path.exists()}
    settings = replace(job.settings, input=replace(job.settings.input, **files))
    return replace(
        job, image=job.image.absolute(), output=job.output.absolute(), settings=_with_absolute_paths(settings)
    )


def _with_absolute_paths(settings: RenderSettings) -> RenderSettings:
    """Return the settings with absolute paths for existing files and for the folder of maps."""
    groups: dict[str, Any] = {}
    for group in fields(settings):
        values = getattr(settings, group.name)
        by_name = {field.name: getattr(values, field.name) for field in fields(values)}
        groups[group.name] = replace(
            values,
            **{
                name: value.absolute()
                for name, value in by_name.items()
                if isinstance(value, Path) and (value.exists() or name == "save_maps")
            },
        )
    lens = groups["lens"]
    if lens.name is not None and Path(lens.name).is_file():
        groups["lens"] = replace(lens, name=str(Path(lens.name).absolute()))
    return replace(settings, **groups)
