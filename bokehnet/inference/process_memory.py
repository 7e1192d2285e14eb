"""Memory of the process: its size, and keeping or releasing freed memory."""

import ctypes
import gc
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

__all__ = [
    "freed_memory_kept",
    "keep_freed_memory",
    "keeps_freed_memory",
    "release_freed_memory",
    "resident_bytes",
]

# Constants of glibc's malloc.h.
_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3

# Largest thresholds that glibc itself chooses, bytes: of arrays with memory of their own, and of trimming.
_USUAL_MMAP, _USUAL_TRIM = 32 * 2**20, 64 * 2**20

# Maximum size of one freed array, and of all free memory at the end of the heap, to keep, bytes.
_MAX_KEPT_ARRAY_BYTES, _MAX_KEPT_BYTES = 10**9, 2 * 10**9

_keeps = False


def resident_bytes() -> int:
    """Return the resident memory of the process in bytes; 0 if the system does not report it."""
    try:
        return int(Path("/proc/self/statm").read_text().split()[1]) * 4096
    except (OSError, ValueError, IndexError):
        return 0


def keep_freed_memory() -> None:
    """Keep the memory of freed arrays for reuse: large pictures render a fifth faster, with 15 % more memory.

    By default glibc returns the memory of each large array to the system, which clears it again for the next
    array. This affects the whole process, so that only the program itself calls it, not the library. No
    effect outside Linux.
    """
    global _keeps
    _keeps = sys.platform == "linux" and hasattr(ctypes.CDLL(None), "mallopt")
    _call_libc("mallopt", _MMAP_THRESHOLD, _MAX_KEPT_ARRAY_BYTES)
    _call_libc("mallopt", _TRIM_THRESHOLD, _MAX_KEPT_BYTES)


@contextmanager
def freed_memory_kept() -> Iterator[None]:
    """Keep freed memory inside the block as :func:`keep_freed_memory`; return it before and after.

    Afterwards glibc no longer adapts its thresholds: they stay at the largest that it chooses itself. Not for
    several threads at the same time. No effect if the process keeps freed memory anyway.
    """
    global _keeps
    if _keeps:
        yield
        return
    release_freed_memory()
    keep_freed_memory()
    try:
        yield
    finally:
        _keeps = False
        _call_libc("mallopt", _MMAP_THRESHOLD, _USUAL_MMAP)
        _call_libc("mallopt", _TRIM_THRESHOLD, _USUAL_TRIM)
        release_freed_memory()


def keeps_freed_memory() -> bool:
    """Return whether freed memory is kept, so that networks need no memory pool of their own."""
    return _keeps


def release_freed_memory() -> None:
    """Return freed memory to the system, where the allocator (glibc) keeps it."""
    gc.collect()
    _call_libc("malloc_trim", 0)


def _call_libc(name: str, *arguments: int) -> None:
    """Call a function of the C library if it exists."""
    function = getattr(ctypes.CDLL(None), name, None) if sys.platform == "linux" else None
    if function is not None:
        function(*arguments)
