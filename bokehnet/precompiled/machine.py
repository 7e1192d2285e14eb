"""Loader of machine code: LLVM with the run-time functions of numba, and calls of the loaded code."""

import ctypes
import functools
import pickle
import platform
import sys
from collections.abc import Callable, Iterable
from typing import Any

from bokehnet.precompiled.results import result_reader

__all__ = ["CLASS_FEATURES", "MachineCode", "load", "processor_class", "system"]

MachineCode = Callable[[list[Any]], Any]

# Instruction sets (LLVM names) that machine code may use, by processor class.
CLASS_FEATURES = {
    "x86-64-v3": ("avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe"),
    "generic": (),
}

_OK = (0, -2)  # return statuses without an error; -2: the kernel returns None


class _Exception(ctypes.Structure):
    """Exception of a kernel: pickled, unless it was created at run time (``dynamic``)."""

    _fields_ = (
        ("data", ctypes.c_void_p),
        ("size", ctypes.c_int32),
        ("hash", ctypes.c_void_p),
        ("unused", ctypes.c_void_p),
        ("dynamic", ctypes.c_int32),
    )


def system() -> str:
    """Return the operating system and the architecture, such as ``linux-x86_64-64``."""
    bits = 8 * ctypes.sizeof(ctypes.c_void_p)
    return f"{sys.platform}-{platform.machine().lower()}-{bits}"


def processor_class() -> str:
    """Return the processor class for which machine code is compiled on this architecture."""
    return "x86-64-v3" if platform.machine().lower() in ("x86_64", "amd64") else "generic"


def load(code: bytes, symbol: str, needs: Iterable[str], returned: str, arguments: list[Any]) -> MachineCode:
    """Load one kernel; return a function of its flat argument list.

    Args:
        code: Object file from numba.
        symbol: Name of the kernel in the object file.
        needs: Symbols that the object file imports.
        returned: Description of the result, see :func:`bokehnet.precompiled.results.result_reader`.
        arguments: ctypes of the flat arguments.

    Raises:
        LookupError: The installed numba does not define a symbol.
    """
    from llvmlite import binding as llvm

    release = _runtime()
    machine = llvm.Target.from_default_triple().create_target_machine(jit=True)
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)
    for name in needs:  # LLVM ends the process if a symbol is missing
        if not llvm.address_of_symbol(name):
            raise LookupError(f"expected numba to define {name}")
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    kind = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_void_p, ctypes.c_void_p, *arguments)
    function = kind(engine.get_function_address(symbol))
    make_result, read_result = result_reader(returned, release)

    def call(flat: list[Any], engine: Any = engine) -> Any:  # keeps the engine alive as long as the function
        result, exception = make_result(), ctypes.POINTER(_Exception)()
        status = function(ctypes.addressof(result), ctypes.addressof(exception), *flat)
        if status not in _OK:
            _raise(symbol, status, exception)
        return read_result(result)

    return call


@functools.cache
def _runtime() -> Callable[[int], None]:
    """Define the symbols that machine code imports; return the function that releases the owner of an array.

    numba does the same before its first compilation, together with much that only the compiler needs.
    """
    from llvmlite import binding as llvm
    from numba.core.base import _load_global_helpers
    from numba.core.codegen import initialize_llvm
    from numba.core.externals import c_math_functions
    from numba.core.runtime import _nrt_python  # type: ignore[attr-defined]
    from numba.np.ufunc.parallel import _launch_threads

    initialize_llvm()
    _load_global_helpers()
    c_math_functions.install(None)
    for name, address in _nrt_python.c_helpers.items():
        llvm.add_symbol(name if name.startswith("_") else f"NRT_{name}", address)
    _launch_threads()
    release: Callable[[int], None] = ctypes.CFUNCTYPE(None, ctypes.c_void_p)(
        _nrt_python.c_helpers["MemInfo_release"]
    )
    return release


def _raise(name: str, status: int, exception: Any) -> None:
    """Raise the exception of a kernel, as numba does."""
    if status >= 1 and exception and not exception.contents.dynamic:
        raised = exception.contents
        kind, arguments, _ = pickle.loads(ctypes.string_at(raised.data, raised.size))  # from our own library
        raise kind(*(arguments or ()))
    raise RuntimeError(f"{name}: the kernel failed with status {status}")
