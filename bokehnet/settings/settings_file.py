"""Settings in TOML files: a table per group, or keys named like command-line options."""

import difflib
import math
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from bokehnet.errors import ConfigError
from bokehnet.io.files.text import read_text
from bokehnet.settings.fields import field_settings
from bokehnet.settings.settings import RenderSettings, all_settings, group_types, settings_by_flag

__all__ = ["load_settings", "read_toml", "save_settings", "settings_from_table", "similar_name"]


def settings_from_table(
    table: Mapping[str, Any], source: str = "settings", *, allowed_in_preset: bool = False
) -> dict[str, dict[str, Any]]:
    """Sort the table of a TOML file into groups of settings.

    Args:
        table: Tables by group with their fields, and option names outside of tables, such as ``cats-eye``.
        source: Name of the file in messages.
        allowed_in_preset: True to reject settings that a preset may not set.

    Returns:
        Group to field to value, for :meth:`RenderSettings.updated`.

    Raises:
        ConfigError: A name is unknown, or a value has a type that no field has.

    Examples:
        >>> settings_from_table({"cats-eye": 0.5, "camera": {"blur": 40}})
        {'aperture': {'cats_eye': 0.5}, 'camera': {'blur': 40}}
    """
    groups = {group.GROUP: group for group in group_types()}
    changes: dict[str, dict[str, Any]] = {}
    for key, value in table.items():
        if key in groups and isinstance(value, Mapping):
            known = field_settings(groups[key])
            pairs = [(f"{key}.{name}", known.get(name), item) for name, item in value.items()]
        else:
            pairs = [(key, settings_by_flag().get(key), value)]
        for name, setting, item in pairs:
            if setting is None or (allowed_in_preset and not setting.allowed_in_preset):
                what = "a preset can set" if allowed_in_preset else "expected one of"
                allowed = {
                    path: each.flag or path
                    for path, each in all_settings().items()
                    if each.allowed_in_preset or not allowed_in_preset
                }
                names = set(allowed if "." in name else allowed.values())
                if isinstance(item, Mapping):
                    names = {path.split(".")[0] for path in allowed}
                near = similar_name(name, names)
                advice = f"did you mean {near}?" if near else f"{what} {', '.join(sorted(names))}"
                raise ConfigError(f"{source}: unknown option {name!r}; {advice}")
            if not isinstance(item, bool | int | float | str | list):
                raise ConfigError(
                    f"{source}: {name}: expected a number, a text, true or a list, got {item!r}"
                )
            changes.setdefault(setting.group, {})[setting.name] = item
    return changes


def similar_name(name: str, names: Iterable[str]) -> str:
    """Return the most similar other name; empty if none is similar.

    Examples:
        >>> similar_name("camra", ["aperture", "camera"])
        'camera'
    """
    matches = difflib.get_close_matches(name, names, n=1, cutoff=0.75)
    return matches[0] if matches and matches[0] != name else ""


def load_settings(path: str | Path) -> RenderSettings:
    """Read settings from a TOML file with a table per group.

    Raises:
        ConfigError: The file is missing or not TOML, or a name is unknown.
        ParameterError: A value is out of range, or values contradict each other.

    Examples:
        >>> save_settings("shot.toml", RenderSettings().updated({"camera": {"blur": 40}}))
        >>> load_settings("shot.toml").camera.blur  # pixels per unit of disparity
        40.0
    """
    return RenderSettings().updated(settings_from_table(read_toml(path, "settings"), str(path)))


def save_settings(path: str | Path, settings: RenderSettings) -> None:
    """Write the settings that differ from the defaults to a TOML file, atomically.

    Raises:
        ConfigError: The file cannot be written.

    Examples:
        >>> save_settings("look.toml", RenderSettings().updated({"aperture": {"blades": 6, "cats_eye": 0.5}}))
        >>> print(Path("look.toml").read_text())
        [aperture]
        blades = 6
        cats_eye = 0.5
    """
    from bokehnet.io.files.atomic import write_text  # imported late: keeps help texts fast

    lines = []
    for group, values in settings.to_table().items():
        lines += [f"[{group}]", *(f"{name} = {_toml(value)}" for name, value in values.items()), ""]
    write_text(Path(path), "\n".join(lines), error=ConfigError)


def read_toml(path: str | Path, what: str) -> dict[str, Any]:
    """Return the table of a TOML file; raise ``ConfigError`` naming ``what`` if it cannot be read.

    Examples:
        >>> _ = Path("look.toml").write_text("cats-eye = 0.5")
        >>> read_toml("look.toml", "preset")
        {'cats-eye': 0.5}
    """
    text = read_text(path, what, "TOML")
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # also for numbers with too many digits
        raise ConfigError(f"{path}: expected TOML, found an error: {error}") from error


def _toml(value: Any) -> str:
    """Return the TOML text of a plain value."""
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"')
        return '"' + "".join(c if c.isprintable() else f"\\U{ord(c):08x}" for c in escaped) + '"'
    return ("inf" if value > 0 else "-inf") if isinstance(value, float) and math.isinf(value) else repr(value)
