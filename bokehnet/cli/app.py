"""Command-line application, and the handler that prints bokehnet's errors as one line."""

import atexit
import contextlib
import os
import sys
import threading
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from bokehnet.cli.commands.demo import demo
from bokehnet.cli.commands.depth import depth
from bokehnet.cli.commands.export import export
from bokehnet.cli.commands.info import info
from bokehnet.cli.commands.models import models
from bokehnet.cli.commands.presets import presets
from bokehnet.cli.commands.serve import serve
from bokehnet.cli.commands.studio import studio
from bokehnet.cli.commands.synth import synth
from bokehnet.cli.commands.warm_up import warm_up
from bokehnet.cli.compare.command import compare
from bokehnet.cli.completion import install_completion, show_completion
from bokehnet.cli.lens.command import lens
from bokehnet.cli.options import message_of
from bokehnet.cli.parser import SectionedCommand
from bokehnet.cli.render.command import render
from bokehnet.cli.streams import (
    address_space_shortage,
    library_lines_caught,
    open_closed_streams,
    shortage,
    write_failure,
)
from bokehnet.cli.trace.command import trace
from bokehnet.errors import BokehnetError, ParameterError
from bokehnet.settings.settings_file import similar_name
from bokehnet.version import __version__

__all__ = ["app", "main", "run"]

# Commands that run until they are stopped: the lines of libraries are their log.
_SERVICES = (["serve"], ["studio"])
_QUIET, _HELP = {"-q", "--quiet"}, {"-h", "--help", "--version"}

# Names of other programs for options of ours.
_OTHER_NAMES = {
    "--amount": "--strength",
    "--aperture": "--f-number",
    "--depth-map": "--disparity",
    "--f-stop": "--f-number",
    "--fstop": "--f-number",
    "--gpu": "--device",
    "--intensity": "--strength",
    "--iris": "--blades",
    "--model": "--depth-model",
    "--radius": "--blur",
    "--size": "--blur",
}

_INTERRUPTED = 130  # exit code 128 + SIGINT, as in shells


class _Root(click.Group):
    """Group of all commands; Ctrl-C ends any of them with the exit code of shells."""

    def invoke(self, ctx: click.Context) -> Any:
        """Run a command."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as error:
            raise click.exceptions.Exit(_INTERRUPTED) from error

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the command; where its name is an existing file, the error names ``render``."""
        try:
            return super().resolve_command(ctx, args)
        except click.UsageError as error:
            if not Path(args[0]).exists():
                raise
            hint = f"{error.message} To render this file: bokehnet render {args[0]}"
            raise click.UsageError(hint, ctx) from error

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of the commands in the order of definition."""
        return list(self.commands)


@click.group(
    name="bokehnet",
    cls=_Root,
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"], "show_default": True},
)
@click.version_option(__version__, message="bokehnet %(version)s", help="Show the version and exit.")
@install_completion
@show_completion
@click.pass_context
def app(context: click.Context) -> None:
    """Render bokeh from a picture and its depth, with classical, neural and hybrid engines."""
    if context.invoked_subcommand is None:
        click.echo(context.get_help())


for _command in (
    *(render, compare, demo, depth, export, info, lens, models),
    *(presets, serve, studio, synth, trace, warm_up),
):
    # click keeps the help option of a command from its first use, which may be without the group.
    _command.context_settings.setdefault("help_option_names", ["-h", "--help"])
    app.add_command(_command)


def run(arguments: Sequence[str]) -> int:
    """Run one command line and return its exit code.

    Args:
        arguments: Words after the program's name.

    Returns:
        0 on success, 1 on a user error or an error of the system (one line on stderr), 130 after Ctrl-C. Any
        other exception is a bug and propagates with its traceback.
    """
    try:
        code = app(args=list(arguments), prog_name="bokehnet", standalone_mode=False)
    except BokehnetError as error:
        return _fail(message_of(error) + _help_hint(arguments, error))
    except click.NoSuchOption as error:
        return _fail(f"{error.option_name}: no such option; {_advice(error)}")
    except click.UsageError as error:
        command = "bokehnet" if error.ctx is None else error.ctx.command_path
        return _fail(f"{error.format_message().rstrip('.')}; see {command} --help")
    except MemoryError as error:
        return _fail(f"out of memory, try a smaller picture ({error})")
    except BrokenPipeError:  # the reader of stdout has enough
        return 1
    except (KeyboardInterrupt, click.Abort):  # Abort is a RuntimeError
        code = _INTERRUPTED
    except (ImportError, OSError, RuntimeError) as error:
        if (problem := shortage(error)) is None:
            raise
        return _fail(problem)
    if code == _INTERRUPTED:
        click.echo("bokehnet: interrupted", err=True)
    return code if isinstance(code, int) else 0


def main() -> None:
    """Entry point of the ``bokehnet`` program."""
    # NumPy's overflow warnings: checks raise errors where they matter.
    warnings.simplefilter("ignore", RuntimeWarning)
    open_closed_streams()
    os.environ.setdefault("PYTHONSAFEPATH", "1")  # processes import no modules of the current folder
    arguments = sys.argv[1:]
    if (problem := address_space_shortage()) and not _HELP.intersection(arguments):
        _leave(_fail(problem))
    if arguments[:1] in _SERVICES:
        _leave(run(arguments))
    with library_lines_caught() as lines:
        code = run(arguments)
        code = _flushed(code)
    if code == 0 and lines.count and not _QUIET.intersection(arguments):
        click.echo(f"bokehnet: {lines.summary()}", err=True)
    _leave(code)


def _flushed(code: int) -> int:
    """Write what stdout still holds; return 1 with one line on stderr where it cannot be written."""
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        code = code or 1
    except OSError as error:
        code = _fail(write_failure(error)) if code == 0 else code
    else:
        return code
    with contextlib.suppress(OSError):  # so that the end of the process does not try again
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return code


def _leave(code: int) -> None:
    """Exit the process without Python's teardown, which takes 0.2 s once numba is loaded.

    Exit handlers of modules run before. Other threads or a broken stdout need the regular exit.
    """
    fast_exit = all(thread.daemon or thread is threading.current_thread() for thread in threading.enumerate())
    try:
        sys.stdout.flush()
        sys.stderr.flush()
    except (OSError, ValueError, AttributeError):  # closed pipe: handled by the regular exit
        fast_exit = False
    if fast_exit:
        atexit._run_exitfuncs()
        os._exit(code)
    sys.exit(code)


def _help_hint(arguments: Sequence[str], error: BokehnetError) -> str:
    """Return where the help of a wrong option is, for commands with groups of options."""
    command = app.commands.get(arguments[0]) if arguments else None
    if not isinstance(error, ParameterError) or not isinstance(command, SectionedCommand):
        return ""
    group = command.group_of(error.parameter) if command.common else ""
    return f"; see bokehnet {command.name} --help {group}" if group else ""


def _advice(error: click.NoSuchOption) -> str:
    """Return the option that a user of another name means, or where the help is."""
    assert error.ctx is not None
    flag, context = error.option_name, error.ctx
    options = [item for item in context.command.params if isinstance(item, click.Option) and not item.hidden]
    flags = {name for option in options for name in option.opts}
    near = _OTHER_NAMES.get(flag) if _OTHER_NAMES.get(flag) in flags else similar_name(flag, flags)
    return f"did you mean {near}?" if near else f"see {context.command_path} --help"


def _fail(message: str) -> int:
    line = " ".join(message.split())
    with contextlib.suppress(OSError):  # stderr may be full, or closed
        click.echo(f"bokehnet: error: {line}", err=True)
    return 1
