"""Conversion of TOML files to frozen dataclasses and back.

A configuration is a frozen keyword-only dataclass, defined next to the class that it configures. Fields may
be ``bool``, ``int``, ``float``, ``str``, ``Literal[...]``, ``X | None``, ``tuple[X, ...]``, ``tuple[X, Y]``
or another such dataclass, which is a table in the file. A missing key takes the default of its field. Keys of
earlier versions are translated (``OLD_KEYS``).
"""

import dataclasses
import json
import tomllib
import types
import typing
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from bokehnet.errors import ConfigError, ParameterError, errors_of_file

__all__ = [
    "OLD_KEYS",
    "build_config",
    "check_same",
    "dump_json",
    "first_difference",
    "load_config",
    "parse_settings",
    "renamed",
    "to_dict",
]

Config = TypeVar("Config")

_MAX_FILE_BYTES = 16 * 2**20

# Keys of earlier versions in TOML files, checkpoints and prepared sets, and their current names.
OLD_KEYS = {
    "see_hints": "see_features",
    "spoilt": "augmented",
    "things": "objects",
    "unit": "network_max_radius",
}


def load_config(path: str | Path, cls: type[Config], overrides: Mapping[str, Any] | None = None) -> Config:
    """Read a TOML file into the frozen dataclass ``cls``.

    Args:
        path: The TOML file.
        cls: A dataclass with keyword-only fields; nested dataclasses are tables.
        overrides: Values that replace those of the file; ``"table.key"`` reaches into a table.

    Raises:
        ConfigError: The file is missing or not TOML, a key is unknown or missing without default, or a
            value has the wrong type.
    """
    path = Path(path)
    try:
        size = path.stat().st_size
        if size > _MAX_FILE_BYTES:
            raise ConfigError(f"{path}: expected at most {_MAX_FILE_BYTES} bytes, found {size}")
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"cannot read config {path}: {error.strerror or error}") from error
    except ConfigError:
        raise
    except (ValueError, RecursionError) as error:  # also numbers with too many digits
        raise ConfigError(f"{path}: expected TOML, found an error: {error}") from error
    for dotted, value in (overrides or {}).items():
        _set(table, dotted.split("."), value, str(path))
    with errors_of_file(path, "a configuration", ConfigError):
        return build_config(table, cls, str(path))


def parse_settings(settings: Iterable[str]) -> dict[str, Any]:
    """Return ``overrides`` for ``load_config`` from words ``key=value``; non-TOML values become texts.

    Raises:
        ParameterError: A word has no equals sign.

    Example:
        >>> parse_settings(["scenes=12", "clutter.lamps=0.5", "kind=planes"])
        {'scenes': 12, 'clutter.lamps': 0.5, 'kind': 'planes'}
    """
    overrides: dict[str, Any] = {}
    for text in settings:
        key, equals, value = text.partition("=")
        if not equals:
            raise ParameterError("--set", "key=value", text)
        try:
            overrides[key] = tomllib.loads(f"value = {value}")["value"]
        except tomllib.TOMLDecodeError:
            overrides[key] = value
    return overrides


def build_config(table: Mapping[str, Any], cls: type[Config], source: str = "config") -> Config:
    """Return an instance of ``cls`` from a table of plain values; ``source`` names it in messages.

    Raises:
        ConfigError: A key is unknown, missing without default, or has a value of the wrong type.
    """
    return typing.cast(Config, _dataclass_from(table, cls, source, ""))


def renamed(table: Mapping[str, Any], today: Collection[str] = ()) -> dict[str, Any]:
    """Return a table with current keys in place of those of earlier versions (``OLD_KEYS``).

    Args:
        table: Plain values.
        today: Current keys, which are never translated.
    """
    return {
        key if key in today or OLD_KEYS.get(key) in table else OLD_KEYS.get(key, key): value
        for key, value in table.items()
    }


def to_dict(config: Any) -> dict[str, Any]:
    """Return a configuration as plain, JSON-ready values; :func:`build_config` reads it back."""
    plain = json.loads(json.dumps(dataclasses.asdict(config)))
    assert isinstance(plain, dict)
    return plain


def dump_json(config: Any) -> str:
    """Return the resolved configuration as indented JSON text with a final newline."""
    return json.dumps(to_dict(config), indent=2) + "\n"


def first_difference(old: Any, new: Any, key: str = "") -> tuple[str, Any, Any] | None:
    """Return the dotted key and the two values where two plain configurations first differ, or ``None``."""
    if isinstance(old, dict) and isinstance(new, dict):
        for name in sorted(old.keys() | new.keys()):
            difference = first_difference(old.get(name), new.get(name), f"{key}.{name}" if key else name)
            if difference is not None:
                return difference
        return None
    return None if old == new else (key, old, new)


def check_same(holder: str, old: Any, new: Any, way_out: str) -> None:
    """Raise unless the configuration of an existing folder equals the requested one.

    Args:
        holder: Start of the message: the folder and its content.
        old: Plain configuration of the folder.
        new: Requested plain configuration.
        way_out: End of the message: the remedy.

    Raises:
        ConfigError: They differ; names the first key that does.
    """
    if difference := first_difference(old, new):
        key, existing, requested = difference
        raise ConfigError(f"{holder} with {key} = {existing!r}, but {requested!r} was requested; {way_out}")


def _set(table: dict[str, Any], keys: list[str], value: Any, source: str) -> None:
    for key in keys[:-1]:
        table = table.setdefault(key, {})
        if not isinstance(table, dict):
            raise ConfigError(f"{source}: cannot override {'.'.join(keys)}: {key} is not a table")
    table[keys[-1]] = value


def _dataclass_from(table: Any, cls: Any, source: str, prefix: str) -> Any:
    where = prefix.rstrip(".")
    if not isinstance(table, Mapping):
        raise ConfigError(f"{source}: {where}: expected a table, got {table!r}")
    fields = {field.name: field for field in dataclasses.fields(cls) if field.init}
    table = renamed(table, fields)
    for key in table:
        if key not in fields:
            valid = ", ".join(sorted(fields))
            raise ConfigError(f"{source}: unknown key {prefix + str(key)!r}; valid keys: {valid}")
    hints = typing.get_type_hints(cls)
    values = {key: _value_from(value, hints[key], source, prefix + key) for key, value in table.items()}
    for name, field in fields.items():
        required = field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
        if required and name not in values:
            raise ConfigError(f"{source}: missing key {prefix + name!r}")
    return cls(**values)


def _value_from(value: Any, hint: Any, source: str, key: str) -> Any:
    """Return ``value`` as the annotated type ``hint``, or raise ``ConfigError`` naming ``key``."""
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if dataclasses.is_dataclass(hint):
        return _dataclass_from(value, hint, source, key + ".")
    if origin in (typing.Union, types.UnionType) and type(None) in arguments and len(arguments) == 2:
        inner = arguments[0] if arguments[1] is type(None) else arguments[1]
        return None if value is None else _value_from(value, inner, source, key)
    if origin is tuple and isinstance(value, list | tuple):
        repeated = len(arguments) == 2 and arguments[1] is Ellipsis
        kinds = [arguments[0]] * len(value) if repeated else list(arguments)
        if len(kinds) == len(value):
            pairs = enumerate(zip(value, kinds, strict=True))
            return tuple(_value_from(item, kind, source, f"{key}[{i}]") for i, (item, kind) in pairs)
    if origin is typing.Literal and any(
        value == choice and type(value) is type(choice) for choice in arguments
    ):
        return value
    if hint is float and isinstance(value, int | float) and not isinstance(value, bool):
        try:
            return float(value)
        except OverflowError as error:
            raise ConfigError(f"{source}: {key}: expected a number below 1e308, got a larger one") from error
    if hint in (bool, int, str) and type(value) is hint:
        return value
    name = hint.__name__ if isinstance(hint, type) and not arguments else str(hint).replace("typing.", "")
    raise ConfigError(f"{source}: {key}: expected {name}, got {value!r}")
