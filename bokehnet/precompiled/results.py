"""Results of kernels: nothing, a number, a tuple of numbers, or a new array."""

import ctypes
from collections.abc import Callable
from typing import Any

import numpy as np

from bokehnet.precompiled.arguments import SCALARS, c_types

__all__ = ["result_reader"]

_OWNER, _DATA = 0, 4  # indices in the flat description of an array


class _Memory:
    """Memory of an array that a kernel has allocated; released with the last reference to the array."""

    def __init__(self, owner: int, release: Callable[[int], None], interface: dict[str, Any]) -> None:
        self._owner, self._release = owner, release
        self.__array_interface__ = interface

    def __del__(self) -> None:
        self._release(self._owner)


def result_reader(
    returned: str, release: Any
) -> tuple[type[ctypes.Structure], Callable[[ctypes.Structure], Any]]:
    """Return the structure to which a kernel writes its result, and a function that reads it.

    Args:
        returned: Type of the result: "" for nothing, ``i8`` for a number, ``i8,f8,`` for a tuple, ``f4[2C]``
            for an array.
        release: Run-time function of numba that releases the owner of an array.
    """
    words = [word for word in returned.split(",") if word]
    kinds = c_types(f"({returned})") if "[" in returned else [SCALARS[word] for word in words]
    names = [f"value{index}" for index in range(len(kinds))]
    structure = type("Result", (ctypes.Structure,), {"_fields_": list(zip(names, kinds, strict=True))})
    release.argtypes, release.restype = [ctypes.c_void_p], None

    def read(result: ctypes.Structure) -> Any:
        values = tuple(getattr(result, name) for name in names)
        if "[" in returned:
            return _array(values, returned.partition("[")[0], release)
        return None if not values else values if returned.endswith(",") else values[0]

    return structure, read


def _array(values: tuple[Any, ...], dtype: str, release: Callable[[int], None]) -> np.ndarray:
    shape = values[_DATA + 1 : _DATA + 1 + (len(values) - _DATA - 1) // 2]
    interface = {"version": 3, "typestr": f"<{dtype}", "shape": shape, "data": (values[_DATA], False)}
    if dtype[1] == "1":
        interface["typestr"] = f"|{dtype}"
    return np.asarray(_Memory(values[_OWNER], release, interface))
