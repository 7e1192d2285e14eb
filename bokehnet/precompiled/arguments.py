"""Arguments of kernels: descriptions of their types, and the flat argument list of machine code.

Machine code takes an array as seven or more numbers (owner, parent, number of items, bytes per item, data,
shape, strides), a tuple as its elements in order, and ``None`` as a null pointer. This is the calling
convention of numba; ``tools/kernel_library.py`` compares the convention of every kernel with this file.
"""

import ctypes
from collections.abc import Iterator
from typing import Any

import numpy as np

__all__ = ["SCALARS", "UnsupportedArgument", "c_types", "describe", "flatten"]

SCALARS = {
    "b1": ctypes.c_bool,
    "i1": ctypes.c_int8,
    "i2": ctypes.c_int16,
    "i4": ctypes.c_int32,
    "i8": ctypes.c_int64,
    "u1": ctypes.c_uint8,
    "u2": ctypes.c_uint16,
    "u4": ctypes.c_uint32,
    "u8": ctypes.c_uint64,
    "f4": ctypes.c_float,
    "f8": ctypes.c_double,
}
_INT64_LIMIT = 2**63


class UnsupportedArgument(Exception):  # noqa: N818  # control flow, not an error: numba compiles for such arguments
    """Argument of a type that precompiled kernels do not support."""


def describe(value: Any) -> str:
    """Return the type of an argument as a short string.

    ``f4[3C]`` is an array of float32 with three axes and the layout ``C``, ``F`` or ``A`` (any strides), with
    the suffix ``r`` if it is read-only; ``i8`` is an integer; ``Name(f4[1C],None)`` is a named tuple.

    Raises:
        UnsupportedArgument: The type is not supported, or an array is unaligned or in foreign byte order.

    Examples:
        >>> describe((np.zeros((2, 3), np.float32), 4, None))
        '(f4[2C],i8,None)'
    """
    kind = type(value)
    if kind is np.ndarray:
        flags, dtype = value.flags, value.dtype
        word = dtype.str[1:]
        if word not in SCALARS or not dtype.isnative or not flags.aligned:
            raise UnsupportedArgument
        layout = "C" if flags.c_contiguous else "F" if flags.f_contiguous else "A"
        return f"{word}[{value.ndim}{layout}{'' if flags.writeable else 'r'}]"
    if kind is float:
        return "f8"
    if kind is bool:
        return "b1"
    if kind is int and -_INT64_LIMIT <= value < _INT64_LIMIT:
        return "i8"
    if value is None:
        return "None"
    if isinstance(value, tuple):
        name = "" if kind is tuple else kind.__name__
        return f"{name}({','.join([describe(element) for element in value])})"
    if isinstance(value, np.generic) and value.dtype.str[1:] in SCALARS:
        return value.dtype.str[1:]
    raise UnsupportedArgument


def flatten(values: tuple[Any, ...], flat: list[Any]) -> None:
    """Append the flat arguments of machine code to ``flat``; all types must be known to :func:`describe`."""
    for value in values:
        if type(value) is np.ndarray:
            flat += (None, None, value.size, value.itemsize, value.__array_interface__["data"][0])
            flat += value.shape
            flat += value.strides
        elif isinstance(value, tuple):
            flatten(value, flat)
        else:
            flat.append(value if not isinstance(value, np.generic) else value.item())


def c_types(description: str) -> list[Any]:
    """Return the C types of the flat list for a tuple of arguments, described by :func:`describe`.

    Examples:
        >>> [kind.__name__ for kind in c_types("(f4,(i8,None))")]
        ['c_float', 'c_long', 'c_void_p']
    """
    return [kind for word in _leaf_types(description) for kind in _flat_types(word)]


def _leaf_types(description: str) -> Iterator[str]:
    """Yield the descriptions of scalars and arrays, without the brackets of tuples."""
    for word in description.replace("(", "(,").replace(")", ",").split(","):
        if word and not word.endswith("("):
            yield word


def _flat_types(word: str) -> list[Any]:
    if word == "None":
        return [ctypes.c_void_p]
    if "[" not in word:
        return [SCALARS[word]]
    axes = int(word[word.index("[") + 1 :].rstrip("CFAr]"))
    return [ctypes.c_void_p] * 2 + [ctypes.c_ssize_t] * 2 + [ctypes.c_void_p] + [ctypes.c_ssize_t] * 2 * axes
