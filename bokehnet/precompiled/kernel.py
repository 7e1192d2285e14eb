"""Functions that run as machine code, precompiled where the package has them so, else compiled by numba."""

import functools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from bokehnet.precompiled.arguments import Unknown, describe, flatten
from bokehnet.precompiled.library import find
from bokehnet.precompiled.machine import MachineCode

__all__ = ["KERNELS", "Kernel", "record_calls"]

# Every kernel by its full name, as modules are imported.
KERNELS: dict[str, "Kernel"] = {}

_recording = False


class Kernel:
    """A function of arrays and numbers that numba can compile, and that other kernels may call.

    What is asked of it beyond a call, such as ``signatures``, numba's dispatcher answers.

    Attributes:
        function: In Python.
        options: Of numba's ``njit``.
        machine_code: What runs for the types that it was called with, as
            :func:`bokehnet.precompiled.arguments.describe` tells them; ``None`` where numba does.
        called: The same types, of calls inside :func:`record_calls`.
    """

    def __init__(
        self, function: Callable[..., Any], options: dict[str, Any], compiler: Callable[[], Any]
    ) -> None:
        """``compiler`` makes numba's dispatcher, when it is wanted."""
        functools.update_wrapper(self, function)
        self.name = f"{function.__module__}.{function.__qualname__}"
        self.function, self.options = function, options
        self.called: set[str] = set()
        self._compiler = compiler
        self.machine_code: dict[str, MachineCode | None] = {}
        KERNELS[self.name] = self

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        """Run on arrays, numbers, tuples of them and ``None``."""
        try:
            description = "" if named else describe(arguments)
        except Unknown:
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
        return self.dispatcher(*arguments, **named)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return getattr(self.dispatcher, name)

    @functools.cached_property
    def dispatcher(self) -> Any:
        """What numba makes of the function."""
        return self._compiler()

    @property
    def _numba_type_(self) -> Any:  # by which numba knows a kernel inside another one
        return self.dispatcher._numba_type_


@contextmanager
def record_calls() -> Iterator[None]:
    """Leave all calls inside the block to numba, and note in every kernel what it was called with."""
    global _recording
    _recording = True
    try:
        yield
    finally:
        _recording = False
