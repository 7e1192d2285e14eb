"""Content of a session file: picture, settings with their files, strokes and preset."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from bokehnet.errors import ConfigError
from bokehnet.inference.depth_models import find_depth_model
from bokehnet.settings.preset import presets
from bokehnet.settings.settings import InputSettings, RenderSettings, all_settings
from bokehnet.studio.files.uploads import safe_name
from bokehnet.studio.history import State
from bokehnet.studio.panels.panels import check_reachable, is_path
from bokehnet.studio.strokes import Stroke

__all__ = ["session_content", "session_state"]


def session_content(picture: Path, state: State) -> tuple[dict[str, Any], dict[str, Path]]:
    """Return the table of a session file, and the files that it needs by name."""
    table, files = state.settings.to_table(), {picture.name: picture}
    for group, fields in table.items():
        for key in fields:
            value = getattr(getattr(state.settings, group), key)
            if is_path(all_settings()[f"{group}.{key}"]) and isinstance(value, Path) and value.is_file():
                fields[key] = value.name
                files[value.name] = value
    content = {
        "format": 1,
        "picture": picture.name,
        "settings": table,
        "strokes": [stroke.to_table() for stroke in state.strokes],
        "preset": state.preset,
    }
    return content, files


def session_state(table: Mapping[str, Any], folder: Path) -> tuple[Path, State]:
    """Return picture and state of a session whose files lie in a folder; inverse of :func:`session_content`.

    Raises:
        ConfigError: It is no table of a session.
        BokehnetError: Its settings are invalid.
    """
    try:
        settings, strokes = table["settings"], [Stroke.from_table(one) for one in table["strokes"]]
        picture = folder / safe_name(table["picture"])
        for group, fields in settings.items():
            for key, value in fields.items():
                known = all_settings().get(f"{group}.{key}")
                is_file = isinstance(value, str) and find_depth_model(value) is None
                if known is not None and is_path(known) and is_file:
                    fields[key] = str(folder / safe_name(value))
        check_reachable({g: f for g, f in settings.items() if g != InputSettings.GROUP}, RenderSettings())
        complete = RenderSettings().updated(settings)
    except (KeyError, TypeError, AttributeError) as error:
        raise ConfigError("expected a session file saved by the studio, found something else") from error
    preset = table["preset"] if table.get("preset") in presets() else ""
    return picture, State(settings=complete, strokes=tuple(strokes), preset=preset)
