"""Run a command of the program in a forked child under resource limits and classify the result."""

import os
import re
import resource
import select
import signal
import tempfile
import traceback
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from bokehnet.cli.streams import library_lines_caught

__all__ = ["Attempt", "attempt"]

MAX_MEMORY_BYTES = 2**30
MAX_SECONDS = 10.0

# Address space beyond that of the parent: threads and file mappings need more than the memory bound.
_ADDRESS_SPACE_BYTES = 3 * 2**30
_MAX_WAIT = 6  # wall-clock time in units of processor time: machines may be busy
_MAX_OUTPUT_BYTES = 2**20
_MAX_FILE_BYTES = 2**28
_ERROR, _NOTICE = "bokehnet: error: ", "bokehnet: "
_PROGRESS_BAR = re.compile(r"[a-z ]+: +\d+%\||.*: \d+ frames of ")
_UNEXPECTED = 99  # exit code of a child whose task raised


@dataclass(frozen=True)
class Attempt:
    """Result of an attempt.

    Attributes:
        kind: ``"done"``, ``"refused"``, or the kind of a finding.
        seconds: Processor time.
        peak_bytes: Largest resident memory, that of the parent included.
        text: Lines on stderr, at most the last 2000 characters.
    """

    kind: str
    seconds: float
    peak_bytes: int
    text: str

    @property
    def is_finding(self) -> bool:
        """True unless the attempt succeeded or failed with one line."""
        return self.kind not in ("done", "refused")


def attempt(
    task: Callable[[], int], max_seconds: float = MAX_SECONDS, max_bytes: int = MAX_MEMORY_BYTES
) -> Attempt:
    """Run ``task``, which returns an exit code, in a child; its stderr and stdout are captured.

    Args:
        task: Function without arguments.
        max_seconds: Limit of processor time; six times that of wall-clock time.
        max_bytes: Limit of resident memory.
    """
    with tempfile.TemporaryFile() as errors:
        child = os.fork()
        if child == 0:
            _run(task, errors.fileno(), max_seconds)
        handle = os.pidfd_open(child)
        ready = select.select([handle], [], [], _MAX_WAIT * max_seconds)[0]
        if not ready:
            os.kill(child, signal.SIGKILL)
        os.close(handle)
        _, status, usage = os.wait4(child, 0)
        seconds, peak = usage.ru_utime + usage.ru_stime, usage.ru_maxrss * 1024
        errors.seek(0)
        text = errors.read(_MAX_OUTPUT_BYTES).decode("utf-8", "replace")
    kind = _kind(status, text) if ready else "hang"
    if peak > max_bytes and kind in ("done", "refused"):
        kind = "memory"
    return Attempt(kind, seconds, peak, text[-2000:])


def _run(task: Callable[[], int], errors: int, max_seconds: float) -> None:
    """Run the task in the child and leave it."""
    code = _UNEXPECTED
    warnings.simplefilter("ignore", RuntimeWarning)  # as the program does
    try:
        os.setsid()
        nothing = os.open(os.devnull, os.O_RDWR)
        for target, descriptor in ((nothing, 0), (nothing, 1), (errors, 2)):
            os.dup2(target, descriptor)
        size = int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
        for kind, limit in (
            (resource.RLIMIT_AS, size + _ADDRESS_SPACE_BYTES),
            (resource.RLIMIT_CPU, int(max_seconds)),
            (resource.RLIMIT_FSIZE, _MAX_FILE_BYTES),
            (resource.RLIMIT_CORE, 0),
        ):
            resource.setrlimit(kind, (limit, limit))
        with library_lines_caught():
            code = task()
    except BaseException:
        os.write(2, traceback.format_exc().encode())
    finally:
        os._exit(code)


def _kind(status: int, text: str) -> str:
    """Classify an ended child by its status and its stderr."""
    if os.WIFSIGNALED(status):
        number = os.WTERMSIG(status)
        return "hang" if number == signal.SIGXCPU else f"crash by {signal.Signals(number).name}"
    code = os.WEXITSTATUS(status)
    lines = [line.rpartition("\r")[2] for line in text.split("\n")]  # without the progress bar
    lines = [line for line in lines if line.strip() and not _PROGRESS_BAR.match(line)]
    if "Traceback (most recent call last)" in text or code == _UNEXPECTED:
        return "traceback"
    if any(not line.startswith(_NOTICE) for line in lines):
        return "foreign line"
    count = sum(line.startswith(_ERROR) for line in lines)
    if "see bokehnet --help" in text:
        return "wrong command"
    if code == 1 and count == 1 and lines[-1].startswith(_ERROR):
        return "refused"
    return "done" if code == 0 and count == 0 else f"exit code {code} with {count} errors"
