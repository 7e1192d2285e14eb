"""``bokehnet trace``: a scene through a lens, by ray tracing."""

import contextlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from bokehnet.errors import ParameterError

__all__ = ["trace"]

_METHODS = ("distribution", "accumulation", "peeled")

# Surfaces of a pixel that are kept without --layers; tiles of a picture on a cluster without --tiles.
_LAYERS, _TILES = 6, 32


def trace(
    scene: Annotated[Path, typer.Argument(help="Scene file, TOML; see configs/scene_*.toml.")],
    output: Annotated[
        Path, typer.Option("--output", "-o", help="EXR file; a picture begun there is carried on.")
    ],
    method: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="distribution: each pixel's rays fill the pupil (default); accumulation: whole pictures, "
            "each from one point of it; peeled: surfaces one behind the other.",
        ),
    ] = None,
    samples: Annotated[int | None, typer.Option(min=1, help="Of each pixel; default: the scene's.")] = None,
    views: Annotated[
        int | None, typer.Option(min=1, help="With --method accumulation: how many pictures.")
    ] = None,
    adaptive: Annotated[
        bool,
        typer.Option("--adaptive", help="Send more rays where they differ; --samples is then the mean."),
    ] = False,
    seed: Annotated[int | None, typer.Option(help="Of the noise; default: the scene's.")] = None,
    width: Annotated[int | None, typer.Option(help="Pixels; default: the scene's.")] = None,
    height: Annotated[int | None, typer.Option(help="Pixels; default: the scene's.")] = None,
    layers: Annotated[
        int | None, typer.Option(min=1, help="Write this many surfaces along each pinhole ray instead.")
    ] = None,
    tiles: Annotated[
        int | None, typer.Option(min=1, help="Trace the picture in so many strips, which takes less memory.")
    ] = None,
    ray: Annotated[
        str | None,
        typer.Option("--ray", metavar="ADDRESS", help="Trace the strips on the Ray cluster there, or auto."),
    ] = None,
    device: Annotated[str, typer.Option(help="Where rays are followed: cpu, cuda.")] = "cpu",
    fresh: Annotated[bool, typer.Option("--fresh", help="Replace what is there, whatever it is.")] = False,
) -> None:
    """Trace a scene: bokeh, all-in-focus, depth, normals and more in one EXR file.

    Ctrl-C keeps the samples so far; the same command goes on from there.
    """
    from bokehnet.io.image import check_writable  # after parsing, so --help stays fast
    from bokehnet.scenes import read_scene

    _check_together(method, samples, views, layers, adaptive, tiles, ray)
    peeled = method == "peeled" or layers is not None
    given = {
        "render.samples": samples if views is None else views,
        "render.seed": seed,
        "render.method": None if peeled else method,
        "render.adaptive": adaptive or None,
        "camera.width": width,
        "camera.height": height,
    }
    check_writable(output, (".exr",))
    _check_device(device)
    overrides = {key: value for key, value in given.items() if value is not None}
    job = read_scene(scene, overrides, device)
    if peeled:
        _peel_layers(job, output, device, layers or _LAYERS)
        return
    if tiles is None and ray is None:
        advance = _whole(job, device)
    else:
        if job.render.adaptive:
            raise ParameterError("--tiles", "a scene without render.adaptive", shown="one with it")
        if tiles is not None and tiles > job.camera.height:
            raise ParameterError("--tiles", f"at most the {job.camera.height} rows of the picture", tiles)
        count = min(tiles or _TILES, job.camera.height)
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
    """Raise ``ParameterError`` where options do not go together."""
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
        found = "--adaptive" if adaptive else "peeled layers"
        raise ParameterError(in_parts, "pixels of equally many samples", shown=found)


def _whole(job: Any, device: str) -> Any:
    """What carries a film on, in this process, until it has its samples."""
    from bokehnet.raytrace.adaptive import advance_adaptive

    tracer = job.tracer(device)

    def advance(film: Any, wanted: int) -> Iterator[Any]:
        while film.samples < wanted:
            film = advance_adaptive(tracer, film) if job.render.adaptive else tracer.advance(film, wanted)
            yield film

    return advance


def _in_tiles(
    job: Any, scene: Path, overrides: dict[str, Any], device: str, count: int, address: str | None
) -> Any:
    """The same in tiles, here or on a cluster."""
    from bokehnet.cli.commands.cluster_tiles import tiles_on_cluster
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
    def here() -> Iterator[Any]:
        yield lambda tasks: ((index, run_tile(task)) for index, task in enumerate(tasks))

    def advance(film: Any, wanted: int) -> Iterator[Any]:
        rows = tile_rows(job.camera.height, count)
        with here() if address is None else tiles_on_cluster(address) as run:
            yield from advance_tiles(film, rows, task, run, wanted)

    return advance


def _trace_film(job: Any, output: Path, device: str, fresh: bool, advance: Any) -> None:
    from bokehnet.cli.progress import progress
    from bokehnet.scenes import load_film, save_film

    tracer = job.tracer(device)
    film = load_film(output, job.digest, device) if output.exists() and not fresh else tracer.begin()
    wanted = job.render.samples
    if film.samples >= wanted:
        typer.echo(f"{output} has {film.samples} samples already")
        return
    begun = film.samples
    try:
        with progress("tracing samples") as report:
            report(begun, wanted)
            for after in advance(film, wanted):
                film = after
                report(min(film.samples, wanted), wanted)
    finally:
        if film.samples > begun:
            names = [body.name for body in job.world.bodies]
            maps = tracer.maps()
            save_film(output, film, replace(maps, depth=job.sensor_depth(maps.depth)), job.digest, names)
            typer.echo(f"wrote {output}: {film.samples} of {wanted} samples")


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
    typer.echo(f"wrote {output}: {layers} layers")


def _check_device(device: str) -> None:
    """Raise ``ParameterError`` unless torch can compute there."""
    import torch

    try:
        torch.zeros(1, device=device)
    except (AssertionError, RuntimeError) as error:
        raise ParameterError("--device", expected="one that torch can use here", got=device) from error
