"""Kernels: functions that run as precompiled machine code if available, otherwise compiled by numba."""

import functools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from bokehnet.precompiled.arguments import UnsupportedArgument, describe, flatten
from bokehnet.precompiled.library import find
from bokehnet.precompiled.machine import MachineCode

__all__ = ["KERNELS", "Kernel", "record_calls"]

# All kernels of imported modules by full name.
KERNELS: dict[str, "Kernel"] = {}

_recording = False


class Kernel:
    """Function of arrays and numbers that numba can compile and that other kernels can call.

    Attributes other than those below, such as ``signatures``, are those of the numba dispatcher.

    Attributes:
        function: Python function.
        options: Options of the ``njit`` of numba.
        machine_code: Loaded machine code by argument types
            (:func:`bokehnet.precompiled.arguments.describe`); ``None`` if numba runs these types.
        called: Argument types of calls inside :func:`record_calls`.
    """

    def __init__(
        self, function: Callable[..., Any], options: dict[str, Any], compiler: Callable[[], Any]
    ) -> None:
        """Register the kernel; ``compiler`` returns the numba dispatcher and is called on first use."""
        functools.update_wrapper(self, function)
        self.name = f"{function.__module__}.{function.__qualname__}"
        self.function, self.options = function, options
        self.called: set[str] = set()
        self._compiler = compiler
        self.machine_code: dict[str, MachineCode | None] = {}
        KERNELS[self.name] = self

    def __call__(self, *arguments: Any, **keywords: Any) -> Any:
        """Run the kernel on arrays, numbers, tuples of them and ``None``."""
        try:
            description = "" if keywords else describe(arguments)
        except UnsupportedArgument:
            description = ""
        if _recording and description:
            self.called.add(description)
        elif description:
            if description not in self.machine_code:
                self.machine_code[description] = find(self, description)
            run = self.machine_code[description]
            if run is not None:
                flat: list[Any] = []
                flatten(arguments, flat)
                return run(flat)
        return self.dispatcher(*arguments, **keywords)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return getattr(self.dispatcher, name)

    @functools.cached_property
    def dispatcher(self) -> Any:
        """Numba dispatcher of the function."""
        return self._compiler()

    @property
    def _numba_type_(self) -> Any:  # numba resolves calls of kernels inside kernels by this
        return self.dispatcher._numba_type_


@contextmanager
def record_calls() -> Iterator[None]:
    """Run all calls inside the block by numba, and record their argument types in ``Kernel.called``."""
    global _recording
    _recording = True
    try:
        yield
    finally:
        _recording = False
