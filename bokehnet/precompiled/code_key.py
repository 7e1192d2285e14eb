"""Key of a kernel's code: equal for equal machine code, whatever comments, docstrings and line numbers say.

The key covers the bytecode of the kernel and of every function of the package that it reaches, numba's
options, and the values of the constants. Where it reaches an extension of numba (an intrinsic), it covers the
whole module of the extension, because operators are registered there under no name.
"""

import functools
import hashlib
import inspect
import sys
from collections.abc import Iterator
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np

__all__ = ["code_key"]

_PACKAGE = __name__.partition(".")[0]
_HAS_DOCSTRING = 0x4000000  # flag of code objects since Python 3.13
_PLAIN = (bool, int, float, complex, str, bytes, type(None), type(...), np.generic, np.dtype)


def code_key(kernel: Any) -> str:
    """Return the key of a :class:`bokehnet.precompiled.kernel.Kernel`, 64 hexadecimal digits.

    It belongs to one minor version of Python, whose bytecode it covers.
    """
    total, waiting, seen = hashlib.sha256(), [kernel], {id(kernel)}
    while waiting:
        words, needed = _own_words(waiting.pop())
        total.update(words)
        for item in needed:
            if id(item) not in seen:
                seen.add(id(item))
                waiting.append(item)
    return total.hexdigest()


@functools.cache
def _own_words(item: Any) -> tuple[bytes, tuple[Any, ...]]:
    """Return what a kernel, function or module is, without what it reaches, and what it reaches."""
    needed: list[Any] = []
    if isinstance(item, ModuleType):
        loader: Any = item.__spec__.loader if item.__spec__ is not None else None
        code = loader.get_code(item.__name__) if hasattr(loader, "get_code") else None
        if code is None:
            raise LookupError(f"{item.__name__}: expected its code, found none")
        words: list[Any] = [_code_words(code), *_values(code, vars(item), needed)]
        return repr(words).encode(), tuple(needed)
    function = getattr(item, "function", item)
    options = [] if function is item else sorted(item.options.items())
    closure = inspect.getclosurevars(function).nonlocals if function.__closure__ else {}
    named = vars(sys.modules[function.__module__]) if not hasattr(function, "__globals__") else None
    words = [
        repr(options),
        _code_words(function.__code__),
        [_value(value, needed) for value in function.__defaults__ or ()],
        [(name, _value(value, needed)) for name, value in closure.items()],
        *_values(function.__code__, named or function.__globals__, needed),
    ]
    return repr(words).encode(), tuple(needed)


def _code_words(code: CodeType) -> tuple[Any, ...]:
    """Return a code object without its docstring, file name and line numbers."""
    constants = code.co_consts
    if _documented(code):
        constants = constants[1:]
    words = [_code_words(value) if isinstance(value, CodeType) else repr(value) for value in constants]
    names = (code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars)
    counts = (code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount)
    return code.co_code, *names, *counts, code.co_flags & ~_HAS_DOCSTRING, words


def _documented(code: CodeType) -> bool:
    """Return whether the first constant is a docstring, or the ``None`` that stands where there is none."""
    if sys.version_info >= (3, 13):
        return bool(code.co_flags & _HAS_DOCSTRING) or (
            not code.co_flags & inspect.CO_NEWLOCALS and "__doc__" in code.co_names
        )
    is_plain_function = bool(code.co_flags & inspect.CO_NEWLOCALS) and not code.co_name.startswith("<")
    first = code.co_consts[:1]
    return (is_plain_function and isinstance(first[0] if first else 0, str | None)) or (
        not code.co_flags & inspect.CO_NEWLOCALS and "__doc__" in code.co_names
    )


def _values(code: CodeType, namespace: dict[str, Any], needed: list[Any]) -> Iterator[tuple[str, Any]]:
    """Yield the names outside the code that it may use, with what they stand for."""
    codes = [code]
    while codes:
        code = codes.pop()
        codes += [constant for constant in code.co_consts if isinstance(constant, CodeType)]
        for name in code.co_names:
            if name not in namespace or name.startswith("__"):
                continue
            value = namespace[name]
            yield name, _value(value, needed)
            if isinstance(value, ModuleType) and _is_ours(value.__name__):
                for attribute in code.co_names:
                    if attribute in vars(value):
                        yield f"{name}.{attribute}", _value(vars(value)[attribute], needed)


def _value(value: Any, needed: list[Any]) -> Any:
    """Return words for a value; functions of the package go to ``needed`` instead."""
    if isinstance(value, _PLAIN):
        return type(value).__name__, repr(value)
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, hashlib.sha256(value.tobytes()).hexdigest()
    if isinstance(value, tuple):
        return type(value).__name__, [_value(element, needed) for element in value]
    if isinstance(value, ModuleType):
        return value.__name__
    if isinstance(value, type):
        return value.__qualname__, getattr(value, "_fields", None)
    module = getattr(value, "__module__", None) or ""
    if _is_ours(module):
        is_function = isinstance(value, FunctionType) or isinstance(
            getattr(value, "function", None), FunctionType
        )
        if is_function or module in sys.modules:
            needed.append(value if is_function else sys.modules[module])
        return getattr(value, "__qualname__", "")
    return type(value).__qualname__, getattr(value, "__qualname__", None)


def _is_ours(module: str) -> bool:
    return module == _PACKAGE or module.startswith(f"{_PACKAGE}.")
