"""Checks at the public API, for NumPy arrays and torch tensors alike.

None of these functions imports torch: a tensor is recognised by the namespace it brings along.
"""

import importlib
import math
import sys
from collections.abc import Collection
from types import ModuleType
from typing import Any

import numpy as np

from bokehnet.errors import MissingExtraError, ParameterError, ShapeError

__all__ = [
    "Array",
    "array_namespace",
    "check_at_least",
    "check_choice",
    "check_finite",
    "check_image",
    "check_map",
    "check_number",
    "check_rank",
    "check_same_size",
    "constant_like",
    "require_extra",
]

# A NumPy array, a torch tensor or a float: whatever the operators of a formula accept.
Array = Any


def array_namespace(x: Array) -> ModuleType:
    """Return ``torch`` for a tensor and ``numpy`` for everything else; torch is never imported here."""
    torch = sys.modules.get("torch")
    if torch is not None and isinstance(x, torch.Tensor):
        return torch
    return np


def constant_like(values: np.ndarray, like: Array) -> Array:
    """Return a NumPy table as an array of the kind, dtype and device of ``like``."""
    if array_namespace(like) is np:
        return np.asarray(values, np.asarray(like).dtype)
    return like.new_tensor(values)


def check_rank(name: str, array: Array, rank: int, layout: str) -> None:
    """Raise ``ShapeError`` unless ``array`` has ``rank`` dimensions and none of them is empty."""
    shape = tuple(array.shape)
    if len(shape) != rank or 0 in shape:
        raise ShapeError(f"{name}: expected shape {layout} with no empty side, got {shape}")


def check_image(name: str, image: Array) -> None:
    """Raise unless ``image`` is (H, W, 3) and finite."""
    check_rank(name, image, 3, "(H, W, 3)")
    if image.shape[2] != 3:
        raise ShapeError(f"{name}: expected 3 channels, got {image.shape[2]}; convert it to RGB first")
    check_finite(name, image)


def check_map(name: str, values: Array) -> None:
    """Raise unless ``values`` is (H, W) and finite."""
    check_rank(name, values, 2, "(H, W)")
    check_finite(name, values)


def check_finite(name: str, array: Array) -> None:
    """Raise ``ParameterError`` when ``array`` holds NaN or infinity."""
    finite = array_namespace(array).isfinite(array)
    if not bool(finite.all()):
        count = int((~finite).sum())
        raise ParameterError(f"{name}: expected finite values, found {count} that are NaN or infinite")


def check_same_size(first: str, a: Array, second: str, b: Array, hint: str = "") -> None:
    """Raise ``ShapeError`` unless both arrays have the same height and width; sizes are told as W x H."""
    if tuple(a.shape[:2]) != tuple(b.shape[:2]):
        sizes = [f"{array.shape[1]}x{array.shape[0]}" for array in (a, b)]
        message = f"{first} is {sizes[0]} pixels but {second} is {sizes[1]}; they must be of one size"
        raise ShapeError(f"{message}; {hint}" if hint else message)


def check_number(name: str, value: float) -> None:
    """Raise ``ParameterError`` unless ``value`` is a finite number."""
    if not math.isfinite(value):
        raise ParameterError(f"{name}: expected a finite number, got {value}")


def check_at_least(name: str, value: float, lowest: float) -> None:
    """Raise ``ParameterError`` unless ``value`` is a finite number and not below ``lowest``."""
    check_number(name, value)
    if value < lowest:
        raise ParameterError(f"{name}: expected at least {lowest:g}, got {value:g}")


def check_choice(name: str, value: str, choices: Collection[str]) -> None:
    """Raise ``ParameterError`` unless ``value`` is one of ``choices``."""
    if value not in choices:
        raise ParameterError(f"{name}: expected one of {', '.join(sorted(choices))}, got {value!r}")


def require_extra(module: str, extra: str) -> None:
    """Raise ``MissingExtraError`` unless ``module`` can be imported; it comes with ``bokehnet[extra]``."""
    try:
        importlib.import_module(module)
    except ImportError as error:
        raise MissingExtraError(f"this needs {module}: pip install 'bokehnet[{extra}]'") from error
