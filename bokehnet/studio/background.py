"""Background process for long tasks, by default at low priority, which leaves the cores to quick tasks."""

import contextlib
import importlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Sequence
from multiprocessing.reduction import ForkingPickler
from time import monotonic
from typing import Any, Protocol

from bokehnet.errors import BokehnetError, RenderCancelled
from bokehnet.processes.limits import limit_address_space, limit_cpu_time
from bokehnet.progress import Progress
from bokehnet.render.cancellation import CancelSignal
from bokehnet.studio.failures import failure_message

__all__ = ["BackgroundProcess", "Task"]

_POLL_INTERVAL = 0.02  # s between checks for cancellation
_NICENESS = 10
_MEMORY_FRACTION = 0.8  # of the machine's memory that the process may map


class Task(Protocol):
    """Module-level function, importable by the process, that calls ``report`` regularly."""

    def __call__(self, *arguments: Any, report: Progress) -> Any:
        """Run the task; an exception from ``report`` ends it."""
        ...


class BackgroundProcess:
    """Runner of one task at a time in a background process, which is replaced if it dies.

    A cancelled task ends at its next step; the caller does not wait for it.

    Args:
        niceness: Added to the niceness of the process; 0 keeps normal priority.
        modules: Modules of its tasks, which the process imports at its start.
    """

    def __init__(self, niceness: int = _NICENESS, modules: Sequence[str] = ()) -> None:
        self._niceness, self._modules = niceness, tuple(modules)
        self._turn = threading.Lock()
        self._context = multiprocessing.get_context("spawn")
        self._number = 0
        self._process: Any = None
        self._sender: threading.Thread | None = None

    def start(self) -> None:
        """Start the process in advance, which takes a second."""
        with self._turn:
            self._ensure()

    def stop(self) -> None:
        """End the process at once."""
        process = self._process
        if process is not None:
            process.terminate()
            process.join(5)

    def run(
        self,
        task: Callable[..., Any],
        *arguments: Any,
        progress: Progress | None = None,
        cancel: CancelSignal | None = None,
        seconds: float | None = None,
    ) -> Any:
        """Run a task and return its result.

        Args:
            task: Task to run, see :class:`Task`.
            arguments: Arguments of the task, which are pickled.
            progress: Called with (steps done, total steps).
            cancel: Cancellation signal, checked continuously.
            seconds: Time limit.

        Raises:
            RenderCancelled: ``cancel`` was set.
            BokehnetError: The task raised it, took too long, or its process died.
        """
        while not self._turn.acquire(timeout=_POLL_INTERVAL):
            if cancel is not None and cancel.is_set():
                raise RenderCancelled("rendering was cancelled")
        try:
            self._ensure()
            self._number += 1
            number = self._current.value = self._number
            try:
                self._send((number, task, arguments, seconds), cancel)
                return self._answer(number, progress, cancel, seconds)
            except BokehnetError:  # some are also OSError
                raise
            except (EOFError, OSError) as error:
                self._process.join(5)
                code, self._process = self._process.exitcode, None
                raise BokehnetError(
                    f"the background process died (exit code {code}), out of memory?; try again"
                ) from error
        finally:
            self._turn.release()

    def _send(self, message: Any, cancel: CancelSignal | None) -> None:
        """Send a task while answers are read.

        The process may be sending the answer of a cancelled task, and reads nothing before that is read.
        """
        content = ForkingPickler.dumps(message)
        while self._sender is not None and self._sender.is_alive():
            if cancel is not None and cancel.is_set():
                raise RenderCancelled("rendering was cancelled")
            if self._pipe.poll(_POLL_INTERVAL):
                self._pipe.recv()
        self._sender = threading.Thread(target=_send_bytes, args=(self._pipe, content), daemon=True)
        self._sender.start()

    def _answer(
        self, number: int, progress: Progress | None, cancel: CancelSignal | None, seconds: float | None
    ) -> Any:
        begun = monotonic()
        while True:
            if cancel is not None and cancel.is_set():
                self._current.value = 0
                raise RenderCancelled("rendering was cancelled")
            if seconds is not None and monotonic() > begun + seconds:
                self._process.kill()
                self._process.join()
                self._process = None
                raise BokehnetError(f"expected this to finish within {seconds:g} s; it was stopped")
            if not self._pipe.poll(_POLL_INTERVAL):
                continue
            sender, kind, value = self._pipe.recv()
            if sender != number:  # from a cancelled task
                continue
            if kind == "progress":
                if progress is not None:
                    progress(*value)
            elif kind == "error":
                raise value
            else:
                return value

    def _ensure(self) -> None:
        if self._process is not None and self._process.is_alive():
            return
        self._sender = None
        self._pipe, worker_end = self._context.Pipe()
        self._current = self._context.Value("q", 0)
        self._process = self._context.Process(
            target=_serve,
            args=(worker_end, self._current, self._niceness, self._modules),
            daemon=True,
        )
        self._process.start()
        worker_end.close()  # so that the pipe closes with the process


def _send_bytes(pipe: Any, content: Any) -> None:
    with contextlib.suppress(OSError):  # the process has died, which its answer tells
        pipe.send_bytes(content)


def _serve(pipe: Any, current: Any, niceness: int, modules: Sequence[str]) -> None:
    """Run tasks from the pipe until it closes; main function of the process.

    Arguments are those of :class:`BackgroundProcess`, and its pipe and the number of its current task.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all processes; the parent handles it
    if hasattr(os, "nice"):
        os.nice(niceness)
    if hasattr(os, "sysconf"):
        limit_address_space(int(_MEMORY_FRACTION * os.sysconf("SC_PHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE"))
    for module in modules:
        importlib.import_module(module)
    while True:
        try:
            number, task, arguments, seconds = pipe.recv()
        except (EOFError, OSError):  # the parent has ended
            return
        limit_cpu_time(None if seconds is None else seconds * (os.cpu_count() or 1))

        def report(done: int, total: int, number: int = number) -> None:
            if current.value != number:
                raise RenderCancelled("rendering was cancelled")
            pipe.send((number, "progress", (done, total)))

        try:
            answer = (number, "done", task(*arguments, report=report))
        except BokehnetError as error:
            answer = (number, "error", error)
        except MemoryError:
            answer = (number, "error", BokehnetError("out of memory, try a smaller picture"))
        except Exception as error:  # a bug must not stop the next task
            answer = (number, "error", BokehnetError(failure_message(error)))
        with contextlib.suppress(BrokenPipeError):
            pipe.send(answer)
