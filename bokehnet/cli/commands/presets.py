"""``bokehnet presets``: list of the shipped looks, and the file of one to copy and change."""

import click

from bokehnet.cli.parser import SectionedCommand, argument
from bokehnet.io.files.text import read_text
from bokehnet.settings.preset import load_preset, preset_file
from bokehnet.settings.preset import presets as preset_names

__all__ = ["presets"]


@click.command(cls=SectionedCommand)
@argument("name", required=False, help="Preset whose file to print. Default: list all.")
def presets(
    name: str | None,
) -> None:
    """List the presets of --preset, or print the file of one."""
    if name is not None:
        click.echo(read_text(preset_file(name), "preset").rstrip())
        return
    names = preset_names()
    width = max(map(len, names))
    for preset in names:
        click.echo(f"{preset:{width}}  {load_preset(preset).description}")
