"""Library of machine code inside a wheel: lookup, and checks against this machine and this code."""

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

__all__ = [
    "FOLDER",
    "FORMAT",
    "OFF",
    "Entry",
    "KernelEntries",
    "Manifest",
    "find",
    "library_folder",
    "versions",
]

# Environment variable; any value but 0 disables the library.
OFF = "BOKEHNET_NO_PRECOMPILED"

# Folder of the library of this package; a checkout and an editable install have none.
FOLDER = Path(__file__).parent / "machine_code"

# Folder of the library in a wheel.
_INSTALLED = "bokehnet/precompiled/machine_code"

# Version of the manifest and of the calling convention; libraries of other versions are ignored.
FORMAT = 2

# Layout of an array in its description.
_LAYOUT = re.compile(r"(?<=\[\d)[CFA](?=r?\])")

_log = logging.getLogger(__name__)


class Entry(TypedDict):
    """Object file of one kernel for one list of argument types.

    Attributes:
        start: Offset of the object file in the library, bytes.
        size: Size of the object file, bytes.
        symbol: Name of the kernel in the object file.
        needs: Symbols that numba must define.
        returned: Description of the result, see :func:`bokehnet.precompiled.results.result_reader`.
    """

    start: int
    size: int
    symbol: str
    needs: list[str]
    returned: str


class KernelEntries(TypedDict):
    """Key of the code of one kernel, and its entries by description of the arguments."""

    key: str
    entries: dict[str, Entry]


class Manifest(TypedDict):
    """Content of ``kernels.json``, the manifest of ``kernels.bin``.

    Attributes:
        format: Version, :data:`FORMAT`.
        system: Operating system and architecture, see :func:`bokehnet.precompiled.machine.system`.
        processor: Key of :data:`bokehnet.precompiled.machine.CLASS_FEATURES`.
        versions: Versions of Python and numba, see :func:`versions`.
        sha256: Hash of the library, hexadecimal.
        kernels: Entries by full name of the kernel.
    """

    format: int
    system: str
    processor: str
    versions: list[str]
    sha256: str
    kernels: dict[str, KernelEntries]


def versions() -> list[str]:
    """Return the minor versions of Python (bytecode) and numba (run-time functions)."""
    import numba

    return [
        f"{platform.python_implementation()} {sys.version_info.major}.{sys.version_info.minor}",
        "numba " + ".".join(numba.__version__.split(".")[:2]),
    ]


def find(kernel: Any, description: str, folder: Path | None = None) -> MachineCode | None:
    """Return machine code of a kernel for some argument types, or None if the library has none that fits.

    Code for arrays of any strides also serves contiguous arrays. The function ignores code whose key differs
    from that of the kernel.

    Args:
        kernel: A :class:`bokehnet.precompiled.kernel.Kernel`.
        description: Argument types from :func:`bokehnet.precompiled.arguments.describe`.
        folder: Folder of the library; default: :func:`library_folder`.
    """
    if os.environ.get(OFF, "0") != "0" or os.environ.get("NUMBA_DISABLE_JIT", "0") != "0":
        return None
    loaded = _open(folder or library_folder())
    kernel_entries = loaded[1]["kernels"].get(kernel.name) if loaded is not None else None
    entry_types = (
        _matching_entry(description, kernel_entries["entries"]) if kernel_entries is not None else None
    )
    if loaded is None or kernel_entries is None or entry_types is None:
        return None
    entry = kernel_entries["entries"][entry_types]
    try:
        if code_key(kernel) != kernel_entries["key"]:
            return None
        code = loaded[0][entry["start"] : entry["start"] + entry["size"]]
        return load(code, entry["symbol"], entry["needs"], entry["returned"], c_types(entry_types))
    except Exception as error:  # internals of numba may change; numba can still compile
        _log.info("bokehnet: %s is left to numba: %s: %s", kernel.name, type(error).__name__, error)
        return None


@functools.cache
def library_folder() -> Path:
    """Return :data:`FOLDER`, or if it is missing that of the installed package, which a checkout may shadow.

    The keys of the code decide about each kernel, so a checkout with edited kernels may use the others.
    """
    if FOLDER.is_dir():
        return FOLDER
    from importlib import metadata  # not needed by an installed package

    try:
        return Path(str(metadata.distribution("bokehnet").locate_file(_INSTALLED)))
    except metadata.PackageNotFoundError:  # numba can still compile
        return FOLDER


def _matching_entry(description: str, entries: Iterable[str]) -> str | None:
    """Return the entry for these types, or one that accepts any strides where these arrays are contiguous.

    For example, a transposed list of positions is contiguous only if it has at most one element.
    """
    if description in entries:
        return description
    layouts = _LAYOUT.findall(description)
    for entry in entries:
        entry_layouts = _LAYOUT.findall(entry)
        if _LAYOUT.sub("", entry) == _LAYOUT.sub("", description) and all(
            accepted_layout in (layout, "A")
            for layout, accepted_layout in zip(layouts, entry_layouts, strict=True)
        ):
            return entry
    return None


@functools.cache
def _open(folder: Path) -> tuple[bytes, Manifest] | None:
    """Return the library and its manifest, or None if they are damaged or for another kind of machine."""
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
    """Return whether this processor supports the instructions of a processor class."""
    features_of_class = CLASS_FEATURES.get(processor)
    if not features_of_class:
        return features_of_class is not None
    from llvmlite import binding as llvm

    features = llvm.get_host_cpu_features()
    return all(features.get(name, False) for name in features_of_class)
