"""Standard streams of the program: closed ones, and lines that libraries print on their own."""

import contextlib
import errno
import faulthandler
import io
import os
import sys
import threading
from collections.abc import Iterator

from bokehnet.processes.limits import address_space_limit

__all__ = [
    "LibraryLines",
    "address_space_shortage",
    "library_lines_caught",
    "open_closed_streams",
    "shortage",
    "write_failure",
]

_OWN = b"bokehnet: "  # start of lines of worker processes, which are passed on
_END = b"\0end of library lines\n"
_MAX_LINE_BYTES = 4096

# Least address space for a small render: libraries, and stacks and arenas of threads per core. Below it
# libraries end the process without a line, or wait for threads that could not start.
_MIN_ADDRESS_SPACE, _MIN_ADDRESS_SPACE_PER_CORE = 2**30, 2**26


def open_closed_streams() -> None:
    """Open closed standard streams on the null device, so that no file takes their place."""
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the lowest free number
    for name in ("stdin", "stdout", "stderr"):
        if getattr(sys, name) is None:
            mode = "r" if name == "stdin" else "w"
            setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))  # noqa: SIM115  # until the end


class _Notices(io.TextIOWrapper):
    """Stderr of the program; a full disk or a closed pipe behind it loses notices, never the result."""

    def write(self, text: str) -> int:
        with contextlib.suppress(OSError):
            return super().write(text)
        return len(text)

    def flush(self) -> None:
        with contextlib.suppress(OSError):
            super().flush()


class LibraryLines:
    """Count and first one of the lines that libraries printed."""

    def __init__(self) -> None:
        self.count, self.first = 0, ""

    def add(self, line: bytes) -> None:
        """Add a line without its end."""
        if text := " ".join(line.decode("utf-8", "replace").split()):
            self.count += 1
            self.first = self.first or text

    def summary(self) -> str:
        """Return one line about them; empty if there are none."""
        if not self.count:
            return ""
        lines = "a line" if self.count == 1 else f"{self.count} lines, the first"
        return f"a library printed {lines}: {self.first}"


@contextlib.contextmanager
def library_lines_caught() -> Iterator[LibraryLines]:
    """Catch what C libraries and worker processes print on stderr; ``sys.stderr`` itself still shows.

    Decoders print warnings about damaged files past the program. Lines of worker processes of this program
    are passed on.

    Yields:
        The caught lines, complete at the end of the block.
    """
    lines = LibraryLines()
    previous = sys.stderr
    try:
        previous.flush()
        own = os.dup(2)
        shown = _Notices(
            os.fdopen(own, "wb", 0),
            encoding=previous.encoding,
            errors="backslashreplace",
            line_buffering=True,
            write_through=True,
        )
    except (AttributeError, OSError, ValueError):  # no file behind it
        yield lines
        return
    reading, writing = os.pipe()
    os.dup2(writing, 2)
    os.close(writing)
    reader = threading.Thread(target=_read_lines, args=(reading, own, lines), daemon=True)
    reader.start()
    sys.stderr = shown
    traced = faulthandler.is_enabled()
    if traced:
        faulthandler.enable(shown)
    try:
        yield lines
    finally:
        if traced:
            faulthandler.enable(previous)
        with contextlib.suppress(OSError):
            os.write(2, b"\n" + _END)
        reader.join(1.0)
        os.dup2(own, 2)
        sys.stderr = previous
        with contextlib.suppress(OSError, ValueError):
            shown.close()


def _read_lines(reading: int, own: int, lines: LibraryLines) -> None:
    """Read lines until the end mark; long ones are cut."""
    with os.fdopen(reading, "rb") as file:
        while line := file.readline(_MAX_LINE_BYTES):
            if line == _END:
                return
            if line.startswith(_OWN):
                with contextlib.suppress(OSError):
                    os.write(own, line)
            else:
                lines.add(line)


def address_space_shortage() -> str | None:
    """Return one line if the address space is too small for the libraries, which would end without one."""
    limit, minimum = (
        address_space_limit(),
        _MIN_ADDRESS_SPACE + _MIN_ADDRESS_SPACE_PER_CORE * (os.cpu_count() or 1),
    )
    if limit is None or limit >= minimum:
        return None
    return (
        f"expected an address space of at least {minimum // 2**20} MiB, found a limit of "
        f"{limit // 2**20} MiB; raise it with ulimit -v"
    )


def shortage(error: Exception) -> str | None:
    """Return one line about an error of the system; None for others, which are bugs.

    Args:
        error: Error of writing to stdout, of a deleted folder, or of a library that cannot be loaded or
            cannot start a thread within the address space.
    """
    limit = address_space_limit()
    if limit is not None and not (isinstance(error, OSError) and error.errno is not None):
        return f"out of memory: the address space is limited to {limit // 2**20} MiB; raise it with ulimit -v"
    return write_failure(error) if isinstance(error, OSError) else None


def write_failure(error: OSError) -> str:
    """Return one line about an error of the system outside of any file of the command.

    Args:
        error: Error such as a full disk behind stdout, or a folder that was deleted.
    """
    if error.errno == errno.ENOENT and error.filename is None:
        return "the working folder was deleted; change to another one"
    reason = error.strerror or str(error) or type(error).__name__
    return (
        f"{error.filename}: {reason}" if error.filename is not None else f"cannot write to stdout: {reason}"
    )
