"""Conversion of settings to an equivalent command line, Python script or preset."""

import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

from bokehnet.settings.fields import to_plain
from bokehnet.settings.settings import RenderSettings, all_settings

__all__ = ["command_line", "look_of", "python_lines"]

Name = Callable[[Path], str]


def command_line(image: Path, output: str, settings: RenderSettings, name: Name = str) -> str:
    """Return the command line that renders a picture with these settings.

    Args:
        image: File of the picture.
        output: Output file.
        settings: Settings of the render.
        name: Function from a path to its shown name.

    Examples:
        >>> settings = RenderSettings().updated({"camera": {"blur": 40}, "focus": {"at": [6, 4]}})
        >>> settings = settings.updated({"lens": {"coma": -2, "vignetting": False}})
        >>> command_line(Path("photo.jpg"), "out.png", settings)
        'bokehnet render photo.jpg --focus-at 6,4 --blur 40.0 --no-lens-vignetting --coma=-2.0 -o out.png'
    """
    words = ["bokehnet", "render", name(image)]
    for path, known in all_settings().items():
        group, _, field = path.partition(".")
        value = getattr(getattr(settings, group), field)
        if known.flag is None or value == known.default:
            continue
        if isinstance(value, bool):
            words.append(f"--{known.flag}" if value else f"--no-{known.flag}")
            continue
        parts = value if known.parts > 1 else (value,)
        texts = [_text(part, name) for part in parts]
        words += [f"--{known.flag}={texts[0]}"] if texts[0].startswith("-") else [f"--{known.flag}", *texts]
    return shlex.join([*words, "-o", output])


def python_lines(image: Path, output: str, settings: RenderSettings, name: Name = str) -> str:
    """Return the equivalent Python script.

    Examples:
        >>> print(python_lines(Path("a.jpg"), "b.png", RenderSettings().updated({"camera": {"blur": 40}})))
        from bokehnet import BokehRenderer, RenderSettings, read_scene
        <BLANKLINE>
        settings = RenderSettings().updated({"camera": {"blur": 40.0}})
        scene = read_scene("a.jpg", settings)
        BokehRenderer().render(scene, settings).save("b.png")
    """
    paths = {str(value): name(value) for value in _paths(settings)}
    table = {
        group: {
            key: paths.get(value, value) if isinstance(value, str) else value for key, value in fields.items()
        }
        for group, fields in settings.to_table().items()
    }
    return (
        "from bokehnet import BokehRenderer, RenderSettings, read_scene\n\n"
        f"settings = RenderSettings().updated({_python_literal(table)})\n"
        f"scene = read_scene({_python_literal(name(image))}, settings)\n"
        f"BokehRenderer().render(scene, settings).save({_python_literal(output)})"
    )


def look_of(settings: RenderSettings) -> RenderSettings:
    """Return the part of settings that a preset may contain, everything else at its default.

    Examples:
        >>> both = RenderSettings().updated({"camera": {"blur": 40}, "aperture": {"blades": 6}})
        >>> look_of(both).to_table()
        {'aperture': {'blades': 6}}
    """
    table = {
        group: {
            key: value for key, value in fields.items() if all_settings()[f"{group}.{key}"].allowed_in_preset
        }
        for group, fields in settings.to_table().items()
    }
    return RenderSettings().updated(table)


def _text(value: Any, name: Name) -> str:
    if isinstance(value, Path):
        return name(value)
    if isinstance(value, tuple):
        return ",".join(_text(item, name) for item in value)
    return str(value)


def _paths(settings: RenderSettings) -> list[Path]:
    values = (
        getattr(getattr(settings, path.partition(".")[0]), path.partition(".")[2]) for path in all_settings()
    )
    return [value for value in values if isinstance(value, Path)]


def _python_literal(value: Any) -> str:
    """Return a Python literal with double quotes."""
    if isinstance(value, dict):
        return (
            "{"
            + ", ".join(f"{_python_literal(key)}: {_python_literal(item)}" for key, item in value.items())
            + "}"
        )
    if isinstance(value, list):
        return "[" + ", ".join(map(_python_literal, value)) + "]"
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    if isinstance(value, float) and value in (float("inf"), float("-inf")):
        return f'float("{value}")'
    return repr(to_plain(value))
