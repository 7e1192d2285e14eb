"""The library of machine code that a wheel carries: what it holds, and whether it fits machine and code."""

import functools
import hashlib
import json
import logging
import os
import platform
import re
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any, TypedDict

from bokehnet.precompiled.arguments import c_types
from bokehnet.precompiled.code_key import code_key
from bokehnet.precompiled.machine import CLASS_FEATURES, MachineCode, load, system

__all__ = ["FOLDER", "FORMAT", "OFF", "Entry", "KernelEntries", "Manifest", "find", "versions"]

# Set to leave everything to numba.
OFF = "BOKEHNET_NO_PRECOMPILED"

# Where the library is, if there is one.
FOLDER = Path(__file__).parent / "machine_code"

# Of manifests and of the calling convention; a library of another one is ignored.
FORMAT = 2

# Layout of an array, in its description.
_LAYOUT = re.compile(r"(?<=\[\d)[CFA](?=r?\])")

_log = logging.getLogger(__name__)


class Entry(TypedDict):
    """One kernel for one list of types.

    Attributes:
        start: Offset of its object file in the library, bytes.
        size: Of its object file, bytes.
        symbol: Name of the kernel in it.
        needs: Names that numba must define.
        returned: See :func:`bokehnet.precompiled.results.result_reader`.
    """

    start: int
    size: int
    symbol: str
    needs: list[str]
    returned: str


class KernelEntries(TypedDict):
    """One kernel: the key of its code, and its entries by description of their arguments."""

    key: str
    entries: dict[str, Entry]


class Manifest(TypedDict):
    """What the library holds, ``kernels.json`` beside ``kernels.bin``.

    Attributes:
        format: :data:`FORMAT`.
        system: See :func:`bokehnet.precompiled.machine.system`.
        processor: Key of :data:`bokehnet.precompiled.machine.CLASS_FEATURES`.
        versions: See :func:`versions`.
        sha256: Of the library.
        kernels: By full name.
    """

    format: int
    system: str
    processor: str
    versions: list[str]
    sha256: str
    kernels: dict[str, KernelEntries]


def versions() -> list[str]:
    """Return Python and numba with their minor versions: of bytecode, and of the run-time functions."""
    import numba

    return [
        f"{platform.python_implementation()} {sys.version_info.major}.{sys.version_info.minor}",
        "numba " + ".".join(numba.__version__.split(".")[:2]),
    ]


def find(kernel: Any, description: str, folder: Path = FOLDER) -> MachineCode | None:
    """Return machine code of a kernel for arguments of these types, if the library has it for this machine.

    Code for arrays of any strides serves contiguous ones, too. Code that was made of another text of the
    kernel, comments and docstrings aside, is ignored.

    Args:
        kernel: A :class:`bokehnet.precompiled.kernel.Kernel`.
        description: Of its arguments, from :func:`bokehnet.precompiled.arguments.describe`.
        folder: Of the library.
    """
    if os.environ.get(OFF, "0") != "0" or os.environ.get("NUMBA_DISABLE_JIT", "0") != "0":
        return None
    opened = _open(folder)
    known = opened[1]["kernels"].get(kernel.name) if opened is not None else None
    described = _fitting(description, known["entries"]) if known is not None else None
    if opened is None or known is None or described is None:
        return None
    entry = known["entries"][described]
    try:
        if code_key(kernel) != known["key"]:
            return None
        code = opened[0][entry["start"] : entry["start"] + entry["size"]]
        return load(code, entry["symbol"], entry["needs"], entry["returned"], c_types(described))
    except Exception as error:  # numba's inner parts may change; numba itself can compile
        _log.info("bokehnet: %s is left to numba: %s: %s", kernel.name, type(error).__name__, error)
        return None


def _fitting(description: str, entries: Iterable[str]) -> str | None:
    """Return the entry for these types, or one that takes arrays of any strides where these are contiguous.

    A list of places that is empty or holds one is contiguous however it was made, one of many is not.
    """
    if description in entries:
        return description
    layouts = _LAYOUT.findall(description)
    for entry in entries:
        accepted = _LAYOUT.findall(entry)
        if _LAYOUT.sub("", entry) == _LAYOUT.sub("", description) and all(
            there in (here, "A") for here, there in zip(layouts, accepted, strict=True)
        ):
            return entry
    return None


@functools.cache
def _open(folder: Path) -> tuple[bytes, Manifest] | None:
    """Return the library with its manifest, if both are undamaged and made for such a machine."""
    try:
        manifest: Manifest = json.loads((folder / "kernels.json").read_text("utf-8"))
        library = (folder / "kernels.bin").read_bytes()
    except (OSError, ValueError):
        return None
    if not isinstance(manifest, dict) or manifest.get("format") != FORMAT:
        return None
    if (manifest["system"], manifest["versions"]) != (system(), versions()):
        return None
    if manifest["sha256"] != hashlib.sha256(library).hexdigest():
        return None
    return (library, manifest) if _processor_fits(manifest["processor"]) else None


def _processor_fits(processor: str) -> bool:
    """Return whether this processor has the instructions of a class."""
    needed = CLASS_FEATURES.get(processor)
    if not needed:
        return needed is not None
    from llvmlite import binding as llvm

    features = llvm.get_host_cpu_features()
    return all(features.get(name, False) for name in needed)
