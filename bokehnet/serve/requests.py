"""What a client may ask for: settings by groups, whose files are those that came with the request."""

import json
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from bokehnet.engine_registry import DEFAULT_ENGINE, ENGINES
from bokehnet.errors import ConfigError, ParameterError
from bokehnet.inference.depth_convention import convention_names
from bokehnet.inference.depth_models import find_depth_model
from bokehnet.lenses.catalog import catalog_names
from bokehnet.scene.focus import check_focus
from bokehnet.settings.preset import load_preset, presets
from bokehnet.settings.settings import RenderSettings, all_settings, merged
from bokehnet.settings.settings_file import settings_from_table

__all__ = ["FILES", "FORMATS", "check_request", "file_name", "job_settings"]

# Files of a request beside the picture, and the settings that they stand for.
FILES = {
    "disparity": ("input", "disparity"),
    "depth": ("input", "depth"),
    "defocus": ("input", "defocus"),
    "matte": ("input", "matte"),
    "aperture_image": ("aperture", "image"),
}

# Of results, and their media types.
FORMATS = {
    "png": "image/png",
    "jpg": "image/jpeg",
    "webp": "image/webp",
    "tif": "image/tiff",
    "exr": "image/x-exr",
}

_EXTENSION = re.compile(r"\.[A-Za-z0-9]{1,5}")


def file_name(field: str, sent: str | None) -> str:
    """Return under what name a sent file is kept: that of its field, with the extension that it came with."""
    suffix = Path(sent or "").suffix
    if not _EXTENSION.fullmatch(suffix):
        raise ParameterError(field, "a file name with an extension, which tells its format", sent)
    return f"{field}{suffix.lower()}"


def check_request(settings: str, preset: str | None, output: str, files: Mapping[str, str]) -> dict[str, Any]:
    """Return a request as it is kept, or raise unless it can be rendered as far as is known before.

    Args:
        settings: JSON object: group to fields and their values, or flags of the command line.
        preset: A look by its name; what ``settings`` says prevails.
        output: Format of the result.
        files: Names of the files that came, by their fields.

    Raises:
        BokehnetError: A name is unknown, a value out of range, or something would be read from the machine of
            the service.
    """
    try:
        table = json.loads(settings)
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"settings: expected a JSON object, found an error: {error}") from error
    if not isinstance(table, dict):
        raise ConfigError(f"settings: expected a JSON object, found {type(table).__name__}")
    if preset is not None and preset not in presets():
        raise ParameterError("preset", f"one of {', '.join(presets())}", preset)
    if output not in FORMATS:
        raise ParameterError("format", f"one of {', '.join(FORMATS)}", output)
    changes = settings_from_table(table, "settings")
    _check_own_files(RenderSettings().updated(changes))
    request = {"settings": changes, "preset": preset, "format": output, "files": dict(files)}
    check_focus(job_settings(request, Path("/")))
    return request


def job_settings(request: Mapping[str, Any], folder: Path) -> RenderSettings:
    """Return the settings of a kept request whose files lie in ``folder``.

    Args:
        request: As :func:`check_request` returned it; ``memory`` in it, bytes, bounds that of engines that
            can work in strips.
        folder: Of the job.
    """
    look = {} if request["preset"] is None else load_preset(request["preset"]).values
    sent: dict[str, dict[str, Any]] = {}
    for field, name in request["files"].items():
        if field in FILES:
            group, key = FILES[field]
            sent.setdefault(group, {})[key] = str(folder / name)
    settings = RenderSettings().updated(merged(look, request["settings"], sent))
    bound, asked = request.get("memory"), settings.engine.max_memory
    strips = ENGINES[settings.engine.name or DEFAULT_ENGINE].in_strips
    if bound is not None and strips and (asked is None or asked > bound):
        settings = replace(settings, engine=replace(settings.engine, max_memory=bound))
    return settings


def _check_own_files(settings: RenderSettings) -> None:
    """Raise where settings name a file: it would be one of the service's machine."""
    fields = {place: field for field, place in FILES.items()}
    for path, known in all_settings().items():
        value = getattr(getattr(settings, known.group), known.name)
        if not isinstance(value, Path) or path == "input.depth_model":
            continue
        field = fields.get((known.group, known.name))
        remedy = f"send it as the file `{field}`" if field else "leave it out"
        raise ParameterError(path, "nothing, in a service", str(value), remedy)
    named = {
        "input.depth_model": (settings.input.depth_model, find_depth_model(settings.input.depth_model or "")),
        "input.depth_convention": (
            settings.input.depth_convention,
            settings.input.depth_convention in convention_names(),
        ),
        "lens.name": (settings.lens.name, settings.lens.name in catalog_names()),
    }
    for path, (value, found) in named.items():
        if value is not None and not found:
            raise ParameterError(path, "a name that comes with the package", str(value))
