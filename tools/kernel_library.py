"""Compile the kernels of the package ahead of time: ``python -m tools.kernel_library [FOLDER]``.

The build of a wheel runs this command (``hatch_build.py``). It needs numba and NumPy, but no C compiler, no
linker and no other dependency of the package. The default FOLDER is inside this checkout, where git ignores
it and where each kernel is used until its code changes. ``kernel_signatures.txt`` lists the kernels and their
argument types; ``python -m tools.kernel_signatures`` rewrites it. Kernels that cannot be precompiled are
compiled by numba at run time; each is reported on stderr.
"""

import argparse
import contextlib
import functools
import hashlib
import importlib
import json
import multiprocessing
import os
import re
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import bokehnet

__all__ = ["Compiled", "build", "read_signatures", "short_name"]

PACKAGE = Path(bokehnet.__file__).parent
SIGNATURES = Path(__file__).parent / "kernel_signatures.txt"

_WORD = re.compile(r"\w*\(|\w+(?:\[\d[CFA]r?\])?|\)")
_ARRAY = re.compile(r"(\w+)\[(\d)([CFA])(r?)\]")

# Object file, its symbol, imported symbols, description of the result, key of the code.
Compiled = tuple[bytes, str, list[str], str, str]


class LeftToNumba(Exception):  # noqa: N818  # no error: numba compiles the kernel at its first call
    """Kernel that cannot be precompiled."""


def short_name(name: str) -> str:
    """Return module and function of a full kernel name; they do not change if the package moves."""
    return ".".join(name.split(".")[-2:])


def read_signatures(path: Path = SIGNATURES) -> list[tuple[str, str]]:
    """Return pairs of the short name of a kernel and the description of its arguments."""
    lines = path.read_text("utf-8").splitlines()
    pairs = [line.split(" ", 1) for line in lines if line and not line.startswith("#")]
    return [(name, description) for name, description in pairs]


def build(folder: Path, signatures: list[tuple[str, str]], processes: int | None = None) -> list[str]:
    """Compile kernels and write library and manifest.

    Args:
        folder: Output folder; created if it is missing.
        signatures: Kernels and their arguments, see :func:`read_signatures`.
        processes: Number of processes; default: one per core.

    Returns:
        One line for each kernel that is left to numba.
    """
    from bokehnet.precompiled.library import FORMAT, versions
    from bokehnet.precompiled.machine import CLASS_FEATURES, processor_class, system

    processor = processor_class()
    features = ",".join(f"+{name}" for name in CLASS_FEATURES[processor])
    target = {"NUMBA_CPU_NAME": processor, "NUMBA_CPU_FEATURES": features}
    modules = kernel_modules()
    jobs: dict[str, list[tuple[str, str]]] = {}
    left_to_numba = []
    for name, description in signatures:
        module = modules.get(name.partition(".")[0])
        if module is None:
            left_to_numba.append(f"{name}: expected its module, found none")
        else:
            jobs.setdefault(module, []).append((name, description))
    results: list[tuple[str, str, Compiled]] = []
    with _environment(target), _pool(processes) as pool:
        # longest jobs first, to balance the processes
        order = sorted(jobs.items(), key=lambda job: sum(len(words) for _, words in job[1]), reverse=True)
        for future in as_completed([pool.submit(_compile_module, *job) for job in order]):
            compiled, missing = future.result()
            results += compiled
            left_to_numba += missing
            print(f"bokehnet: compiled {len(results)} of {len(signatures)} kernels", file=sys.stderr)
    library, kernels = bytearray(), dict[str, Any]()
    for name, description, (code, symbol, needs, returned, key) in sorted(
        results, key=lambda result: result[:2]
    ):
        entry = {"start": len(library), "size": len(code), "symbol": symbol, "needs": needs}
        entries = kernels.setdefault(name, {"key": key, "entries": {}})["entries"]
        entries[description] = entry | {"returned": returned}
        library += code
    manifest = {
        "format": FORMAT,
        "system": system(),
        "processor": processor,
        "versions": versions(),
        "sha256": hashlib.sha256(library).hexdigest(),
        "kernels": kernels,
    }
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "kernels.bin").write_bytes(library)
    (folder / "kernels.json").write_text(json.dumps(manifest, indent=1, sort_keys=True) + "\n", "utf-8")
    return left_to_numba


def kernel_modules() -> dict[str, str]:
    """Return the full names of all modules that define kernels, by their last components."""
    modules = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        if "bokehnet.kernels import" in path.read_text("utf-8"):
            module = ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts)
            modules[path.stem] = module
    return modules


@contextlib.contextmanager
def _environment(changes: dict[str, str]) -> Iterator[None]:
    """Set environment variables for processes that start inside the block."""
    before = {name: os.environ.get(name) for name in changes}
    os.environ.update(changes)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _pool(processes: int | None) -> ProcessPoolExecutor:
    """Return a pool of new processes, because numba reads its target at import."""
    count = processes or os.cpu_count() or 1
    return ProcessPoolExecutor(count, mp_context=multiprocessing.get_context("spawn"))


def _compile_module(
    module: str, signatures: list[tuple[str, str]]
) -> tuple[list[tuple[str, str, Compiled]], list[str]]:
    """Compile the kernels of one module; return them, and one line for each that is left to numba."""
    import gc

    gc.disable()  # many small objects of the compiler live long; this saves a tenth of the time
    compiled, left_to_numba = [], []
    for name, description in signatures:
        try:
            full = _import_kernel(module, name)
            compiled.append((full, description, _compile(full, description)))
        except Exception as error:  # numba raises many types
            reason = (str(error).strip().splitlines() or [""])[0]
            left_to_numba.append(f"{name} {description}: {type(error).__name__}: {reason}")
    return compiled, left_to_numba


def _import_kernel(module: str, name: str) -> str:
    from bokehnet.precompiled.kernel import KERNELS

    importlib.import_module(module)
    full = f"{module}.{name.partition('.')[2]}"
    if full not in KERNELS:
        raise LeftToNumba(f"expected a kernel of that name in {module}, found none")
    return full


def _compile(name: str, description: str) -> Compiled:
    """Compile one kernel to an object file."""
    from bokehnet.precompiled.code_key import code_key
    from bokehnet.precompiled.kernel import KERNELS

    _disable_wrappers_and_cache()
    kernel = KERNELS[name]
    signature = argument_types(description)
    kernel.dispatcher.compile(signature)
    result = kernel.dispatcher.overloads[signature]
    returned = _result_description(result.signature.return_type)
    _check_convention(description, result)
    library = result.library
    if library.has_dynamic_globals:
        raise LeftToNumba("its code contains addresses of this process")
    symbol = result.fndesc.llvm_func_name
    code = library.serialize_using_object_code()[2][0]
    return _without_absolute_paths(code), symbol, _needed_names(library), returned, code_key(kernel)


@functools.cache
def _disable_wrappers_and_cache() -> None:
    """Make numba compile kernels without Python wrappers and without cache files."""
    from bokehnet.kernels import uncached_dispatcher
    from bokehnet.precompiled.kernel import KERNELS, Kernel

    property_ = functools.cached_property(uncached_dispatcher)
    property_.__set_name__(Kernel, "dispatcher")
    Kernel.dispatcher = property_
    assert not any("dispatcher" in vars(kernel) for kernel in KERNELS.values())


def argument_types(description: str) -> tuple[Any, ...]:
    """Return the numba types for a description of :func:`bokehnet.precompiled.arguments.describe`."""
    words = _WORD.findall(description)
    words.reverse()
    if words.pop() != "(":
        raise LeftToNumba(f"expected a list in brackets, found {description}")
    return _elements(words)


def _elements(words: list[str]) -> tuple[Any, ...]:
    """Return the types up to the closing bracket."""
    elements: list[Any] = []
    while (word := words.pop()) != ")":
        elements.append(_tuple_type(word[:-1], _elements(words)) if word[-1] == "(" else _plain_type(word))
    return tuple(elements)


def _tuple_type(name: str, elements: tuple[Any, ...]) -> Any:
    """Return the numba type of a tuple, or of a named tuple of the package."""
    from numba import types

    is_uniform = len(set(elements)) == 1
    if not name:
        return types.UniTuple(elements[0], len(elements)) if is_uniform else types.Tuple(elements)
    if is_uniform:
        return types.NamedUniTuple(elements[0], len(elements), _tuple_class(name))
    return types.NamedTuple(elements, _tuple_class(name))


def _plain_type(word: str) -> Any:
    """Return the numba type of a number, an array or ``None``."""
    import numpy as np
    from numba import types
    from numba.np.numpy_support import from_dtype

    if word == "None":
        return types.none
    array = _ARRAY.fullmatch(word)
    kind = from_dtype(np.dtype((array[1] if array else word).replace("b1", "?")))
    if array is None:
        return kind
    return types.Array(kind, int(array[2]), array[3], readonly=bool(array[4]))


def _tuple_class(name: str) -> type:
    """Return the named tuple class of the package; the module of the kernel imports it."""
    matches = [
        kind
        for kind in tuple.__subclasses__()
        if kind.__name__ == name and kind.__module__.startswith(f"{PACKAGE.name}.")
    ]
    if len(matches) != 1:
        raise LeftToNumba(f"expected one named tuple {name}, found {len(matches)}")
    return matches[0]


def _result_description(kind: Any) -> str:
    """Return the description of a result for :mod:`bokehnet.precompiled.results`."""
    from numba import types
    from numba.np.numpy_support import as_dtype

    if kind == types.none:
        return ""
    if isinstance(kind, types.Number | types.Boolean):
        return str(as_dtype(kind).str[1:])
    if isinstance(kind, types.Array) and kind.layout == "C":
        return f"{as_dtype(kind.dtype).str[1:]}[{kind.ndim}C]"
    if isinstance(kind, types.BaseTuple) and all(isinstance(each, types.Number) for each in kind):
        return ",".join(str(as_dtype(element).str[1:]) for element in kind) + ","
    raise LeftToNumba(f"it returns {kind}")


def _check_convention(description: str, result: Any) -> None:
    """Raise LeftToNumba unless the calling convention matches :mod:`bokehnet.precompiled.arguments`."""
    import ctypes

    from numba.core.registry import cpu_target

    from bokehnet.precompiled.arguments import c_types

    names = {ctypes.c_void_p: "ptr", ctypes.c_float: "float", ctypes.c_double: "double"}
    context = cpu_target.target_context
    function = context.call_conv.get_function_type(result.signature.return_type, result.signature.args)
    expected = ["ptr" if str(kind).endswith("*") else str(kind) for kind in function.args[2:]]
    described = [names.get(kind, f"i{8 * ctypes.sizeof(kind)}") for kind in c_types(description)]
    if expected != described:
        raise LeftToNumba(f"expected arguments {described}, found {expected}")


def _needed_names(library: Any) -> list[str]:
    """Return the symbols that an object file imports from numba and Python."""
    module = library._final_module
    items = [*module.functions, *module.global_variables]
    return sorted(item.name for item in items if item.is_declaration and not item.name.startswith("llvm."))


def _without_absolute_paths(code: bytes) -> bytes:
    """Return machine code of the same length without absolute paths in its error messages."""
    import numba

    for folder in (PACKAGE.parent, Path(numba.__file__).parents[1]):
        path = f"{folder}/".encode()
        code = code.replace(path, b"." + b"/" * (len(path) - 1))
    return code


def main() -> None:
    """Build the library and report the kernels that are left to numba."""
    from bokehnet.precompiled.library import FOLDER

    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", nargs="?", type=Path, default=FOLDER, help="default: in this checkout")
    parser.add_argument("--processes", type=int, help="default: one per core")
    options = parser.parse_args()
    started = time.perf_counter()
    for line in build(options.folder, read_signatures(), options.processes):
        print(f"bokehnet: warning: left to numba: {line}", file=sys.stderr)
    size = (options.folder / "kernels.bin").stat().st_size
    print(f"bokehnet: {size / 1e6:.1f} MB in {time.perf_counter() - started:.0f} s", file=sys.stderr)


if __name__ == "__main__":
    main()
