"""Arguments of kernels: the words that tell their types, and the flat list that machine code takes.

A kernel's machine code takes an array as seven and more numbers (owner, parent, items, bytes of an item,
data, shape, strides), a tuple as its elements one after the other, and ``None`` as a pointer to nothing. That
is numba's own calling convention; ``tools/kernel_library.py`` compares every kernel's with this file.
"""

import ctypes
from collections.abc import Iterator
from typing import Any

import numpy as np

__all__ = ["SCALARS", "Unknown", "c_types", "describe", "flatten"]

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
_LARGEST = 2**63


class Unknown(Exception):  # noqa: N818  # no error: such arguments go to the compiler
    """An argument that precompiled kernels do not take."""


def describe(value: Any) -> str:
    """The type of an argument in a word, as fine as kernels tell types apart.

    ``f4[3C]`` is a contiguous array of float32 with three axes, ``C``, ``F`` or ``A`` as NumPy lays it out,
    with ``r`` where it is read-only; ``i8`` a whole number; ``Name(f4[1C],None)`` a named tuple.

    Raises:
        Unknown: Another type, or an array that is unaligned or in foreign byte order.

    Examples:
        >>> describe((np.zeros((2, 3), np.float32), 4, None))
        '(f4[2C],i8,None)'
    """
    kind = type(value)
    if kind is np.ndarray:
        flags, dtype = value.flags, value.dtype
        word = dtype.str[1:]
        if word not in SCALARS or not dtype.isnative or not flags.aligned:
            raise Unknown
        layout = "C" if flags.c_contiguous else "F" if flags.f_contiguous else "A"
        return f"{word}[{value.ndim}{layout}{'' if flags.writeable else 'r'}]"
    if kind is float:
        return "f8"
    if kind is bool:
        return "b1"
    if kind is int and -_LARGEST <= value < _LARGEST:
        return "i8"
    if value is None:
        return "None"
    if isinstance(value, tuple):
        name = "" if kind is tuple else kind.__name__
        return f"{name}({','.join([describe(element) for element in value])})"
    if isinstance(value, np.generic) and value.dtype.str[1:] in SCALARS:
        return value.dtype.str[1:]
    raise Unknown


def flatten(values: tuple[Any, ...], flat: list[Any]) -> None:
    """Append what machine code takes for these arguments, all of them known to :func:`describe`."""
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
    """Types of the flat list for the arguments in a word of :func:`describe`, which is that of a tuple.

    Examples:
        >>> [kind.__name__ for kind in c_types("(f4,(i8,None))")]
        ['c_float', 'c_long', 'c_void_p']
    """
    return [kind for word in _words(description) for kind in _flat_types(word)]


def _words(description: str) -> Iterator[str]:
    """Words of scalars and arrays, without the brackets of the tuples around them."""
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
