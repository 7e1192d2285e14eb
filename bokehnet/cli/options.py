"""Options of a command, generated from groups of settings.

The command-line parser passes texts through; the fields parse and check them. Presets, settings files and
the command line thus follow the same rules and raise the same errors.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from functools import wraps
from typing import Any

import click

from bokehnet.cli.parser import SectionedOption, completion
from bokehnet.errors import BokehnetError, ConfigError, ParameterError
from bokehnet.sequence.sequence import SequenceSettings
from bokehnet.settings.fields import Group, Setting, field_settings
from bokehnet.settings.preset import load_preset
from bokehnet.settings.settings import RenderSettings, all_settings, merged
from bokehnet.settings.settings_file import read_toml, settings_from_table

__all__ = [
    "COMMON_OPTIONS",
    "OptionValues",
    "message_of",
    "resolved_settings",
    "with_option_names",
    "with_options",
]

# Values of the options on the command line, by group and field.
OptionValues = dict[str, dict[str, Any]]

# Options of the short help texts, with shorter texts than those of the fields.
COMMON_OPTIONS = {
    "output": "Output file. Default: photo_bokeh.jpg for photo.jpg.",
    "disparity": "Disparity map: bright is near.",
    "depth": "Depth map: EXR in metres, or --depth-unit.",
    "depth-model": "Network that estimates the depth.",
    "focus-at": "Pixel in focus. Default: the subject.",
    "focus": "Disparity in focus, 0 (far) to 1 (near).",
    "focus-distance": "With --depth: distance in focus, metres.",
    "strength": "Blur strength, 0 to 100. Default: 50.",
    "f-number": "Aperture on full frame, such as 1.8.",
    "blur": "Blur radius, pixels per unit of disparity.",
    "blades": "Aperture blades. Default: a round aperture.",
    "preset": "Look: a name of `bokehnet presets`, or a file.",
    "lens": "Lens with its aberrations: a name, or a file.",
    "engine": "rays (default), scatter (fastest) or hybrid.",
    "repair-disparity": "Align edges of the map with the picture.",
    "quiet": "Print only errors.",
}

# Field name in back quotes in a message, such as `aperture.blades`.
_QUOTED = re.compile(r"`([^`]+)`")


def with_options(
    groups: Sequence[type[Group]], *, conflicts: Callable[..., Iterable[ParameterError]] | None = None
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator that adds all options of some groups of settings to a command.

    The command's parameter ``option_values`` receives the values that the user set.

    Args:
        groups: Groups of settings.
        conflicts: Function that returns the contradictions between the command's own options, to report them
            beside invalid options. Its parameters are the command's, with the valid ``option_values``, and
            ``invalid``, the names of the groups with invalid options.
    """
    known = [item for group in groups for item in field_settings(group).values() if item.flag]
    titles = {group.TITLE: group.GROUP for group in reversed(groups)}  # groups of one title share its name
    by_group = {group.GROUP: group.TITLE for group in groups}

    def decorate(function: Callable[..., None]) -> Callable[..., None]:
        @wraps(function)
        def run(**words: Any) -> None:
            own = {name: word for name, word in words.items() if _SEPARATOR not in name}
            values, errors = _read(known, words)
            if errors:
                by_flag = {f"--{item.flag}": item.group for item in known}
                invalid = {by_flag[error.parameter] for error in errors}
                if conflicts is not None:
                    errors += conflicts(**own, option_values=values, invalid=invalid)
                raise _with_consequences(errors, values, invalid, own.get("settings"), own.get("preset"))
            function(**own, option_values=values)

        result: Callable[..., None] = run
        for item in reversed(known):
            title = by_group[item.group]
            for names, hidden in reversed(list(_names(item))):
                result = click.option(
                    *names,
                    cls=SectionedOption,
                    group=titles[title],
                    section=title,
                    hidden=hidden,
                    help=item.help,
                    **_value_attributes(item),
                )(result)
        return result

    return decorate


def resolved_settings(file: str | None, preset: str | None, option_values: OptionValues) -> RenderSettings:
    """Return the settings of a file, overridden by a preset, overridden by options."""
    changes = _layered(file, preset, option_values)
    try:
        return RenderSettings().updated(changes)
    except ParameterError as error:
        others = _focus_errors(changes)
        joined = error.with_others(others) if others else error
        is_from_file = file is not None and _is_set(error.parameter, _values_of(file))
        if is_from_file and not _is_set(error.parameter, option_values):
            reason = str(joined).removeprefix(joined.parameter)
            raise ConfigError(f"{file}: `{joined.parameter}`{reason}") from error
        raise joined from error.__cause__


def _is_set(parameter: str, values: OptionValues) -> bool:
    """Return whether values contain a parameter, named with its group or without."""
    group, _, name = parameter.rpartition(".")
    return any(name in fields for key, fields in values.items() if group in ("", key))


def _values_of(file: str) -> OptionValues:
    return settings_from_table(read_toml(file, "settings"), file)


def _layered(file: str | None, preset: str | None, option_values: OptionValues) -> OptionValues:
    base = {} if file is None else _values_of(file)
    look = {} if preset is None else load_preset(preset).values
    return merged(base, look, option_values)


def _with_consequences(
    errors: list[ParameterError],
    values: OptionValues,
    invalid: set[str],
    file: str | None,
    preset: str | None,
) -> ParameterError:
    """Return one error for invalid options and for the contradictions between the valid ones.

    Args:
        errors: Errors of the invalid options and of the command's own options.
        values: Values of the valid options.
        invalid: Groups with invalid options.
        file: Settings file.
        preset: Preset.
    """
    first, *others = errors
    own = {item.group for item in all_settings().values()}
    with suppress(BokehnetError):  # a file or preset that cannot be read: its own error comes next
        changes = {group: fields for group, fields in _layered(file, preset, values).items() if group in own}
        others += _contradictions(changes, invalid)
    return first.with_others(others) if others else first


def _contradictions(changes: OptionValues, invalid: set[str]) -> list[ParameterError]:
    """Return errors of the groups without invalid options that mention no group with one.

    The depth source decides about focus and camera: with an invalid ``input`` there are none.
    """
    from bokehnet.scene.focus_checks import check_focus  # only for errors

    if "input" in invalid:
        return []
    valid = {group: fields for group, fields in changes.items() if group not in invalid}
    errors: list[ParameterError] = []
    try:
        settings = RenderSettings().updated(valid)
    except ParameterError as error:
        errors = [error, *_focus_errors(valid)]
    else:
        try:
            check_focus(settings)
        except ParameterError as error:
            errors = [error]
    paths = [(error.parameter, *_QUOTED.findall(str(error))) for error in errors]
    mentioned = [{path.partition(".")[0] for path in each} for each in paths]
    return [error for error, groups in zip(errors, mentioned, strict=True) if not groups & invalid]


def _focus_errors(changes: OptionValues) -> list[ParameterError]:
    """Return errors of focus and camera beside those of an invalid group; none if the input is invalid."""
    from bokehnet.scene.focus_checks import check_focus  # only for errors

    valid: OptionValues = {}
    for group, fields in changes.items():
        try:
            RenderSettings().updated({group: fields})
            valid[group] = fields
        except ParameterError:
            if group == "input":
                return []
    try:
        settings = RenderSettings().updated(valid)
    except ParameterError:  # the error of several groups, reported already
        return []
    try:
        check_focus(settings)
    except ParameterError as error:
        return [error]
    return []


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


# Between group, field and variant in the name of a parameter: `aperture__blades`.
_SEPARATOR = "__"


def _names(known: Setting) -> Iterator[tuple[list[str], bool]]:
    """Yield the parameter name and flags of a field's option, and whether it is hidden.

    Hidden are earlier names and ``--no-...`` of a boolean.
    """
    yield [_key(known), f"--{known.flag}"], False
    if known.aliases:
        yield [f"{_key(known)}__earlier", *(f"--{flag}" for flag in known.aliases)], True
    if known.type is bool:
        yield [f"{_key(known)}__not", f"--no-{known.flag}"], True


def _value_attributes(known: Setting) -> dict[str, Any]:
    """Return the parser attributes of a field's value: texts, as the field parses and checks them.

    The default None marks options that the user did not set.
    """
    if known.type is bool:
        return {"is_flag": True, "default": None}
    metavar = _metavar(known)
    files = "PATH" in metavar or "FILE" in metavar
    return {
        "type": click.STRING if known.parts == 1 else (click.STRING,) * known.parts,
        "metavar": metavar,
        "shell_complete": completion(lambda: known.choices, files=files),
    }


def _read(known: Sequence[Setting], words: dict[str, Any]) -> tuple[OptionValues, list[ParameterError]]:
    """Return the valid values of the options that the user set, and the errors of the others."""
    values: OptionValues = {}
    errors: list[ParameterError] = []
    for item in known:
        name = _key(item)
        variants = {key: words.get(key) for key in (name, f"{name}__earlier", f"{name}__not")}
        present = {key: word for key, word in variants.items() if word is not None}
        try:
            if len(present) > 1:
                raise ParameterError(f"--{item.flag}", expected="one of its two names", shown="both")
            for key, word in present.items():
                value = not key.endswith("__not") if isinstance(word, bool) else item.parsed(word)
                values.setdefault(item.group, {})[item.name] = value
        except ParameterError as error:
            errors.append(error.renamed(f"--{item.flag}"))
    return values, errors


def _key(known: Setting) -> str:
    return f"{known.group}{_SEPARATOR}{known.name}"


def _metavar(known: Setting) -> str:
    words = {int: "N", float: "X", str: "TEXT"}
    return known.metavar or "|".join(known.choices) or words.get(known.type, "PATH")
