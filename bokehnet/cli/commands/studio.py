"""``bokehnet studio``: interactive rendering in the browser."""

import signal
import sys
from pathlib import Path

import click

from bokehnet.cli.options import COMMON_OPTIONS, OptionValues, resolved_settings, with_options
from bokehnet.cli.parser import SectionedCommand, argument, completion
from bokehnet.errors import MissingExtraError, ParameterError
from bokehnet.settings.preset import presets
from bokehnet.settings.settings import group_types

__all__ = ["studio"]

_COMMON = COMMON_OPTIONS | {
    "settings": "Initial settings, TOML.",
    "port": "Local port. Default: any free port.",
    "no-browser": "Print the address without opening a browser.",
}


@click.command(cls=SectionedCommand, common=_COMMON)
@argument(
    "image", required=False, metavar="[IMAGE]", help="All-in-focus picture; can also be dropped on the page."
)
@click.option(
    "--preset", metavar="NAME|FILE.toml", help="Initial preset.", shell_complete=completion(presets)
)
@click.option("--settings", metavar="FILE.toml", help="Initial settings; preset and options override them.")
@click.option("--port", metavar="N", help="Local port. Default: any free port.")
@click.option("--no-browser", is_flag=True, help="Print the address without opening a browser.")
@with_options(group_types())
def studio(
    image: str | None,
    preset: str | None,
    settings: str | None,
    port: str | None,
    no_browser: bool,
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
            click.echo(f"bokehnet: opening {image}", err=True)
            session.open(Path(image), resolved)
        session.preset = preset if preset in presets() else ""
        session.start()
        serve(
            session,
            port=int(port or 0),
            browser=not no_browser,
            tell=lambda address: click.echo(
                f"bokehnet studio: {address}\nOnly this machine can reach it. Press Ctrl-C to stop."
            ),
        )
    finally:
        session.close()
