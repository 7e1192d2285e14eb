"""``bokehnet studio``: interactive rendering in the browser."""

import signal
import sys
from pathlib import Path
from typing import Annotated

import typer

from bokehnet.cli.options import OptionValues, resolved_settings, with_options
from bokehnet.errors import MissingExtraError, ParameterError
from bokehnet.settings.preset import presets
from bokehnet.settings.settings import group_types

__all__ = ["studio"]


@with_options(group_types())
def studio(
    image: Annotated[
        str | None,
        typer.Argument(metavar="[IMAGE]", help="All-in-focus picture; can also be dropped on the page."),
    ] = None,
    preset: Annotated[
        str | None,
        typer.Option(metavar="NAME|FILE.toml", help="Initial preset.", autocompletion=presets),
    ] = None,
    settings: Annotated[
        str | None,
        typer.Option(metavar="FILE.toml", help="Initial settings; preset and options override them."),
    ] = None,
    port: Annotated[str | None, typer.Option(metavar="N", help="Local port. Default: any free port.")] = None,
    no_browser: Annotated[
        bool, typer.Option("--no-browser", help="Print the address without opening a browser.")
    ] = False,
    *,
    option_values: OptionValues,
) -> None:
    """Open an interactive page in the browser; nothing leaves this machine."""
    if port is not None and not (port.isdigit() and int(port) < 2**16):
        raise ParameterError("--port", "a whole number from 0 to 65535", port)
    resolved = resolved_settings(settings, preset, option_values)
    try:
        from bokehnet.studio.server import serve  # after parsing, so --help stays fast
    except ImportError as error:
        if error.name is None or error.name.split(".")[0] not in ("starlette", "uvicorn", "anyio"):
            raise
        raise MissingExtraError(
            f"bokehnet studio needs {error.name}, which is not installed: pip install 'bokehnet[studio]'"
        ) from error
    from bokehnet.studio.session import Session

    session = Session()
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(1))  # runs the cleanup below
    try:
        if image is not None:
            typer.echo(f"bokehnet: opening {image}", err=True)
            session.open(Path(image), resolved)
        session.start()
        serve(
            session,
            port=int(port or 0),
            browser=not no_browser,
            tell=lambda address: typer.echo(
                f"bokehnet studio: {address}\nOnly this machine can reach it. Press Ctrl-C to stop."
            ),
        )
    finally:
        session.close()
