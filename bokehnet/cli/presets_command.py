"""``bokehnet presets``: what looks there are, and the file of one to copy and change."""

from typing import Annotated

import typer

from bokehnet.cli.presets import preset_names, preset_path

__all__ = ["presets"]


def presets(
    name: Annotated[
        str | None, typer.Argument(help="Print the file of this preset, to copy and change.")
    ] = None,
) -> None:
    """List the looks for bokehnet render --preset, or show one of them."""
    import tomllib

    if name is not None:
        typer.echo(preset_path(name).read_text(encoding="utf-8").rstrip())
        return
    width = max(map(len, preset_names()))
    for preset in preset_names():
        table = tomllib.loads(preset_path(preset).read_text(encoding="utf-8"))
        typer.echo(f"{preset:{width}}  {table['description']}")
