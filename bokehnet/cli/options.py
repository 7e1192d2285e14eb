"""Options of a command, made from groups of settings: name, type, unit, range and help stand at the field.

The parser hands over words; what they mean is said by the fields alone, so that a preset, a settings file and
the command line are read by the same rules, and told wrong in the same words.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from inspect import Parameter, Signature, signature
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from bokehnet.errors import BokehnetError, ParameterError
from bokehnet.sequence.sequence import SequenceSettings
from bokehnet.settings.fields import Group, Setting, field_settings
from bokehnet.settings.preset import load_preset
from bokehnet.settings.settings import RenderSettings, all_settings, merged
from bokehnet.settings.settings_file import read_toml, settings_from_table

__all__ = [
    "Given",
    "QuickGroup",
    "SectionedCommand",
    "in_options",
    "resolved_settings",
    "told",
    "with_options",
]

# What was given: by group and field.
Given = dict[str, dict[str, Any]]

# A name in back quotes in a message, such as `aperture.blades`.
_QUOTED = re.compile(r"`([^`]+)`")


class _AsItIs:
    """Stands in for typer's converters, each of which needs pydantic: its import alone takes 0.1 s."""

    def coerce(self, value: Any, param: Any, ctx: Any) -> Any:
        return value


class _Words:
    """Hands words over as they are. The attribute is typer's own; without it all works, but slower."""

    def get_params(self, ctx: Any) -> Any:
        parameters = super().get_params(ctx)  # type: ignore[misc]
        for parameter in parameters:
            parameter._runtime_param = _AsItIs()
        return parameters


class QuickGroup(_Words, TyperGroup):
    """The group of all commands."""


class SectionedCommand(_Words, TyperCommand):
    """A command whose help has a section for every group of options."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write the sections in the order in which their options were made."""
        sections: dict[str, list[tuple[str, str]]] = {}
        for parameter in self.get_params(ctx):
            if record := parameter.get_help_record(ctx):  # None where it is hidden
                title = "Arguments" if parameter.param_type_name == "argument" else "General"
                title = getattr(parameter, "rich_help_panel", None) or title
                sections.setdefault(title, []).append(record)
        for title, rows in sections.items():
            with formatter.section(title):
                formatter.write_dl(rows)


def with_options(groups: Sequence[type[Group]]) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a function all options of some groups of settings.

    Its last parameter, ``given``, gets the values of those that were given; the others are its own arguments.
    """
    known = [item for group in groups for item in field_settings(group).values() if item.flag]
    titles = {group.GROUP: group.TITLE for group in groups}

    def decorate(function: Callable[..., None]) -> Callable[..., None]:
        *own, _ = signature(function).parameters.values()

        def run(**words: Any) -> None:
            function(**{item.name: words[item.name] for item in own}, given=_read(known, words))

        parameters = [
            *(item.replace(kind=Parameter.KEYWORD_ONLY) for item in own),
            *(made for item in known for made in _parameters(item, titles[item.group])),
        ]
        run.__name__, run.__doc__ = function.__name__, function.__doc__
        run.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
        run.__annotations__ = {item.name: item.annotation for item in parameters}
        return run

    return decorate


def resolved_settings(file: str | None, preset: str | None, given: Given) -> RenderSettings:
    """Return what a settings file says, over it the preset, over that the options."""
    base = {} if file is None else settings_from_table(read_toml(file, "settings"), file)
    look = {} if preset is None else load_preset(preset).values
    return RenderSettings().updated(merged(base, look, given))


def told(error: BokehnetError) -> str:
    """Return the message of an error in the words of the command line: fields by their options."""
    # Only by its path: a bare "image" or "defocus" is an array of a room below.
    if isinstance(error, ParameterError) and "." in error.parameter and error.parameter in _flags():
        error = error.renamed(_flags()[error.parameter])
    return in_options(str(error))


def in_options(text: str) -> str:
    """Return a text with the options in place of the fields that stand in back quotes."""
    return _QUOTED.sub(lambda match: _flags().get(match[1], match[1]), text)


def _flags() -> dict[str, str]:
    """Option of each field, by its path, and by its name alone where no other has it."""
    known = [*all_settings().values(), *field_settings(SequenceSettings).values()]
    names = [item.name for item in known]
    by_name = {item.name: f"--{item.flag}" for item in known if item.flag and names.count(item.name) == 1}
    return by_name | {item.path: f"--{item.flag}" for item in known if item.flag}


def _parameters(known: Setting, title: str) -> Iterator[Parameter]:
    """The option of a field, and hidden ones for its earlier names and for the contrary of a truth value.

    None is the default of all, which tells what was not given.
    """
    truth = known.type is bool
    kind: Any = bool if truth else str if known.parts == 1 else tuple.__class_getitem__((str,) * known.parts)
    names = {
        _word(known): [f"--{known.flag}"],
        f"{_word(known)}__earlier": [f"--{flag}" for flag in known.aliases],
        f"{_word(known)}__not": [f"--no-{known.flag}"] if truth else [],
    }
    for name, flags in names.items():
        if flags:
            option = typer.Option(
                *flags,
                help=known.help,
                metavar=None if truth else _metavar(known),
                rich_help_panel=title,
                hidden=name != _word(known),
                show_default=False,
                autocompletion=_completion(known.choices),
            )
            yield Parameter(
                name, Parameter.KEYWORD_ONLY, default=None, annotation=Annotated[kind | None, option]
            )


def _read(known: Sequence[Setting], words: dict[str, Any]) -> Given:
    """Return the values of the fields that were given."""
    found: Given = {}
    for item in known:
        name = _word(item)
        ways = {key: words.get(key) for key in (name, f"{name}__earlier", f"{name}__not")}
        said = {key: word for key, word in ways.items() if word is not None}
        if len(said) > 1:
            raise ParameterError(f"--{item.flag}", expected="one of its two names", shown="both")
        for key, word in said.items():
            try:
                value = not key.endswith("__not") if isinstance(word, bool) else item.parsed(word)
            except ParameterError as error:
                raise error.renamed(f"--{item.flag}") from error
            found.setdefault(item.group, {})[item.name] = value
    return found


def _word(known: Setting) -> str:
    return f"{known.group}__{known.name}"


def _metavar(known: Setting) -> str:
    words = {int: "N", float: "X", str: "TEXT"}
    return known.metavar or "|".join(known.choices) or words.get(known.type, "PATH")


def _completion(choices: Sequence[str]) -> Callable[[str], list[str]] | None:
    if not choices:
        return None
    return lambda incomplete: [word for word in choices if word.startswith(incomplete)]
