"""``bokehnet demo``: the shipped demo picture at three focus distances."""

from pathlib import Path
from typing import get_args

import click

from bokehnet.cli.parser import PATH, SectionedCommand
from bokehnet.settings.settings import EngineName

__all__ = ["demo"]


@click.command(cls=SectionedCommand)
@click.option(
    "--output",
    "-o",
    type=PATH,
    default=Path("bokehnet_demo.png"),
    help="Output file of the contact sheet; its extension sets the format.",
)
@click.option("--engine", default="rays", help=f"Engine: {', '.join(get_args(EngineName))}.")
def demo(
    output: Path,
    engine: str,
) -> None:
    """Render the demo picture at three focus distances.

    Writes a contact sheet of the renders.
    """
    from bokehnet.cli.progress import compile_notice, progress  # after parsing, so --help stays fast
    from bokehnet.io.image import check_writable, write_image
    from bokehnet.render.renderer import BokehRenderer
    from bokehnet.tools.demo import demo_sheet

    check_writable(output)
    renderer = BokehRenderer(engine)  # type: ignore[arg-type]  # checks the name
    with compile_notice(), progress("rendering", counted=False) as report:
        write_image(output, demo_sheet(renderer, report))
    click.echo(f"wrote {output}: the input, its disparity and three focus distances (engine {engine})")
