"""Panels of the page, generated from the descriptions of the settings as JSON."""

import types
import typing
from pathlib import Path
from typing import Any

from bokehnet.errors import ParameterError
from bokehnet.lenses.catalog import catalog_names
from bokehnet.settings.fields import Setting, field_settings, to_plain
from bokehnet.settings.settings import RenderSettings, all_settings, group_types
from bokehnet.studio.panels.help_texts import HELP_TEXTS, label_of

__all__ = ["check_reachable", "is_path", "panels"]

# Text settings whose values may be file names.
_MAY_NAME_FILES = (
    "lens.name",
    "input.depth_convention",
    "color.glass",
    "color.axial_map",
    "color.lateral_map",
)


def panels() -> list[dict[str, Any]]:
    """Return all groups with their settable fields: label, kind, unit, range, default and help of each.

    Examples:
        >>> fields = {field["path"]: field for panel in panels() for field in panel["fields"]}
        >>> squeeze = fields["aperture.squeeze"]
        >>> squeeze["kind"], squeeze["low"], squeeze["high"], squeeze["default"]
        ('number', 0.1, 10, 1.0)
        >>> "engine.weights" in fields  # a path of this machine
        False
    """
    groups = []
    for group in group_types():
        fields = [_description(known) for known in field_settings(group).values() if _settable(known)]
        if fields:
            groups.append({"group": group.GROUP, "title": group.TITLE, "fields": fields})
    return groups


def is_path(known: Setting) -> bool:
    """Return whether a value can be a path.

    Examples:
        >>> is_path(all_settings()["input.disparity"]), is_path(all_settings()["camera.blur"])
        (True, False)
    """
    return known.type is Path or Path in typing.get_args(known.type)


def check_reachable(changes: dict[str, dict[str, Any]], settings: RenderSettings) -> None:
    """Raise ``ParameterError`` if changes of a page name a local file that is not already open.

    Args:
        changes: Group name to field name to plain value.
        settings: Current settings; equal values are no change.
    """
    for group, fields in changes.items():
        for name, value in fields.items():
            path = f"{group}.{name}"
            known = all_settings().get(path)
            if known is None or value is None or to_plain(getattr(getattr(settings, group), name)) == value:
                continue
            is_numeric = isinstance(value, list) and all(isinstance(item, int | float) for item in value)
            if (is_path(known) and not is_numeric) or (path in _MAY_NAME_FILES and value not in _names(path)):
                names = ", ".join(_names(path))
                expected = f"one of {names}" if names else "no file name; drop the file on the page"
                raise ParameterError(path, expected, shown="another name")


def _names(path: str) -> list[str]:
    return catalog_names() if path == "lens.name" else []


def _settable(known: Setting) -> bool:
    if known.flag is None or known.type is Path or known.group == "input":
        return False
    return known.path not in _MAY_NAME_FILES or bool(_names(known.path))


def _description(known: Setting) -> dict[str, Any]:
    choices = list(known.choices) or _names(known.path)
    return {
        "path": known.path,
        "label": label_of(known.path),
        "flag": f"--{known.flag}",
        "help": HELP_TEXTS.get(known.path, known.help),
        "unit": known.unit,
        "kind": "choice" if choices else _kind(known.type),
        "choices": choices,
        "low": known.low if known.low is not None else known.above,
        "high": known.high if known.high is not None else known.below,
        "default": to_plain(known.default),
        "expected": known.expectation,
        "look": known.allowed_in_preset,
    }


def _kind(kind: Any) -> str:
    """Return ``number``, ``whole``, ``switch``, ``text``, ``numbers`` (a list) or ``pixels``."""
    if any(typing.get_origin(inner) is typing.Literal for inner in typing.get_args(kind)):
        return "text"  # a number or one of some words
    if typing.get_origin(kind) in (typing.Union, types.UnionType):
        return next(inner for inner in map(_kind, typing.get_args(kind)) if inner != "text")
    simple = {float: "number", int: "whole", bool: "switch"}
    if kind in simple:
        return simple[kind]
    if typing.get_origin(kind) is tuple:
        inner = typing.get_args(kind)[0]
        return "pixels" if inner is int or typing.get_origin(inner) is tuple else "numbers"
    return "text"
