"""``bokehnet studio``: a page in the browser on which one plays with bokeh."""

import signal
import sys
from pathlib import Path
from typing import Annotated

import typer

from bokehnet.cli.options import Given, resolved_settings, with_options
from bokehnet.errors import MissingExtraError, ParameterError
from bokehnet.settings.preset import presets
from bokehnet.settings.settings import group_types

__all__ = ["studio"]


@with_options(group_types())
def studio(
    image: Annotated[
        str | None, typer.Argument(metavar="[IMAGE]", help="All-in-focus picture; or drop one on the page.")
    ] = None,
    preset: Annotated[
        str | None,
        typer.Option(metavar="NAME|FILE.toml", help="A look to begin with.", autocompletion=presets),
    ] = None,
    settings: Annotated[
        str | None,
        typer.Option(metavar="FILE.toml", help="Settings to begin with; preset and options prevail."),
    ] = None,
    port: Annotated[str | None, typer.Option(metavar="N", help="Port of this machine; default: any.")] = None,
    no_browser: Annotated[
        bool, typer.Option("--no-browser", help="Print the address, and open no browser.")
    ] = False,
    *,
    given: Given,
) -> None:
    """Play with bokeh on a page in the browser; nothing leaves this machine."""
    if port is not None and not (port.isdigit() and int(port) < 2**16):
        raise ParameterError("--port", "a whole number from 0 to 65535", port)
    resolved = resolved_settings(settings, preset, given)
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
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(1))  # what was made for the page goes
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
                f"bokehnet studio: {address}\nOnly this machine sees it. Ctrl-C ends it."
            ),
        )
    finally:
        session.close()
