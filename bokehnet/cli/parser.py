"""Parser classes: arguments with help, options in sections, common and complete help texts, completion.

A command with groups of settings has over a hundred options. Its ``--help`` shows the common ones,
``--help GROUP`` one group and ``--help-all`` all of them.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import click
from click.shell_completion import CompletionItem

from bokehnet.errors import ParameterError

__all__ = ["PATH", "Argument", "SectionedCommand", "SectionedOption", "argument", "completion"]

# Maximum width of the names in a short help text.
_COLUMN = 34

# Remedies for a word that no option takes: for numbers and for others.
_NUMBERS_HINT = "numbers that belong together are written without a space, such as --focus-at 640,410"
_MAP_HINT = "a map needs --disparity or --depth before it"

# Path of a file or folder; nothing is checked, shells complete it.
PATH = click.Path(path_type=Path)


class Argument(click.Argument):
    """Argument with a line in the help text."""

    def __init__(self, names: Sequence[str], *, help: str = "", **attributes: Any) -> None:
        super().__init__(names, **attributes)
        self._about = help  # recent versions of click list the attribute `help` themselves

    def get_help_record(self, ctx: click.Context) -> tuple[str, str]:
        """Return placeholder and help."""
        return self.make_metavar(ctx), self._about


argument = partial(click.argument, cls=Argument)


class SectionedOption(click.Option):
    """Option in a section of the help text.

    Attributes:
        group: Name of the group of settings, as in ``--help GROUP``.
        section: Title of the group.
    """

    def __init__(self, names: Sequence[str], *, group: str, section: str, **attributes: Any) -> None:
        super().__init__(names, **attributes)
        self.group, self.section = group, section


class SectionedCommand(click.Command):
    """Command whose help has one section per group of options.

    Attributes:
        common: Name without dashes and one-line help of each option in the short help text, names of other
            commands included; empty for a single complete text.
        examples: Command lines at the end of the short help text.
    """

    def __init__(
        self, *arguments: Any, common: Mapping[str, str] | None = None, examples: str = "", **attributes: Any
    ) -> None:
        super().__init__(*arguments, **attributes)
        self.common, self.examples = dict(common or {}), examples
        if common:
            self.params.append(
                click.Option(
                    ["--help-all"],
                    is_flag=True,
                    is_eager=True,
                    expose_value=False,
                    callback=lambda ctx, param, value: (
                        _print_help(ctx, self.complete_help) if value else None
                    ),
                    help="Show all options and exit.",
                )
            )

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse the words of a command line; errors know the command."""
        words = list(args)  # the parser consumes its list
        try:
            return super().parse_args(ctx, args)
        except click.UsageError as error:
            error.ctx = error.ctx or ctx
            if problem := self._problem_of_loose_words(error, words):
                raise click.UsageError(problem, error.ctx) from error
            raise

    def _problem_of_loose_words(self, error: click.UsageError, words: Sequence[str]) -> str:
        """Return a message with a remedy for words that belong to no option; empty for other errors.

        A negative number such as ``-20`` is one of them: click reads it as the option ``-2``.
        """
        if not self.group_of("--disparity"):
            return ""
        if isinstance(error, click.NoSuchOption):
            numbers = [word for word in words if word.startswith(error.option_name) and _is_number(word)]
            return f"Got unexpected number {numbers[0]}; {_NUMBERS_HINT}" if numbers else ""
        if "extra argument" not in error.message:
            return ""
        extra = error.message.rpartition("(")[2].rstrip(").").split()
        hint = _NUMBERS_HINT if all(map(_is_number, extra)) else _MAP_HINT
        return f"{error.message.rstrip('.')}; {hint}"

    def sections(self) -> dict[str, str]:
        """Return the title of each group of options by name."""
        return {item.group: item.section for item in self.params if isinstance(item, SectionedOption)}

    def group_of(self, parameter: str) -> str:
        """Return the group of a field such as ``camera.blur`` or an option; empty if there is none."""
        options = [item for item in self.params if isinstance(item, SectionedOption)]
        name = parameter.partition(".")[0]
        return next((item.group for item in options if parameter in item.opts or name == item.group), "")

    def get_help_option(self, ctx: click.Context) -> click.Option | None:
        """Return ``--help``, with an optional group as its value."""
        if not self.common:
            return super().get_help_option(ctx)
        return click.Option(
            self.get_help_option_names(ctx),
            metavar="[GROUP]",
            is_flag=False,
            flag_value="",
            is_eager=True,
            expose_value=False,
            callback=self._show_help,
            shell_complete=completion(self.sections),
            help="Show common options, or those of a group, and exit.",
        )

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the complete sections, or the common options where there are any."""
        if self.common:
            self._write_common(ctx, formatter)
        else:
            self._write_sections(ctx, formatter, self.get_params(ctx))

    def complete_help(self, ctx: click.Context) -> str:
        """Return the help text with all options."""
        formatter = ctx.make_formatter()
        self.format_usage(ctx, formatter)
        self.format_help_text(ctx, formatter)
        self._write_sections(ctx, formatter, self.get_params(ctx))
        return formatter.getvalue().rstrip()

    def group_help(self, ctx: click.Context, name: str) -> str:
        """Return the help text of a group of options, or of the group of an option.

        Raises:
            ParameterError: There is no such group or option.
        """
        options = [item for item in self.params if isinstance(item, SectionedOption)]
        flag = f"--{name.lstrip('-')}"
        groups = {item.group for item in options if name.lower() == item.group}
        groups = groups or {item.group for item in options if flag in item.opts}
        if not groups:
            raise ParameterError("--help", expected=f"one of {', '.join(self.sections())}", got=name)
        formatter = ctx.make_formatter()
        self._write_sections(ctx, formatter, [item for item in options if item.group in groups])
        return formatter.getvalue().rstrip()

    def _show_help(self, ctx: click.Context, param: click.Parameter, value: str | None) -> None:
        if value is not None and not ctx.resilient_parsing:
            _print_help(ctx, self.get_help if not value else lambda ctx: self.group_help(ctx, value))

    def _write_sections(
        self, ctx: click.Context, formatter: click.HelpFormatter, parameters: Iterable[click.Parameter]
    ) -> None:
        rest = "General" if self.sections() else "Options"
        sections: dict[str, list[tuple[str, str]]] = {}
        for parameter in parameters:
            if record := parameter.get_help_record(ctx):  # None if hidden
                title = "Arguments" if isinstance(parameter, click.Argument) else rest
                sections.setdefault(getattr(parameter, "section", title), []).append(record)
        for title, rows in sections.items():
            with formatter.section(title):
                formatter.write_dl(rows)

    def _write_common(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        parameters = self.get_params(ctx)
        records = [item.get_help_record(ctx) for item in parameters if isinstance(item, click.Argument)]
        by_name = {name.lstrip("-"): item for item in parameters for name in item.opts}
        rows = [record for record in records if record is not None]
        for name, text in self.common.items():
            record = by_name[name].get_help_record(ctx) if name in by_name else None
            if record is not None:
                rows.append((record[0], text))
        with formatter.section("Common options"):
            formatter.write_dl(rows, col_max=_COLUMN)
        with formatter.section("All options: --help-all, or --help GROUP with one of"):
            formatter.write_text(", ".join(self.sections()))
        if self.examples:
            with formatter.section("Examples"):
                for line in self.examples.strip().splitlines():
                    formatter.write(f"{'':{formatter.current_indent}}{line.strip()}\n")


def completion(words: Callable[[], Iterable[str]], *, files: bool = False) -> Any:
    """Return a completion function of an option.

    Args:
        words: Function that returns all words that complete the option.
        files: True to complete names of files as well.
    """

    def complete(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        items = [CompletionItem(word) for word in words() if word.startswith(incomplete)]
        return [*items, CompletionItem(incomplete, type="file")] if files else items

    return complete


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _print_help(ctx: click.Context, text: Callable[[click.Context], str]) -> None:
    click.echo(text(ctx), color=ctx.color)
    ctx.exit()
