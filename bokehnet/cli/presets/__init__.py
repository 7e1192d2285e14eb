"""Looks that come with the package: one TOML file each, whose keys are options of ``bokehnet render``."""

import tomllib
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bokehnet.errors import ConfigError

__all__ = ["Preset", "preset_names", "preset_path", "read_preset"]

_FOLDER = Path(__file__).parent


@dataclass(frozen=True, kw_only=True, slots=True)
class Preset:
    """A look.

    Attributes:
        description: What it looks like, one line.
        options: Options of the command line without their dashes, and their values.
    """

    description: str
    options: dict[str, Any]


def preset_names() -> list[str]:
    """Names of the presets that come with the package, in alphabetical order."""
    return sorted(path.stem for path in _FOLDER.glob("*.toml"))


def preset_path(name: str) -> Path:
    """File of a preset, by its name or as the path of a TOML file.

    Raises:
        ConfigError: It is neither.
    """
    if name in preset_names():
        return _FOLDER / f"{name}.toml"
    if Path(name).suffix != ".toml":
        raise ConfigError(
            f"unknown preset {name!r}: expected a .toml file or one of {', '.join(preset_names())}"
        )
    return Path(name)


def read_preset(name: str, valid: Collection[str]) -> Preset:
    """Read a preset.

    Args:
        name: As for :func:`preset_path`.
        valid: Options that a preset may set.

    Raises:
        ConfigError: The file is missing or not TOML, an option is unknown, or a value is not a number, a
            text or a truth value.
    """
    path = preset_path(name)
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"cannot read preset {path}: {error.strerror or error}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: expected TOML, found an error: {error}") from error
    description = table.pop("description", "")
    if not isinstance(description, str):
        raise ConfigError(f"{path}: description: expected a text, got {description!r}")
    for key, value in table.items():
        if key not in valid:
            raise ConfigError(f"{path}: unknown option {key!r}; a preset can set {', '.join(sorted(valid))}")
        if not isinstance(value, bool | int | float | str):
            raise ConfigError(f"{path}: {key}: expected a number, a text or true, got {value!r}")
    return Preset(description=description, options=table)
