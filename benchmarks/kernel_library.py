"""The shared library of precompiled kernels: numba's LLVM code for a class of processors, linked by gcc.

``python -m benchmarks.precompile`` makes it.
"""

import ast
import ctypes
import inspect
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

import numba
import numpy as np
from llvmlite import binding as llvm
from numba import njit, types
from numba.core.registry import cpu_target
from numba.np.numpy_support import as_dtype

from bokehnet.precompiled.arguments import c_types
from bokehnet.precompiled.kernel import Kernel
from bokehnet.precompiled.library import FORMAT, PACKAGE, digest, file_digest, library_file, table_file

__all__ = ["build"]

_C_NAMES = {
    ctypes.c_void_p: "ptr",
    ctypes.c_float: "float",
    ctypes.c_double: "double",
}
_TARGET = {"reloc": "pic", "codemodel": "small", "opt": 3}


def build(kernels: Iterable[Kernel], folder: Path, processors: dict[str, str]) -> list[str]:
    """Compile every kernel for the types that it was called with, and write libraries and table.

    Args:
        kernels: With what they were called with.
        folder: Where the libraries and their table go.
        processors: LLVM's names of classes of processors, such as ``x86-64-v3``, to further features of
            theirs. All get what numba makes for the one that it was started for.

    Returns:
        Kernels that are left to numba, because Python cannot take what they return, with the reason.
    """
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    table: dict[str, Any] = {"format": FORMAT, "kernels": {}, "libraries": {}, "sources": {}}
    left: list[str] = []
    whole = llvm.parse_assembly("")
    entries = set()
    for kernel in sorted(kernels, key=lambda kernel: kernel.name):
        found = {}
        for description, signature in sorted(kernel.called.items()):
            result = _compiled(kernel, signature)
            returned = _returned(result.signature.return_type)
            if returned is None:
                left.append(f"{kernel.name} returns {result.signature.return_type}")
                continue
            _check_convention(kernel, description, result)
            symbol = f"k{len(entries)}"
            module = llvm.parse_bitcode(result.library.serialize_using_bitcode()[2])
            module.get_function(result.fndesc.llvm_func_name).name = symbol
            whole.link_in(module)
            entries.add(symbol)
            found[description] = [symbol, returned]
        if found:
            sources = sorted(_sources(kernel))
            table["kernels"][kernel.name] = {"sources": sources, "entries": found}
            table["sources"] |= {source: digest(source) for source in sources}
    _keep_only(whole, entries)
    for processor, features in processors.items():
        path = library_file(folder, processor)
        _link(whole, path, processor, features)
        table["libraries"][processor] = file_digest(path)
    table_file(folder).write_text(json.dumps(table, indent=1, sort_keys=True) + "\n", "utf-8")
    return left


def _compiled(kernel: Kernel, signature: tuple[Any, ...]) -> Any:
    """What numba makes of a kernel, without the parts that belong to one version of Python."""
    dispatcher = njit(**kernel.options, no_cpython_wrapper=True, no_cfunc_wrapper=True)(kernel.function)
    dispatcher.compile(signature)
    return dispatcher.overloads[signature]


def _returned(kind: Any) -> str | None:
    """What a kernel returns, as ``results`` reads it; ``None`` where it does not."""
    if kind == types.none:
        return ""
    if isinstance(kind, types.Number | types.Boolean):
        return str(as_dtype(kind).str[1:])
    if isinstance(kind, types.Array) and kind.layout == "C":
        return f"{as_dtype(kind.dtype).str[1:]}[{kind.ndim}C]"
    if isinstance(kind, types.BaseTuple) and all(isinstance(k, types.Number) for k in kind):
        return ",".join(str(as_dtype(element).str[1:]) for element in kind) + ","
    return None


def _check_convention(kernel: Kernel, description: str, result: Any) -> None:
    """Assert that numba hands arguments over as ``arguments`` does."""
    context = cpu_target.target_context
    function = context.call_conv.get_function_type(result.signature.return_type, result.signature.args)
    expected = [str(kind) for kind in function.args[2:]]
    given = [_C_NAMES.get(kind, f"i{8 * ctypes.sizeof(kind)}") for kind in c_types(description)]
    expected = ["ptr" if kind.endswith("*") else kind for kind in expected]
    assert expected == given, f"{kernel.name}{description}: expected {expected}, found {given}"


def _keep_only(module: Any, entries: set[str]) -> None:
    """Hide all functions but the entries, and drop what none of them needs."""
    for function in module.functions:
        if not function.is_declaration and function.name not in entries:
            function.linkage = "internal"
    machine = llvm.Target.from_default_triple().create_target_machine()
    builder = llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options(speed_level=0))
    passes = llvm.create_new_module_pass_manager()
    passes.add_global_dead_code_eliminate_pass()
    passes.run(module, builder)
    module.verify()


def _link(module: Any, path: Path, processor: str, features: str) -> None:
    machine = llvm.Target.from_default_triple().create_target_machine(
        cpu=processor, features=features, **_TARGET
    )
    module.data_layout = str(machine.target_data)
    with tempfile.TemporaryDirectory() as folder:
        compiled = Path(folder, "kernels.o")
        compiled.write_bytes(_without_folders(machine.emit_object(module)))
        runtime = PACKAGE / "precompiled/runtime.c"
        options = ("-O2", "-fPIC", "-shared", "-fvisibility=hidden", "-pthread", "-s", "-Wall", "-Wextra")
        meant = f'-DPROCESSOR="{processor}"'
        linker = ("-Wl,-z,defs", "-Wl,-z,noexecstack", "-Wl,--build-id=none", "-Wl,--gc-sections", "-lm")
        subprocess.run(
            ["gcc", *options, meant, str(runtime), str(compiled), "-o", str(path), *linker], check=True
        )


def _without_folders(code: bytes) -> bytes:
    """Machine code whose errors name their files without the folders of this machine, at equal length."""
    for folder in (PACKAGE.parent, Path(numba.__file__).parents[1]):
        path = f"{folder}/".encode()
        code = code.replace(path, b"." + b"/" * (len(path) - 1))
    return code


def _sources(kernel: Kernel) -> set[str]:
    """Files of the package, relative to it, that a kernel's machine code depends on."""
    seen: set[int] = set()
    found: set[str] = set()
    waiting: list[Any] = [kernel]
    while waiting:
        item = waiting.pop()
        if id(item) in seen:
            continue
        seen.add(id(item))
        function = inspect.unwrap(getattr(item, "function", item))
        module = sys.modules.get(getattr(function, "__module__", None) or "")
        if module is None or not module.__name__.startswith(f"{PACKAGE.name}."):
            continue
        found |= _module_files(module)
        if isinstance(function, FunctionType):
            waiting += [value for name, value in _globals(function) if callable(value)]
    return found


def _globals(function: FunctionType) -> Iterator[tuple[str, Any]]:
    """Names outside the function that it may use, with their values."""
    codes = [function.__code__]
    while codes:
        code = codes.pop()
        codes += [constant for constant in code.co_consts if inspect.iscode(constant)]
        for name in code.co_names:
            if name in function.__globals__:
                yield name, function.__globals__[name]


def _module_files(module: ModuleType, seen: frozenset[str] = frozenset()) -> set[str]:
    """A module's file, and those of the package's modules that its constants come from."""
    path = Path(str(module.__file__))
    found, tree = {path.relative_to(PACKAGE).as_posix()}, ast.parse(path.read_text("utf-8"))
    constants = [
        node.value for node in tree.body if isinstance(node, ast.Assign | ast.AnnAssign) and node.value
    ]
    makers = {name.id for value in constants for name in ast.walk(value) if isinstance(name, ast.Name)}
    for node in ast.walk(tree):
        if not isinstance(node, ast.ImportFrom) or not (node.module or "").startswith(f"{PACKAGE.name}."):
            continue
        names = [alias.asname or alias.name for alias in node.names]
        values = [getattr(module, name, None) for name in names]
        fixed = any(
            isinstance(value, int | float | str | tuple | np.ndarray | np.generic) for value in values
        )
        source = sys.modules.get(str(node.module))
        if source is None or source.__name__ in (*seen, f"{PACKAGE.name}.kernels"):
            continue
        if fixed or makers & set(names):
            found |= _module_files(source, seen | {module.__name__})
    return found
