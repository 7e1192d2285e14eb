"""Presets: partial settings for a look in TOML files, shipped with the package or written by users."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bokehnet.errors import ConfigError
from bokehnet.settings.settings import RenderSettings
from bokehnet.settings.settings_file import read_toml, settings_from_table

__all__ = ["Preset", "load_preset", "preset_file", "presets"]

_FOLDER = Path(__file__).parent / "presets"


@dataclass(frozen=True, kw_only=True, slots=True)
class Preset:
    """Look: a subset of the settings, none of which describes the scene.

    Attributes:
        name: Name of the preset, or path of its file.
        description: Appearance, one line.
        values: Group name to field name to value.

    Examples:
        >>> glow = Preset(name="glow", description="Bright rims", values={"lens": {"spherical": 0.5}})
        >>> glow.over().lens.spherical  # percent
        0.5
    """

    name: str
    description: str
    values: dict[str, dict[str, Any]]

    def over(self, settings: RenderSettings | None = None) -> RenderSettings:
        """Return settings with the fields of this look replaced.

        Args:
            settings: Settings to change. Default: default settings.

        Raises:
            ParameterError: A value is out of range or contradicts the settings.

        Examples:
            >>> from bokehnet.settings.preset import load_preset
            >>> load_preset("petzval-swirl").over().aperture.cats_eye
            1.1
        """
        return (settings or RenderSettings()).updated(self.values)


def presets() -> list[str]:
    """Return the names of the shipped presets in alphabetical order.

    Examples:
        >>> from bokehnet.settings.preset import presets
        >>> presets()[:2]
        ['anamorphic', 'double-gauss']
    """
    return sorted(path.stem for path in _FOLDER.glob("*.toml"))


def preset_file(name: str | Path) -> Path:
    """Return the file of a preset, given its name or the path of a TOML file.

    Raises:
        ConfigError: The name is neither a preset nor a TOML file.

    Examples:
        >>> preset_file("portrait-85").name, preset_file("mine.toml").name
        ('portrait-85.toml', 'mine.toml')
    """
    if str(name) in presets():
        return _FOLDER / f"{name}.toml"
    if Path(name).suffix != ".toml":
        raise ConfigError(
            f"unknown preset {str(name)!r}: expected a .toml file or one of {', '.join(presets())}"
        )
    return Path(name)


def load_preset(name: str | Path) -> Preset:
    """Read a preset by its name, or from a TOML file.

    The file has a ``description`` and settings: in tables by group, such as ``[aperture]``, or by the names
    of command-line options, such as ``cats-eye = 0.5``. Relative file names are searched in the preset's
    folder first.

    Raises:
        ConfigError: The file is missing or not TOML, a setting is unknown or not allowed in a preset, or a
            value is not a number, a text, a boolean or a list.

    Examples:
        >>> load_preset("portrait-85").values["effects"]  # stops
        {'vignette': 0.7}
    """
    path = preset_file(name)
    table = read_toml(path, "preset")
    description = table.pop("description", "")
    if not isinstance(description, str):
        raise ConfigError(f"{path}: description: expected a text, got {description!r}")
    values = settings_from_table(table, str(path), allowed_in_preset=True)
    for group, field in (("lens", "table"), ("aperture", "image")):
        file = values.get(group, {}).get(field)
        if isinstance(file, str) and (path.parent / file).exists():
            values[group][field] = str(path.parent / file)
    return Preset(name=str(name), description=description, values=values)
