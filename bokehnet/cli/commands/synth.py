"""``bokehnet synth``: rendering of training pairs."""

from pathlib import Path
from typing import Annotated

import typer

__all__ = ["synth"]


def synth(
    config: Annotated[
        Path, typer.Option(help="Configuration of the data set, TOML; see configs/synth_*.toml.")
    ],
    out: Annotated[Path, typer.Option(help="Folder for the shards; an unfinished set in it is completed.")],
    workers: Annotated[int, typer.Option(min=1, help="Number of rendering processes.")] = 1,
    ray: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Ray cluster to render on: HOST:PORT, ray://HOST:PORT or auto (needs extra: cluster).",
        ),
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="KEY=VALUE", help="Override a value of the configuration, such as scenes=100."
        ),
    ] = None,
) -> None:
    """Render random scenes with the ray tracer and write them as training pairs."""
    from bokehnet.cli.progress import progress
    from bokehnet.config import load_config, parse_settings
    from bokehnet.synth import SynthConfig, write_dataset

    resolved = load_config(config, SynthConfig, parse_settings(settings or []))
    with progress("rendering scenes") as report:
        write_dataset(resolved, out, workers=workers, progress=report, cluster=ray)
