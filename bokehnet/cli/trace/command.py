"""``bokehnet trace``: ray tracing of a scene through a lens."""

import contextlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from bokehnet.cli.parser import PATH, SectionedCommand, argument
from bokehnet.errors import ParameterError

__all__ = ["trace"]

_METHODS = ("distribution", "accumulation", "peeled")

# Defaults: surfaces per pixel with --method peeled, and strips of a picture on a cluster.
_DEFAULT_LAYERS, _DEFAULT_TILES = 6, 32


@click.command(cls=SectionedCommand)
@argument("scene", type=PATH, help="Scene file, TOML; see configs/scene_*.toml.")
@click.option(
    "--output", "-o", type=PATH, required=True, help="Output file, EXR; an unfinished one is continued."
)
@click.option(
    "--method",
    metavar="NAME",
    help="distribution (default): the rays of each pixel cover the pupil; accumulation: average of "
    "pinhole pictures over the pupil; peeled: successive surfaces along pinhole rays.",
)
@click.option("--samples", type=click.IntRange(min=1), help="Rays per pixel. Default: as in the scene.")
@click.option(
    "--views", type=click.IntRange(min=1), help="With --method accumulation: number of pinhole pictures."
)
@click.option("--adaptive", is_flag=True, help="Trace more rays in noisy pixels; --samples is then the mean.")
@click.option("--seed", type=int, help="Random seed. Default: as in the scene.")
@click.option("--width", type=int, help="Width, pixels. Default: as in the scene.")
@click.option("--height", type=int, help="Height, pixels. Default: as in the scene.")
@click.option(
    "--layers",
    type=click.IntRange(min=1),
    help="With --method peeled (implied): surfaces per pixel. Default: 6.",
)
@click.option(
    "--tiles", type=click.IntRange(min=1), help="Number of strips to trace one by one, which saves memory."
)
@click.option("--ray", metavar="ADDRESS", help="Ray cluster to trace the strips on: address, or auto.")
@click.option("--device", default="cpu", help="Device that traces the rays: cpu or cuda.")
@click.option("--fresh", is_flag=True, help="Start anew and replace an existing output file.")
def trace(
    scene: Path,
    output: Path,
    method: str | None,
    samples: int | None,
    views: int | None,
    adaptive: bool,
    seed: int | None,
    width: int | None,
    height: int | None,
    layers: int | None,
    tiles: int | None,
    ray: str | None,
    device: str,
    fresh: bool,
) -> None:
    """Ray-trace a scene and write an EXR file.

    The file holds bokeh, all-in-focus picture, depth, normals and more. Ctrl-C keeps the samples so far; the
    same command continues from there.
    """
    from bokehnet.io.image import check_writable  # after parsing, so --help stays fast
    from bokehnet.scenes import read_scene

    _check_together(method, samples, views, layers, adaptive, tiles, ray)
    peeled = method == "peeled" or layers is not None
    options = {
        "render.samples": samples if views is None else views,
        "render.seed": seed,
        "render.method": None if peeled else method,
        "render.adaptive": adaptive or None,
        "camera.width": width,
        "camera.height": height,
    }
    check_writable(output, (".exr",))
    _check_device(device)
    overrides = {key: value for key, value in options.items() if value is not None}
    job = read_scene(scene, overrides, device)
    if peeled:
        _peel_layers(job, output, device, layers or _DEFAULT_LAYERS)
        return
    if tiles is None and ray is None:
        advance = _whole(job, device)
    else:
        if job.render.adaptive:
            raise ParameterError("--tiles", "a scene without render.adaptive", shown="one with it")
        if tiles is not None and tiles > job.camera.height:
            raise ParameterError("--tiles", f"at most the {job.camera.height} rows of the picture", tiles)
        count = min(tiles or _DEFAULT_TILES, job.camera.height)
        advance = _in_tiles(job, scene.absolute(), overrides, device, count, ray)
    _trace_film(job, output, device, fresh, advance)


def _check_together(
    method: str | None,
    samples: int | None,
    views: int | None,
    layers: int | None,
    adaptive: bool,
    tiles: int | None,
    ray: str | None,
) -> None:
    """Raise ``ParameterError`` if options contradict each other."""
    from bokehnet.checks import check_choice

    if method is not None:
        check_choice("--method", method, _METHODS)
    if layers is not None and method not in (None, "peeled"):
        raise ParameterError("--layers", "--method peeled", shown=f"--method {method}")
    if views is not None and method != "accumulation":
        raise ParameterError("--views", "--method accumulation", shown=f"--method {method or 'distribution'}")
    if views is not None and samples is not None:
        raise ParameterError("--views", "either this or --samples", shown="both")
    if adaptive and method not in (None, "distribution"):
        raise ParameterError("--adaptive", "--method distribution", shown=f"--method {method}")
    in_parts = "--ray" if ray is not None else "--tiles"
    if (tiles is not None or ray is not None) and (adaptive or method == "peeled" or layers is not None):
        conflict = "--adaptive" if adaptive else "peeled layers"
        raise ParameterError(in_parts, "the same number of samples in all pixels", shown=conflict)


def _whole(job: Any, device: str) -> Any:
    """Return a function that advances a film in this process until it has its samples."""
    from bokehnet.raytrace.adaptive import advance_adaptive

    tracer = job.tracer(device)

    def advance(film: Any, samples: int) -> Iterator[Any]:
        while film.samples < samples:
            film = advance_adaptive(tracer, film) if job.render.adaptive else tracer.advance(film, samples)
            yield film

    return advance


def _in_tiles(
    job: Any, scene: Path, overrides: dict[str, Any], device: str, count: int, address: str | None
) -> Any:
    """Return a function that advances a film in tiles, in this process or on a cluster."""
    from bokehnet.cli.trace.cluster_tiles import tiles_on_cluster
    from bokehnet.scenes.tiles import TileTask, advance_tiles, run_tile, tile_rows

    def task(rows: tuple[int, int], means: Any, samples: int, stop: int) -> Any:
        return TileTask(
            scene=scene,
            overrides=overrides,
            digest=job.digest,
            device=device,
            rows=rows,
            means=means,
            samples=samples,
            stop=stop,
        )

    @contextlib.contextmanager
    def in_process() -> Iterator[Any]:
        yield lambda tasks: ((index, run_tile(task)) for index, task in enumerate(tasks))

    def advance(film: Any, samples: int) -> Iterator[Any]:
        rows = tile_rows(job.camera.height, count)
        with in_process() if address is None else tiles_on_cluster(address) as run:
            yield from advance_tiles(film, rows, task, run, samples)

    return advance


def _trace_film(job: Any, output: Path, device: str, fresh: bool, advance: Any) -> None:
    from bokehnet.cli.progress import progress
    from bokehnet.scenes import load_film, save_film

    tracer = job.tracer(device)
    film = load_film(output, job.digest, device) if output.exists() and not fresh else tracer.begin()
    samples = job.render.samples
    if film.samples >= samples:
        click.echo(f"{output} already has {film.samples} samples")
        return
    first = film.samples
    try:
        with progress("tracing samples") as report:
            report(first, samples)
            for advanced in advance(film, samples):
                film = advanced
                report(min(film.samples, samples), samples)
    finally:
        if film.samples > first:
            names = [body.name for body in job.world.bodies]
            maps = tracer.maps()
            save_film(output, film, replace(maps, depth=job.sensor_depth(maps.depth)), job.digest, names)
            click.echo(f"wrote {output}: {film.samples} of {samples} samples")


def _peel_layers(job: Any, output: Path, device: str, layers: int) -> None:
    from bokehnet.cli.progress import progress
    from bokehnet.raytrace.peeling import peel
    from bokehnet.scenes.layers import save_layers

    with progress("tracing layers") as report:
        peeled = peel(
            job.world,
            job.camera,
            layers,
            samples=job.render.samples,
            seed=job.render.seed,
            bounces=job.render.bounces,
            device=device,
            progress=report,
        )
    save_layers(output, replace(peeled, depth=job.sensor_depth(peeled.depth)))
    click.echo(f"wrote {output}: {layers} layers")


def _check_device(device: str) -> None:
    """Raise ``ParameterError`` unless torch can use the device."""
    import torch

    try:
        torch.zeros(1, device=device)
    except (AssertionError, RuntimeError) as error:
        raise ParameterError("--device", expected="a device that torch can use here", got=device) from error
