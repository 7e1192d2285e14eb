"""The application around the commands, and the one handler that turns our errors into one line."""

import atexit
import os
import sys
import threading
import warnings
from collections.abc import Sequence
from typing import Annotated

import typer

from bokehnet.cli.commands.compare import compare
from bokehnet.cli.commands.demo import demo
from bokehnet.cli.commands.depth import depth
from bokehnet.cli.commands.export import export
from bokehnet.cli.commands.info import info
from bokehnet.cli.commands.models import models
from bokehnet.cli.commands.presets import presets
from bokehnet.cli.commands.serve import serve
from bokehnet.cli.commands.studio import studio
from bokehnet.cli.commands.synth import synth
from bokehnet.cli.commands.trace import trace
from bokehnet.cli.commands.warm_up import warm_up
from bokehnet.cli.lens.command import lens
from bokehnet.cli.options import QuickGroup, SectionedCommand, told
from bokehnet.cli.render.command import render
from bokehnet.errors import BokehnetError
from bokehnet.version import __version__

__all__ = ["app", "main", "run"]

_INTERRUPTED = 130  # 128 + SIGINT, as shells count

# Base of the parser's complaints about flags and arguments; typer does not export it by a name of its own.
_UsageError: type[Exception] = typer.BadParameter.__mro__[1]

app = typer.Typer(
    name="bokehnet",
    help="Hybrid classical and neural bokeh rendering from a picture and its depth.",
    cls=QuickGroup,
    context_settings={"help_option_names": ["-h", "--help"]},
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)
app.command(cls=SectionedCommand)(render)
app.command(cls=SectionedCommand)(compare)
app.command()(demo)
app.command()(depth)
app.command()(export)
app.command()(info)
app.add_typer(lens)
app.command()(models)
app.command()(presets)
app.command(cls=SectionedCommand)(serve)
app.command(cls=SectionedCommand)(studio)
app.command()(synth)
app.command()(trace)
app.command()(warm_up)


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"bokehnet {__version__}")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def _root(
    context: typer.Context,
    version: Annotated[
        bool,
        typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version and exit."),
    ] = False,
) -> None:
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


def run(arguments: Sequence[str]) -> int:
    """Run one command line and return its exit code.

    Args:
        arguments: the words after the program's name.

    Returns:
        0 when done, 1 after a mistake of the user's (told in one line on stderr), 130 after Ctrl-C.
        Any other exception is a bug and passes through with its traceback.
    """
    try:
        code = app(args=list(arguments), prog_name="bokehnet", standalone_mode=False)
    except BokehnetError as error:
        return _fail(told(error))
    except _UsageError as error:
        return _fail(f"{error.format_message().rstrip('.')}; see bokehnet --help")  # type: ignore[attr-defined]
    except MemoryError as error:
        return _fail(f"out of memory, try a smaller picture ({error})")
    except (KeyboardInterrupt, typer.Abort):
        code = _INTERRUPTED
    if code == _INTERRUPTED:
        typer.echo("bokehnet: interrupted", err=True)
    return code if isinstance(code, int) else 0


def main() -> None:
    """Entry point of the ``bokehnet`` program."""
    # Of NumPy: what overflows is told in words where it matters.
    warnings.simplefilter("ignore", RuntimeWarning)
    _leave(run(sys.argv[1:]))


def _leave(code: int) -> None:
    """End the program, all that was asked for being done.

    Python takes itself apart object by object, a fifth of a second once numba is loaded. The system takes all
    back at once; what modules have asked to be done at the end is done before.
    """
    alone = all(thread.daemon or thread is threading.current_thread() for thread in threading.enumerate())
    try:
        sys.stdout.flush()
        sys.stderr.flush()
    except (OSError, ValueError, AttributeError):  # nobody listens: Python knows what to do then
        alone = False
    if alone:
        atexit._run_exitfuncs()
        os._exit(code)
    sys.exit(code)


def _fail(message: str) -> int:
    line = " ".join(message.split())
    typer.echo(f"bokehnet: error: {line}", err=True)
    return 1
