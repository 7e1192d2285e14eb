"""Validation of requests: settings by groups, whose files must be uploads of the same request."""

import json
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from bokehnet.engine_registry import DEFAULT_ENGINE, ENGINES
from bokehnet.errors import ConfigError, ParameterError
from bokehnet.inference.depth_convention import convention_names
from bokehnet.inference.depth_models import depth_model_names
from bokehnet.lenses.catalog import catalog_names
from bokehnet.scene.focus_checks import check_focus
from bokehnet.settings.preset import load_preset, presets
from bokehnet.settings.settings import RenderSettings, all_settings, merged
from bokehnet.settings.settings_file import settings_from_table, similar_name

__all__ = ["FILES", "FORMATS", "check_request", "file_name", "job_settings"]

# Files of a request other than the picture, and the settings they define.
FILES = {
    "disparity": ("input", "disparity"),
    "depth": ("input", "depth"),
    "defocus": ("input", "defocus"),
    "matte": ("input", "matte"),
    "aperture_image": ("aperture", "image"),
}

# Formats of results, and their media types.
FORMATS = {
    "png": "image/png",
    "jpg": "image/jpeg",
    "webp": "image/webp",
    "tif": "image/tiff",
    "exr": "image/x-exr",
}

_EXTENSION = re.compile(r"\.[A-Za-z0-9]{1,5}")


def file_name(field: str, sent: str | None) -> str:
    """Return the stored name of an uploaded file: its field with the original extension."""
    suffix = Path(sent or "").suffix
    if not _EXTENSION.fullmatch(suffix):
        raise ParameterError(field, "a file name with an extension, which defines its format", sent)
    return f"{field}{suffix.lower()}"


def check_request(settings: str, preset: str | None, output: str, files: Mapping[str, str]) -> dict[str, Any]:
    """Return a request in stored form, or raise if it cannot be rendered, as far as is known in advance.

    Args:
        settings: JSON object: group to fields and their values, or flags of the command line.
        preset: Name of a look; ``settings`` override it.
        output: Format of the result.
        files: Names of the uploaded files, by field.

    Raises:
        BokehnetError: A name is unknown, a value is out of range, or a setting names a file on the machine of
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
    """Return the settings of a stored request whose files are in ``folder``.

    Args:
        request: Return value of :func:`check_request`; its ``memory``, bytes, limits engines that can render
            in strips.
        folder: Folder of the job.
    """
    look = {} if request["preset"] is None else load_preset(request["preset"]).values
    uploads: dict[str, dict[str, Any]] = {}
    for field, name in request["files"].items():
        if field in FILES:
            group, key = FILES[field]
            uploads.setdefault(group, {})[key] = str(folder / name)
    settings = RenderSettings().updated(merged(look, request["settings"], uploads))
    limit, requested = request.get("memory"), settings.engine.max_memory
    strips = ENGINES[settings.engine.name or DEFAULT_ENGINE].in_strips
    if limit is not None and strips and (requested is None or requested > limit):
        settings = replace(settings, engine=replace(settings.engine, max_memory=limit))
    return settings


def _check_own_files(settings: RenderSettings) -> None:
    """Raise if a setting names a file: it would be one on the machine of the service."""
    fields = {setting: field for field, setting in FILES.items()}
    for path, known in all_settings().items():
        value = getattr(getattr(settings, known.group), known.name)
        if not isinstance(value, Path) or path == "input.depth_model":
            continue
        field = fields.get((known.group, known.name))
        remedy = f"send it as the file `{field}`" if field else "leave it out"
        raise ParameterError(path, "nothing, in a service", str(value), remedy)
    named = {
        "input.depth_model": (settings.input.depth_model, depth_model_names()),
        "input.depth_convention": (settings.input.depth_convention, convention_names()),
        "lens.name": (settings.lens.name, catalog_names()),
    }
    for path, (value, names) in named.items():
        if value is not None and str(value) not in names:
            near = similar_name(str(value), names)
            remedy = f"did you mean {near}?" if near else ""
            raise ParameterError(path, "a name that comes with the package", str(value), remedy)
