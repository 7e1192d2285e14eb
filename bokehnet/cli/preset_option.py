"""``--preset``: a look from a file, as defaults for the options that the command line leaves out."""

from typing import Annotated, Any

import typer

from bokehnet.cli.presets import read_preset

__all__ = ["PresetName", "look_options"]

# Options that say what is rendered, from what and where to; a look is all the rest.
_OF_THE_SCENE = {
    *("help", "output", "disparity", "depth", "channel", "depth-unit", "invert", "disparity-range"),
    *("blur", "focus", "focal-length", "f-number", "focus-distance", "sensor-width"),
    *("focus-at", "focus-range", "focus-plane", "resize-disparity", "mixed-depth", "refine-disparity"),
    *("frames", "jobs", "overwrite", "pull", "save-maps", "weights", "max-memory", "preset"),
    *(f"{name}-{end}" for name in ("focus", "f-number", "blur") for end in ("from", "to")),
}


def look_options(context: typer.Context) -> dict[str, str]:
    """Options of the command that belong to a look: name without dashes to the name of its parameter."""
    found = {}
    for parameter in context.command.params:
        option = max(parameter.opts, key=len).lstrip("-")
        if parameter.param_type_name == "option" and option not in _OF_THE_SCENE:
            found[option] = str(parameter.name)
    return found


def _take(context: typer.Context, name: str | None) -> str | None:
    """Make the values of a preset the defaults of the options that are parsed after this one."""
    if name is not None:
        names = look_options(context)
        options: dict[str, Any] = read_preset(name, names).options
        context.default_map = {names[option]: value for option, value in options.items()}
    return name


PresetName = Annotated[
    str | None,
    typer.Option(
        "--preset",
        metavar="NAME|FILE.toml",
        callback=_take,
        is_eager=True,
        help="A look, as bokehnet presets lists them; options given beside it prevail.",
    ),
]
