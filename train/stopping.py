"""Ending a run before its end: Ctrl-C, a polite kill, or its time is up."""

import math
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

__all__ = ["StopRequest", "Stopped", "leave_signals_to_the_parent", "stop_requests"]

SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Stopped(Exception):  # noqa: N818 - it ends a run, it is no error
    """The run stopped before its end, with a checkpoint.

    Attributes:
        asked: Stopped by Ctrl-C or a kill, not by its time limit.
    """

    def __init__(self, message: str, asked: bool) -> None:
        super().__init__(message)
        self.asked = asked


class StopRequest:
    """Whether this process was asked to stop, and whether its time is up.

    Attributes:
        asked: A signal has come.
    """

    def __init__(self, max_minutes: float) -> None:
        self.asked = False
        self._deadline = time.monotonic() + 60 * max_minutes

    @property
    def late(self) -> bool:
        """Whether the time is up."""
        return time.monotonic() > self._deadline


@contextmanager
def stop_requests(max_minutes: float = math.inf) -> Iterator[StopRequest]:
    """Turn Ctrl-C and a polite kill into a question that the loop asks between two steps."""
    request = StopRequest(max_minutes)

    def note(*_: object) -> None:
        request.asked = True

    older = {kind: signal.signal(kind, note) for kind in SIGNALS}
    try:
        yield request
    finally:
        for kind, handler in older.items():
            signal.signal(kind, handler)


def leave_signals_to_the_parent(prepare: Callable[[int], None] | None, worker: int) -> None:
    """Prepare a loader process that outlives signals to its whole group: the training process ends it.

    Else the last step before the checkpoint could wait for a batch that never comes.
    """
    for kind in SIGNALS:
        signal.signal(kind, signal.SIG_IGN)
    if prepare is not None:
        prepare(worker)
