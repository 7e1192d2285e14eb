"""A process that does what takes long, at low priority, so that quick work finds the cores free."""

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable
from time import monotonic
from typing import Any, Protocol

from bokehnet.errors import BokehnetError, RenderCancelled
from bokehnet.progress import Progress
from bokehnet.render.cancellation import CancelSignal

__all__ = ["Helper", "Task"]

_LOOK = 0.02  # seconds between two looks at whether the result is still wanted
_NICENESS = 10


class Task(Protocol):
    """A function of a module, which the process can import; it asks ``report`` along its way."""

    def __call__(self, *arguments: Any, report: Progress) -> Any:
        """Do it; what ``report`` raises ends it."""
        ...


class Helper:
    """Runs one task after the other in a process of its own; one that dies is replaced.

    A task whose result nobody wants any more ends at its next step; the caller does not wait for that.
    """

    def __init__(self) -> None:
        self._turn = threading.Lock()
        self._context = multiprocessing.get_context("spawn")
        self._number = 0
        self._process: Any = None

    def start(self) -> None:
        """Start the process, which takes a second, before it is needed."""
        with self._turn:
            self._ensure()

    def stop(self) -> None:
        """End the process within whatever it does."""
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
        """Return what a task gives.

        Args:
            task: See :class:`Task`.
            arguments: Of the task; they are pickled.
            progress: Called with (steps done, steps in all).
            cancel: Is asked all the time; once it is set, this returns.
            seconds: How long it may take at the most.

        Raises:
            RenderCancelled: ``cancel`` was set.
            BokehnetError: The task raised it, took too long, or its process died.
        """
        while not self._turn.acquire(timeout=_LOOK):
            if cancel is not None and cancel.is_set():
                raise RenderCancelled("rendering was cancelled")
        try:
            self._ensure()
            self._number += 1
            number = self._wanted.value = self._number
            try:
                self._pipe.send((number, task, arguments))
                return self._answer(number, progress, cancel, seconds)
            except BokehnetError:  # some of them are OSError, too
                raise
            except (EOFError, OSError) as error:
                self._process.join(5)
                code, self._process = self._process.exitcode, None
                raise BokehnetError(
                    f"the process that did this died (exit code {code}), out of memory?; try it again"
                ) from error
        finally:
            self._turn.release()

    def _answer(
        self, number: int, progress: Progress | None, cancel: CancelSignal | None, seconds: float | None
    ) -> Any:
        begun = monotonic()
        while True:
            if cancel is not None and cancel.is_set():
                self._wanted.value = 0
                raise RenderCancelled("rendering was cancelled")
            if seconds is not None and monotonic() > begun + seconds:
                self._process.kill()
                self._process.join()
                self._process = None
                raise BokehnetError(f"expected this to be done within {seconds:g} s; it was ended")
            if not self._pipe.poll(_LOOK):
                continue
            of, kind, value = self._pipe.recv()
            if of != number:  # of a task that nobody waited for
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
        self._pipe, theirs = self._context.Pipe()
        self._wanted = self._context.Value("q", 0)
        self._process = self._context.Process(target=_serve, args=(theirs, self._wanted), daemon=True)
        self._process.start()
        theirs.close()  # so that the pipe ends with the process


def _serve(pipe: Any, wanted: Any) -> None:
    """Do what comes through the pipe until it closes; the main function of the process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all; the parent decides
    if hasattr(os, "nice"):
        os.nice(_NICENESS)
    while True:
        try:
            number, task, arguments = pipe.recv()
        except (EOFError, OSError):  # the parent is gone
            return

        def report(done: int, total: int, number: int = number) -> None:
            if wanted.value != number:
                raise RenderCancelled("rendering was cancelled")
            pipe.send((number, "progress", (done, total)))

        try:
            answer = (number, "done", task(*arguments, report=report))
        except BokehnetError as error:
            answer = (number, "error", error)
        except MemoryError:
            answer = (number, "error", BokehnetError("out of memory, try a smaller picture"))
        except Exception as error:  # a fault of ours is told, and the next task works
            answer = (number, "error", BokehnetError(f"failed by a fault: {type(error).__name__}: {error}"))
        with contextlib.suppress(BrokenPipeError):
            pipe.send(answer)
