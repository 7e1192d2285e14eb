"""Completion of commands, options and values in bash, zsh, fish and PowerShell.

The parser makes the scripts; they call the program for the words, so one installation serves all
versions.
"""

import os
from pathlib import Path

import click
from click.shell_completion import get_completion_class

from bokehnet.cli.parser import completion
from bokehnet.errors import ParameterError

__all__ = ["install_completion", "show_completion"]

_PROGRAM = "bokehnet"
_VARIABLE = "_BOKEHNET_COMPLETE"
_SHELLS = ("bash", "zsh", "fish", "powershell")

# File with the script below the home folder, start-up file of the shell, and its line that loads the script.
_PLACES = {
    "bash": (".bash_completions/bokehnet.sh", ".bashrc", "source ~/.bash_completions/bokehnet.sh"),
    "zsh": (".zfunc/_bokehnet", ".zshrc", "fpath+=~/.zfunc; autoload -Uz compinit; compinit"),
    "fish": (".config/fish/completions/bokehnet.fish", None, None),
}


def completion_script(flag: str, shell: str) -> tuple[str, str]:
    """Return a shell's name and its completion script.

    Args:
        flag: Option, for messages.
        shell: Name of the shell; empty for that of this session.

    Raises:
        ParameterError: There is no completion for the shell.
    """
    name = shell or Path(os.environ.get("SHELL", "none")).stem
    kind = get_completion_class(name) if name in _SHELLS else None
    if kind is None:
        raise ParameterError(flag, expected=f"one of {', '.join(_SHELLS)}", got=name)
    return name, kind(click.Command(_PROGRAM), {}, _PROGRAM, _VARIABLE).source()


def _show(ctx: click.Context, param: click.Parameter, shell: str | None) -> None:
    if shell is not None and not ctx.resilient_parsing:
        click.echo(completion_script("--show-completion", shell)[1].rstrip())
        ctx.exit()


def _install(ctx: click.Context, param: click.Parameter, shell: str | None) -> None:
    if shell is None or ctx.resilient_parsing:
        return
    name, script = completion_script("--install-completion", shell)
    if name not in _PLACES:
        raise ParameterError(
            "--install-completion",
            expected=f"one of {', '.join(_PLACES)}",
            got=name,
            remedy="append the output of --show-completion to the profile",
        )
    place, startup, line = _PLACES[name]
    path = Path.home() / place
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"{script.rstrip()}\n", encoding="utf-8")
    if startup is not None and line is not None:
        settings = Path.home() / startup
        text = settings.read_text(encoding="utf-8") if settings.exists() else ""
        if line not in text.splitlines():
            separator = "" if not text or text.endswith("\n") else "\n"
            settings.write_text(f"{text}{separator}{line}\n", encoding="utf-8")
    click.echo(f"{name} completion installed in {path}; it starts with the next shell")
    ctx.exit()


_ATTRIBUTES = {
    "metavar": "[SHELL]",
    "is_flag": False,
    "flag_value": "",
    "is_eager": True,
    "expose_value": False,
    "shell_complete": completion(lambda: _SHELLS),
}

install_completion = click.option(
    "--install-completion",
    callback=_install,
    help="Install completion for this shell, or for bash, zsh or fish.",
    **_ATTRIBUTES,
)
show_completion = click.option(
    "--show-completion",
    callback=_show,
    help="Print the completion script of this shell, or of bash, zsh, fish or powershell.",
    **_ATTRIBUTES,
)
