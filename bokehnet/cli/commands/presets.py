"""``bokehnet presets``: list of the shipped looks, and the file of one to copy and change."""

from typing import Annotated

import typer

from bokehnet.io.text import read_text
from bokehnet.settings.preset import load_preset, preset_file
from bokehnet.settings.preset import presets as preset_names

__all__ = ["presets"]


def presets(
    name: Annotated[str | None, typer.Argument(help="Preset whose file to print. Default: list all.")] = None,
) -> None:
    """List the presets for `bokehnet render --preset`, or print the file of one."""
    if name is not None:
        typer.echo(read_text(preset_file(name), "preset").rstrip())
        return
    names = preset_names()
    width = max(map(len, names))
    for preset in names:
        typer.echo(f"{preset:{width}}  {load_preset(preset).description}")
