"""``bokehnet synth``: write training pairs."""

from pathlib import Path
from typing import Annotated

import typer

__all__ = ["synth"]


def synth(
    config: Annotated[Path, typer.Option(help="What to make: a TOML file, see configs/synth_*.toml.")],
    out: Annotated[Path, typer.Option(help="Folder for the shards; a set begun there is completed.")],
    workers: Annotated[int, typer.Option(min=1, help="Processes that render.")] = 1,
    ray: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Render on this Ray cluster instead: HOST:PORT, ray://HOST:PORT or auto (extra: cluster).",
        ),
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Replace a value of the configuration: scenes=100."),
    ] = None,
) -> None:
    """Render random scenes with the ray tracer and write them as training pairs."""
    from bokehnet.cli.progress import progress
    from bokehnet.config import load_config, parse_settings
    from bokehnet.synth import SynthConfig, write_dataset

    resolved = load_config(config, SynthConfig, parse_settings(settings or []))
    with progress("rendering scenes") as report:
        write_dataset(resolved, out, workers=workers, progress=report, cluster=ray)
