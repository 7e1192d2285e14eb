"""``bokehnet trace``: a scene through a lens, by ray tracing."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from bokehnet.errors import ParameterError

__all__ = ["trace"]


def trace(
    scene: Annotated[Path, typer.Argument(help="Scene file, TOML; see configs/scene_*.toml.")],
    output: Annotated[
        Path, typer.Option("--output", "-o", help="EXR file; a picture begun there is carried on.")
    ],
    samples: Annotated[int | None, typer.Option(min=1, help="Of each pixel; default: the scene's.")] = None,
    seed: Annotated[int | None, typer.Option(help="Of the noise; default: the scene's.")] = None,
    width: Annotated[int | None, typer.Option(help="Pixels; default: the scene's.")] = None,
    height: Annotated[int | None, typer.Option(help="Pixels; default: the scene's.")] = None,
    layers: Annotated[
        int | None, typer.Option(min=1, help="Write this many surfaces along each pinhole ray instead.")
    ] = None,
    device: Annotated[str, typer.Option(help="Where rays are followed: cpu, cuda.")] = "cpu",
    fresh: Annotated[bool, typer.Option("--fresh", help="Replace what is there, whatever it is.")] = False,
) -> None:
    """Trace a scene: bokeh, all-in-focus, depth, normals and more in one EXR file.

    Ctrl-C keeps the samples so far; the same command goes on from there.
    """
    from bokehnet.io.image import check_writable  # after parsing, so --help stays fast
    from bokehnet.scenes import read_scene

    given = {
        "render.samples": samples,
        "render.seed": seed,
        "camera.width": width,
        "camera.height": height,
    }
    check_writable(output, (".exr",))
    _check_device(device)
    job = read_scene(scene, {key: value for key, value in given.items() if value is not None}, device)
    if layers is None:
        _trace_film(job, output, device, fresh)
    else:
        _peel_layers(job, output, device, layers)


def _trace_film(job: Any, output: Path, device: str, fresh: bool) -> None:
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
            while film.samples < wanted:
                report(film.samples, wanted)
                film = tracer.advance(film, wanted)
            report(wanted, wanted)
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
