"""Prescription as TOML text; :func:`read_prescription` reads it back unchanged."""

import dataclasses
import json
import math
from typing import Any

from bokehnet.lenses.prescription_file import Prescription, SurfaceRow

__all__ = ["prescription_toml"]


def prescription_toml(prescription: Prescription) -> str:
    """Return the TOML text of a prescription, without default values."""
    head = [
        f"{item.name} = {_value(getattr(prescription, item.name))}"
        for item in dataclasses.fields(Prescription)
        if item.name != "surfaces" and getattr(prescription, item.name) != item.default
    ]
    return "\n".join([*head, *(_row(row) for row in prescription.surfaces), ""])


def _row(row: SurfaceRow) -> str:
    lines = ["", "[[surfaces]]"]
    for item in dataclasses.fields(SurfaceRow):
        value = getattr(row, item.name)
        if value != item.default:
            lines.append(f"{item.name} = {_value(value)}")
    return "\n".join(lines)


def _value(value: Any) -> str:
    if dataclasses.is_dataclass(value):
        pairs = [(item.name, getattr(value, item.name)) for item in dataclasses.fields(value)]
        return "{" + ", ".join(f"{name} = {_value(inner)}" for name, inner in pairs) + "}"
    if isinstance(value, tuple):
        return "[" + ", ".join(map(_value, value)) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float | int):
        return "inf" if math.isinf(value) else repr(float(value))
    return json.dumps(str(value), ensure_ascii=False)
