"""Key of the code of a kernel: equal for equal machine code, independent of comments and line numbers.

The key is a SHA-256 hash of the bytecode of the kernel and of every function of the package that it reaches,
of the numba options, and of the values of the constants. If the kernel reaches an extension of numba (an
intrinsic), the key covers the whole module of the extension, because operators are registered there without
a name. Docstrings do not change the key.
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

    The key is valid for one minor version of Python, because it covers bytecode.
    """
    digest, queue, seen = hashlib.sha256(), [kernel], {id(kernel)}
    while queue:
        content, references = _own_content(queue.pop())
        digest.update(content)
        for item in references:
            if id(item) not in seen:
                seen.add(id(item))
                queue.append(item)
    return digest.hexdigest()


@functools.cache
def _own_content(item: Any) -> tuple[bytes, tuple[Any, ...]]:
    """Return the encoded content of a kernel, function or module, and the objects that it refers to."""
    references: list[Any] = []
    if isinstance(item, ModuleType):
        loader: Any = item.__spec__.loader if item.__spec__ is not None else None
        code = loader.get_code(item.__name__) if hasattr(loader, "get_code") else None
        if code is None:
            raise LookupError(f"{item.__name__}: expected its code, found none")
        content: list[Any] = [_code_content(code), *_values(code, vars(item), references)]
        return repr(content).encode(), tuple(references)
    function = getattr(item, "function", item)
    options = [] if function is item else sorted(item.options.items())
    closure = inspect.getclosurevars(function).nonlocals if function.__closure__ else {}
    module_names = vars(sys.modules[function.__module__]) if not hasattr(function, "__globals__") else None
    content = [
        repr(options),
        _code_content(function.__code__),
        [_value(value, references) for value in function.__defaults__ or ()],
        [(name, _value(value, references)) for name, value in closure.items()],
        *_values(function.__code__, module_names or function.__globals__, references),
    ]
    return repr(content).encode(), tuple(references)


def _code_content(code: CodeType) -> tuple[Any, ...]:
    """Return a code object without its docstring, file name and line numbers."""
    constants = code.co_consts
    if _has_docstring_slot(code):
        constants = constants[1:]
    content = [_code_content(value) if isinstance(value, CodeType) else repr(value) for value in constants]
    names = (code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars)
    counts = (code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount)
    return code.co_code, *names, *counts, code.co_flags & ~_HAS_DOCSTRING, content


def _has_docstring_slot(code: CodeType) -> bool:
    """Return whether the first constant is a docstring, or the ``None`` in place of one."""
    if sys.version_info >= (3, 13):
        return bool(code.co_flags & _HAS_DOCSTRING) or (
            not code.co_flags & inspect.CO_NEWLOCALS and "__doc__" in code.co_names
        )
    is_plain_function = bool(code.co_flags & inspect.CO_NEWLOCALS) and not code.co_name.startswith("<")
    first = code.co_consts[:1]
    return (is_plain_function and isinstance(first[0] if first else 0, str | None)) or (
        not code.co_flags & inspect.CO_NEWLOCALS and "__doc__" in code.co_names
    )


def _values(code: CodeType, namespace: dict[str, Any], references: list[Any]) -> Iterator[tuple[str, Any]]:
    """Yield the global names that the code may use, with their encoded values."""
    codes = [code]
    while codes:
        code = codes.pop()
        codes += [constant for constant in code.co_consts if isinstance(constant, CodeType)]
        for name in code.co_names:
            if name not in namespace or name.startswith("__"):
                continue
            value = namespace[name]
            yield name, _value(value, references)
            if isinstance(value, ModuleType) and _is_ours(value.__name__):
                for attribute in code.co_names:
                    if attribute in vars(value):
                        yield f"{name}.{attribute}", _value(vars(value)[attribute], references)


def _value(value: Any, references: list[Any]) -> Any:
    """Return an encoding of a value; append functions of the package to ``references``."""
    if isinstance(value, _PLAIN):
        return type(value).__name__, repr(value)
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, hashlib.sha256(value.tobytes()).hexdigest()
    if isinstance(value, tuple):
        return type(value).__name__, [_value(element, references) for element in value]
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
            references.append(value if is_function else sys.modules[module])
        return getattr(value, "__qualname__", "")
    return type(value).__qualname__, getattr(value, "__qualname__", None)


def _is_ours(module: str) -> bool:
    return module == _PACKAGE or module.startswith(f"{_PACKAGE}.")
