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
from bokehnet.studio.scene_preview import SCENE_SUFFIXES

__all__ = ["studio"]

_COMMON = COMMON_OPTIONS | {
    "settings": "Initial settings, TOML.",
    "port": "Local port. Default: any free port.",
    "no-browser": "Print the address without opening a browser.",
}


@click.command(cls=SectionedCommand, common=_COMMON)
@argument(
    "image",
    required=False,
    metavar="[IMAGE]",
    help="All-in-focus picture; can also be dropped on the page. "
    "Or a 3-D scene (TOML) or mesh (OBJ, PLY, STL, GLB): orbit, focus and change the lens.",
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
    """Open an interactive page in the browser.

    Nothing leaves this machine.
    """
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
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(1))  # runs the cleanup of `serve`
    if image is not None and Path(image).suffix.lower() in SCENE_SUFFIXES:
        from bokehnet.checks import require_extra

        require_extra("torch", "trace")
        from bokehnet.studio.scene_preview.app import make_scene_app
        from bokehnet.studio.scene_preview.session import SceneSession

        if option_values or preset or settings:
            raise ParameterError(
                "image",
                "a picture for settings of a render",
                shown=f"the scene {image}",
                remedy="change lens and focus on the page, or in the file",
            )
        scene = SceneSession(Path(image))
        serve(scene, make_scene_app, port=int(port or 0), browser=not no_browser, tell=_tell)
        return
    from bokehnet.studio.app import make_app
    from bokehnet.studio.session import Session

    session = Session()
    try:
        if image is not None:
            click.echo(f"bokehnet: opening {image}", err=True)
            session.open(Path(image), resolved)
        session.preset = preset if preset in presets() else ""
        session.start()
        serve(session, make_app, port=int(port or 0), browser=not no_browser, tell=_tell)
    finally:
        session.close()


def _tell(address: str) -> None:
    click.echo(f"bokehnet studio: {address}\nOnly this machine can reach it. Press Ctrl-C to stop.")
