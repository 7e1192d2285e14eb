"""Commands of a recipe, each in a child process that writes to a log and ends with its parent."""

import contextlib
import importlib
import multiprocessing
import os
import signal
import sys
from collections.abc import Sequence
from pathlib import Path

import numba
import torch

from bokehnet.synth.dataset import end_with_parent

__all__ = ["Job", "call"]

# Imported once in the fork server, which runs nothing else.
_TOOLS = [
    "bokehnet.cli.app",
    *(f"train.{name}" for name in ("prepare", "prepare_light", "export", "evaluate", "card")),
]
_TOOLS += [f"train.train_{name}" for name in ("arnet", "iunet", "error", "light", "bokehme")]


def call(words: Sequence[str], processes: int = 1) -> None:
    """Run a command in this process, or with ``torchrun`` in several processes.

    Raises:
        SystemExit: The command failed or was stopped.
    """
    if words[0] == "bokehnet":
        from bokehnet.cli.app import run

        if code := run(words[1:]):
            sys.exit(code)
        return
    module, arguments = words[2], words[3:]
    if processes > 1:
        from torch.distributed.elastic.multiprocessing.errors import ChildFailedError
        from torch.distributed.run import main as torchrun

        try:
            torchrun(["--standalone", "--nproc-per-node", str(processes), "-m", module, *arguments])
        except ChildFailedError:
            sys.exit(f"error: {module} failed; see its messages above")
        return
    importlib.import_module(module).main(arguments)


class Job:
    """Running command in a child process.

    Args:
        words: Words of the command.
        log: File to which its output is appended.
        threads: Maximum number of threads.
        processes: Number of processes under ``torchrun``.
    """

    def __init__(self, words: Sequence[str], log: Path, threads: int, processes: int = 1) -> None:
        self.log = log
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload(_TOOLS)
        self._process = context.Process(target=_run, args=(list(words), log, threads, processes))
        self._process.start()

    @property
    def sentinel(self) -> int:
        """Handle for ``multiprocessing.connection.wait``."""
        return self._process.sentinel

    def code(self) -> int:
        """Wait for the command to end and return its exit code."""
        self._process.join()
        return self._process.exitcode or 0

    def stop(self) -> None:
        """Send SIGINT, as Ctrl-C does; trainings write a checkpoint first."""
        with contextlib.suppress(ProcessLookupError):
            if self._process.pid is not None and self._process.is_alive():
                os.kill(self._process.pid, signal.SIGINT)

    def last_log_line(self) -> str:
        """Return the last line of its log that is not blank."""
        lines = self.log.read_text(encoding="utf-8", errors="replace").splitlines()
        return next((line for line in reversed(lines) if line.strip()), "no output")


def _run(words: list[str], log: Path, threads: int, processes: int) -> None:
    end_with_parent()
    os.setpgid(0, 0)  # Ctrl-C reaches only the parent, which stops its jobs
    signal.signal(signal.SIGINT, signal.default_int_handler)
    with log.open("ab") as file:
        for stream in (1, 2):
            os.dup2(file.fileno(), stream)
    torch.set_num_threads(threads)
    numba.set_num_threads(min(threads, numba.get_num_threads()))
    try:
        call(words, processes)
    except KeyboardInterrupt:
        sys.exit(130)
