"""The shared library of precompiled kernels: whether it fits processor and sources, and calls into it."""

import ctypes
import functools
import hashlib
import json
import os
import pickle
import platform
import re
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, TypedDict

from bokehnet.precompiled.arguments import c_types
from bokehnet.precompiled.results import result_reader

__all__ = [
    "FORMAT",
    "OFF",
    "PACKAGE",
    "PROCESSORS",
    "Table",
    "digest",
    "file_digest",
    "find",
    "library_file",
    "table_file",
]

# Set to leave everything to numba.
OFF = "BOKEHNET_NO_PRECOMPILED"

PACKAGE = Path(__file__).parent.parent

# Classes of processors that the package has kernels for, the best first.
PROCESSORS = ("x86-64-v4", "x86-64-v3")

# Of tables and of the way in which arguments are handed over; a library of another one is left alone.
FORMAT = 1

# How an array lies, in its description.
_LAYOUT = re.compile(r"(?<=\[\d)[CFA](?=r?\])")

# What a kernel says of itself when it ends: all is well, also where it returns nothing.
_FINE = (0, -2)

MachineCode = Callable[[list[Any]], Any]


class _Entries(TypedDict):
    sources: list[str]
    entries: dict[str, tuple[str, str]]


class Table(TypedDict):
    """What the libraries hold, all of them the same.

    Attributes:
        format: :data:`FORMAT`.
        libraries: SHA-256 of each library that the table belongs to, by class of processors.
        sources: SHA-256 of every file of the package that machine code was made from.
        kernels: By full name: the files that a kernel depends on, and for each type of its arguments
            (:func:`bokehnet.precompiled.arguments.describe`) the symbol and what it returns.
    """

    format: int
    libraries: dict[str, str]
    sources: dict[str, str]
    kernels: dict[str, _Entries]


class _Exception(ctypes.Structure):
    """What a kernel that raises leaves behind: the pickled exception, unless it was made while running."""

    _fields_ = (
        ("data", ctypes.c_void_p),
        ("size", ctypes.c_int32),
        ("hash", ctypes.c_void_p),
        ("unused", ctypes.c_void_p),
        ("dynamic", ctypes.c_int32),
    )


def library_file(folder: Path, processor: str) -> Path:
    """Where the library for a class of processors lies."""
    return folder / f"kernels-{processor}-linux.so"


def table_file(folder: Path) -> Path:
    """Where the table of the libraries lies."""
    return folder / "kernels-linux.json"


@functools.cache
def digest(source: str) -> str:
    """SHA-256 of a file of the package, "" if there is none."""
    return file_digest(PACKAGE / source)


def find(name: str, description: str) -> MachineCode | None:
    """Machine code of a kernel for arguments of these types, if the package has it for this machine.

    Code for arrays of any strides serves contiguous ones, too.

    Args:
        name: Full name of the kernel.
        description: Of its arguments, from :func:`bokehnet.precompiled.arguments.describe`.
    """
    opened = _open(Path(__file__).parent)
    if opened is None:
        return None
    library, table = opened
    kernel = table["kernels"].get(name)
    described = _fitting(description, kernel["entries"]) if kernel is not None else None
    if kernel is None or described is None:
        return None
    if any(digest(source) != table["sources"][source] for source in kernel["sources"]):
        return None
    symbol, returned = kernel["entries"][described]
    return _machine_code(library, name, symbol, c_types(described), returned)


def _fitting(description: str, entries: Iterable[str]) -> str | None:
    """The entry for these types, or one that takes arrays of any strides where these are contiguous.

    A list of places that is empty or holds one is contiguous however it was made, one of many is not.
    """
    if description in entries:
        return description
    layouts = _LAYOUT.findall(description)
    for entry in entries:
        taken = _LAYOUT.findall(entry)
        if _LAYOUT.sub("", entry) == _LAYOUT.sub("", description) and all(
            there in (here, "A") for here, there in zip(layouts, taken, strict=True)
        ):
            return entry
    return None


@functools.cache
def _open(folder: Path) -> tuple[ctypes.CDLL, Table] | None:
    """The library for this processor with its table, if there is one and both are whole."""
    here = sys.platform == "linux" and platform.machine() == "x86_64" and sys.maxsize > 2**32
    if not here or os.environ.get(OFF, "0") != "0" or os.environ.get("NUMBA_DISABLE_JIT", "0") != "0":
        return None
    try:
        table: Table = json.loads(table_file(folder).read_text("utf-8"))
    except (OSError, ValueError):
        return None
    for processor in PROCESSORS if table["format"] == FORMAT else ():
        path = library_file(folder, processor)
        if table["libraries"].get(processor) != file_digest(path):
            continue
        try:
            library = ctypes.CDLL(str(path))
        except OSError:  # it asks for another C library
            continue
        if library.bokehnet_fits():
            return library, table
    return None


def file_digest(path: Path) -> str:
    """SHA-256 of a file, "" if there is none."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return ""


def _machine_code(
    library: ctypes.CDLL, name: str, symbol: str, arguments: list[Any], returned: str
) -> MachineCode:
    """A function of the flat list of arguments that runs machine code in as many threads as numba would."""
    from numba import get_num_threads

    make_result, read_result = result_reader(returned, library.bokehnet_release)
    function = library[symbol]
    function.argtypes = [ctypes.c_void_p, ctypes.c_void_p, *arguments]
    function.restype = ctypes.c_int32
    set_threads, has_failed = library.bokehnet_set_threads, library.bokehnet_failed

    def call(flat: list[Any]) -> Any:
        result, exception = make_result(), ctypes.POINTER(_Exception)()
        set_threads(get_num_threads())
        status = function(ctypes.addressof(result), ctypes.addressof(exception), *flat)
        if status not in _FINE:
            _raise(name, status, exception)
        if has_failed():
            raise MemoryError(f"{name}: one of its threads could not go on")
        return read_result(result)

    return call


def _raise(name: str, status: int, exception: Any) -> None:
    """Raise what a kernel has raised, as numba would."""
    if status >= 1 and exception and not exception.contents.dynamic:
        found = exception.contents
        kind, arguments, _ = pickle.loads(ctypes.string_at(found.data, found.size))  # of our own library
        raise kind(*(arguments or ()))
    raise RuntimeError(f"{name}: the kernel failed with status {status}")
