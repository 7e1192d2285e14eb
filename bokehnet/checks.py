"""Checks of arguments at the public API, for NumPy arrays and torch tensors.

No function here imports torch.
"""

import importlib
import math
import sys
from collections.abc import Collection
from numbers import Real
from typing import Any, Protocol, TypeVar

import numpy as np

from bokehnet.errors import MissingExtraError, ParameterError, ShapeError

__all__ = [
    "MAX_LIGHT",
    "Arithmetic",
    "Array",
    "Values",
    "array_namespace",
    "array_of_numbers",
    "check_above",
    "check_at_least",
    "check_choice",
    "check_finite",
    "check_flag",
    "check_floats",
    "check_image",
    "check_kind",
    "check_light",
    "check_map",
    "check_number",
    "check_numbers",
    "check_range",
    "check_rank",
    "check_same_size",
    "check_whole",
    "constant_like",
    "number_of",
    "require_extra",
]

# A NumPy array, a torch tensor, a value of an ONNX graph or a float: anything that a formula accepts.
Array = Any


class Arithmetic(Protocol):
    """Type that supports arithmetic, for type checkers."""

    def __sub__(self, other: Any, /) -> Any: ...

    def __rmul__(self, other: Any, /) -> Any: ...

    def __rtruediv__(self, other: Any, /) -> Any: ...


# Input and output type of a formula: floats, arrays or tensors.
Values = TypeVar("Values", bound=Arithmetic)


def array_namespace(x: Array) -> Any:
    """Return the namespace of the functions for ``x``.

    This is ``torch`` for a tensor (not imported here), the namespace that ``x`` names itself, as values of an
    ONNX graph do, and otherwise ``numpy``.

    Source:
        The method ``__array_namespace__`` of the Python array API standard, 2021.
    """
    torch = sys.modules.get("torch")
    if torch is not None and isinstance(x, torch.Tensor):
        return torch
    own = getattr(x, "__array_namespace__", None)
    return np if own is None or isinstance(x, np.ndarray) else own()


def constant_like(values: np.ndarray, like: Array) -> Array:
    """Return a NumPy table as an array of the kind, dtype and device of ``like``."""
    if array_namespace(like) is np:
        return np.asarray(values, np.asarray(like).dtype)
    return like.new_tensor(values)


def check_rank(name: str, array: Array, rank: int, layout: str) -> None:
    """Raise ``ShapeError`` unless ``array`` has ``rank`` dimensions and none of them is empty."""
    if not hasattr(array, "shape"):
        raise ParameterError(name, f"an array of shape {layout}", array)
    shape = tuple(array.shape)
    if len(shape) != rank or 0 in shape:
        raise ShapeError(f"{name}: expected shape {layout} with no empty side, got {shape}")


# Maximum light of a picture: the sum of its square over a picture still fits into float32.
MAX_LIGHT = 1e15

# Remedy for pictures of other libraries.
_AS_IMAGE = "bokehnet.as_image({}) converts pictures of PIL, OpenCV, torch and files"


def check_image(name: str, image: Array) -> None:
    """Raise unless ``image`` is finite, floating-point and (H, W, 3)."""
    if not hasattr(image, "shape"):
        raise ParameterError(name, "an array of shape (H, W, 3)", image, _AS_IMAGE.format(name))
    shape = tuple(image.shape)
    if len(shape) != 3 or 0 in shape:
        converts = f"; {_AS_IMAGE.format(name)}" if len(shape) in (2, 4) and 0 not in shape else ""
        raise ShapeError(f"{name}: expected shape (H, W, 3) with no empty side, got {shape}{converts}")
    if shape[2] != 3:
        raise ShapeError(f"{name}: expected 3 channels, got {shape[2]}; {_AS_IMAGE.format(name)}")
    check_floats(name, image, _AS_IMAGE.format(name) if str(image.dtype) in ("uint8", "uint16") else "")
    check_finite(name, image)


def check_light(name: str, image: Array) -> None:
    """Raise as :func:`check_image`, or for light beyond ``MAX_LIGHT``, whose sums overflow."""
    check_image(name, image)
    low, high = float(image.min()), float(image.max())
    if max(-low, high) > MAX_LIGHT:
        expected = f"light of at most {MAX_LIGHT:g}, relative to white at 1"
        shown = f"{high if high > -low else low:g}"
        raise ParameterError(name, expected, high, "clip it or divide it", shown=shown)


def check_map(name: str, values: Array) -> None:
    """Raise unless ``values`` is (H, W) and finite."""
    check_rank(name, values, 2, "(H, W)")
    if isinstance(values, np.ma.MaskedArray) and values.mask.any():
        raise ParameterError(name, "values everywhere", shown=f"{int(values.mask.sum())} masked")
    check_finite(name, values)


def check_floats(name: str, array: Array, remedy: str = "") -> None:
    """Raise ``ParameterError`` unless ``array`` is floating-point of any precision.

    Integers are code values of a file, such as 0 to 255, or flags, whose scale is unknown.
    """
    dtype = array.dtype
    floating = dtype.kind == "f" if isinstance(dtype, np.dtype) else bool(dtype.is_floating_point)
    if not floating:
        remedy = remedy or f"{name}.astype(numpy.float32) keeps its numbers"
        raise ParameterError(name, "floating-point numbers", shown=f"an array of {dtype}", remedy=remedy)


def check_finite(name: str, array: Array) -> None:
    """Raise ``ParameterError`` if ``array`` contains NaN or infinity, or is not real-valued."""
    if getattr(getattr(array, "dtype", None), "kind", "f") == "c":
        raise ParameterError(name, "real numbers", shown=f"an array of {array.dtype}")
    try:
        finite = array_namespace(array).isfinite(array)
    except TypeError as error:  # texts, objects
        raise ParameterError(name, "an array of numbers", array) from error
    if not bool(finite.all()):
        count = int((~finite).sum())
        raise ParameterError(name, "finite values", shown=f"{count} that are NaN or infinite")


def check_same_size(first: str, a: Array, second: str, b: Array, hint: str = "") -> None:
    """Raise ``ShapeError`` unless both arrays have the same height and width; the message has W x H."""
    if tuple(a.shape[:2]) != tuple(b.shape[:2]):
        sizes = [f"{array.shape[1]}x{array.shape[0]}" for array in (a, b)]
        message = f"{first} is {sizes[0]} pixels but {second} is {sizes[1]}; they must have the same size"
        raise ShapeError(f"{message}; {hint}" if hint else message)


def number_of(value: object) -> float:
    """Return a number or a zero-dimensional array or tensor as a float; NaN for all else, including bools."""
    if getattr(value, "ndim", None) == 0:
        value = value.item()  # type: ignore[attr-defined]
    if isinstance(value, bool) or not isinstance(value, Real):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf  # type: ignore[operator]


def array_of_numbers(name: str, values: object, dtype: type[np.generic]) -> np.ndarray:
    """Return ``values`` as a new array of ``dtype``, or raise ``ParameterError`` if they are not numeric."""
    try:
        array = np.asarray(values)
    except (TypeError, ValueError) as error:  # rows of different lengths
        raise ParameterError(name, "an array of numbers", values) from error
    if array.dtype.kind not in "iufb" or isinstance(values, bool):
        raise ParameterError(name, "an array of numbers", values)
    return np.array(array, dtype)


def check_number(name: str, value: object) -> None:
    """Raise ``ParameterError`` unless ``value`` is a finite number."""
    if not math.isfinite(number_of(value)):
        raise ParameterError(name, "a finite number", value)


def check_numbers(name: str, values: object, count: int) -> None:
    """Raise ``ParameterError`` unless ``values`` is a tuple or list of ``count`` finite numbers."""
    if not isinstance(values, tuple | list) or len(values) != count:
        raise ParameterError(name, f"{count} numbers", values)
    for value in values:
        check_number(name, value)


def check_at_least(name: str, value: object, lowest: float) -> None:
    """Raise ``ParameterError`` unless ``value`` is a finite number of at least ``lowest``."""
    check_number(name, value)
    if number_of(value) < lowest:
        raise ParameterError(name, f"at least {lowest:g}", value)


def check_above(name: str, value: object, lowest: float, unit: str = "") -> None:
    """Raise ``ParameterError`` unless ``value`` is a finite number above ``lowest``."""
    number = number_of(value)
    if not lowest < number < math.inf:
        expected = f"more than {lowest:g} {unit}".rstrip()
        raise ParameterError(name, expected + " and finite" * math.isinf(number), value)


def check_range(name: str, value: object, low: float, high: float, unit: str = "") -> None:
    """Raise ``ParameterError`` unless ``value`` is a number from ``low`` to ``high``."""
    if not low <= number_of(value) <= high:
        raise ParameterError(name, f"{low:g} to {high:g} {unit}".rstrip(), value)


def check_whole(name: str, value: object, lowest: int | None = None) -> None:
    """Raise ``ParameterError`` unless ``value`` is a whole number of at least ``lowest``."""
    number = number_of(value)
    if not (number.is_integer() and (lowest is None or number >= lowest)):
        expected = "a whole number" if lowest is None else f"a whole number from {lowest} up"
        raise ParameterError(name, expected, value)


def check_flag(name: str, value: object) -> None:
    """Raise ``ParameterError`` unless ``value`` is true or false."""
    if not isinstance(value, bool | np.bool_):
        raise ParameterError(name, "True or False", value)


def check_kind(name: str, value: object, *kinds: type, optional: bool = False) -> None:
    """Raise ``ParameterError`` unless ``value`` is an instance of ``kinds``, or None if ``optional``."""
    if not (isinstance(value, kinds) or (optional and value is None)):
        names = [kind.__name__ for kind in kinds] + ["None"] * optional
        raise ParameterError(name, " or ".join(names), value)


def check_choice(name: str, value: object, choices: Collection[str]) -> None:
    """Raise ``ParameterError`` unless ``value`` is one of ``choices``."""
    if not isinstance(value, str) or value not in choices:
        raise ParameterError(name, f"one of {', '.join(sorted(choices))}", value)


def require_extra(module: str, extra: str = "") -> None:
    """Raise ``MissingExtraError`` unless ``module``, part of ``bokehnet[extra]``, can be imported.

    Without ``extra`` the package of the module alone suffices.
    """
    try:
        importlib.import_module(module)
    except ImportError as error:
        package = f"'bokehnet[{extra}]'" if extra else module
        raise MissingExtraError(f"this needs {module}: pip install {package}") from error
