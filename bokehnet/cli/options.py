"""Options of a command, generated from groups of settings.

The command-line parser passes texts through; the fields parse and check them. Presets, settings files and
the command line thus follow the same rules and raise the same errors.
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
    "OptionValues",
    "QuickGroup",
    "SectionedCommand",
    "message_of",
    "resolved_settings",
    "with_option_names",
    "with_options",
]

# Values of the options on the command line, by group and field.
OptionValues = dict[str, dict[str, Any]]

# Field name in back quotes in a message, such as `aperture.blades`.
_QUOTED = re.compile(r"`([^`]+)`")


class _NoConversion:
    """Replacement for typer's converters, which need pydantic: its import alone takes 0.1 s."""

    def coerce(self, value: Any, param: Any, ctx: Any) -> Any:
        return value


class _RawWords:
    """Mixin that passes command-line words through as text.

    The attribute is private to typer; without it everything works, but more slowly.
    """

    def get_params(self, ctx: Any) -> Any:
        parameters = super().get_params(ctx)  # type: ignore[misc]
        for parameter in parameters:
            parameter._runtime_param = _NoConversion()
        return parameters


class QuickGroup(_RawWords, TyperGroup):
    """Group of all commands, without argument conversion."""


class SectionedCommand(_RawWords, TyperCommand):
    """Command whose help has one section per group of options."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write the sections in the order of definition."""
        sections: dict[str, list[tuple[str, str]]] = {}
        for parameter in self.get_params(ctx):
            if record := parameter.get_help_record(ctx):  # None if hidden
                title = "Arguments" if parameter.param_type_name == "argument" else "General"
                title = getattr(parameter, "rich_help_panel", None) or title
                sections.setdefault(title, []).append(record)
        for title, rows in sections.items():
            with formatter.section(title):
                formatter.write_dl(rows)


def with_options(groups: Sequence[type[Group]]) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator that adds all options of some groups of settings to a command.

    The command's last parameter, ``option_values``, receives the values that the user set; its other
    parameters stay arguments of their own.
    """
    known = [item for group in groups for item in field_settings(group).values() if item.flag]
    titles = {group.GROUP: group.TITLE for group in groups}

    def decorate(function: Callable[..., None]) -> Callable[..., None]:
        *own, _ = signature(function).parameters.values()

        def run(**words: Any) -> None:
            function(**{item.name: words[item.name] for item in own}, option_values=_read(known, words))

        parameters = [
            *(item.replace(kind=Parameter.KEYWORD_ONLY) for item in own),
            *(option for item in known for option in _parameters(item, titles[item.group])),
        ]
        run.__name__, run.__doc__ = function.__name__, function.__doc__
        run.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
        run.__annotations__ = {item.name: item.annotation for item in parameters}
        return run

    return decorate


def resolved_settings(file: str | None, preset: str | None, option_values: OptionValues) -> RenderSettings:
    """Return the settings of a file, overridden by a preset, overridden by options."""
    base = {} if file is None else settings_from_table(read_toml(file, "settings"), file)
    look = {} if preset is None else load_preset(preset).values
    return RenderSettings().updated(merged(base, look, option_values))


def message_of(error: BokehnetError) -> str:
    """Return the message of an error with option names in place of field names."""
    # Only for full paths: a bare "image" or "defocus" is an array of a lower layer.
    if isinstance(error, ParameterError) and "." in error.parameter and error.parameter in _flags():
        error = error.renamed(_flags()[error.parameter])
    return with_option_names(str(error))


def with_option_names(text: str) -> str:
    """Return a text with option names in place of field names in back quotes."""
    return _QUOTED.sub(lambda match: _flags().get(match[1], match[1]), text)


def _flags() -> dict[str, str]:
    """Return the option of each field by path, and by bare name where that is unique."""
    known = [*all_settings().values(), *field_settings(SequenceSettings).values()]
    names = [item.name for item in known]
    by_name = {item.name: f"--{item.flag}" for item in known if item.flag and names.count(item.name) == 1}
    return by_name | {item.path: f"--{item.flag}" for item in known if item.flag}


def _parameters(known: Setting, title: str) -> Iterator[Parameter]:
    """Yield the option of a field, and hidden ones for earlier names and for ``--no-...`` of a boolean.

    All have the default None, which marks options that the user did not set.
    """
    is_boolean = known.type is bool
    kind: Any = (
        bool if is_boolean else str if known.parts == 1 else tuple.__class_getitem__((str,) * known.parts)
    )
    names = {
        _key(known): [f"--{known.flag}"],
        f"{_key(known)}__earlier": [f"--{flag}" for flag in known.aliases],
        f"{_key(known)}__not": [f"--no-{known.flag}"] if is_boolean else [],
    }
    for name, flags in names.items():
        if flags:
            option = typer.Option(
                *flags,
                help=known.help,
                metavar=None if is_boolean else _metavar(known),
                rich_help_panel=title,
                hidden=name != _key(known),
                show_default=False,
                autocompletion=_completion(known.choices),
            )
            yield Parameter(
                name, Parameter.KEYWORD_ONLY, default=None, annotation=Annotated[kind | None, option]
            )


def _read(known: Sequence[Setting], words: dict[str, Any]) -> OptionValues:
    """Return the values of the options that the user set."""
    values: OptionValues = {}
    for item in known:
        name = _key(item)
        variants = {key: words.get(key) for key in (name, f"{name}__earlier", f"{name}__not")}
        present = {key: word for key, word in variants.items() if word is not None}
        if len(present) > 1:
            raise ParameterError(f"--{item.flag}", expected="one of its two names", shown="both")
        for key, word in present.items():
            try:
                value = not key.endswith("__not") if isinstance(word, bool) else item.parsed(word)
            except ParameterError as error:
                raise error.renamed(f"--{item.flag}") from error
            values.setdefault(item.group, {})[item.name] = value
    return values


def _key(known: Setting) -> str:
    return f"{known.group}__{known.name}"


def _metavar(known: Setting) -> str:
    words = {int: "N", float: "X", str: "TEXT"}
    return known.metavar or "|".join(known.choices) or words.get(known.type, "PATH")


def _completion(choices: Sequence[str]) -> Callable[[str], list[str]] | None:
    if not choices:
        return None
    return lambda incomplete: [word for word in choices if word.startswith(incomplete)]
