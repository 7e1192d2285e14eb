"""``bokehnet synth``: rendering of training pairs."""

from pathlib import Path

import click

from bokehnet.cli.parser import PATH, SectionedCommand

__all__ = ["synth"]


@click.command(cls=SectionedCommand)
@click.option(
    "--config",
    type=PATH,
    required=True,
    help="Configuration of the data set, TOML; see configs/synth_*.toml.",
)
@click.option(
    "--out", type=PATH, required=True, help="Folder for the shards; an unfinished set in it is completed."
)
@click.option("--workers", type=click.IntRange(min=1), default=1, help="Number of rendering processes.")
@click.option(
    "--ray",
    metavar="ADDRESS",
    help="Ray cluster to render on: HOST:PORT, ray://HOST:PORT or auto (needs extra: cluster).",
)
@click.option(
    "settings",
    "--set",
    multiple=True,
    metavar="KEY=VALUE",
    help="Override a value of the configuration, such as scenes=100.",
)
def synth(
    config: Path,
    out: Path,
    workers: int,
    ray: str | None,
    settings: tuple[str, ...],
) -> None:
    """Render random scenes with the ray tracer as training pairs."""
    from bokehnet.cli.progress import progress
    from bokehnet.config import load_config, parse_settings
    from bokehnet.synth import SynthConfig, write_dataset

    resolved = load_config(config, SynthConfig, parse_settings(settings or []))
    with progress("rendering scenes", lines=True) as report:
        write_dataset(resolved, out, workers=workers, progress=report, cluster=ray)
    click.echo(f"wrote {out}: {resolved.scenes} scenes in {resolved.shards} shards")
