"""Early stop of a run: Ctrl-C, SIGTERM or a time limit."""

import math
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

__all__ = ["StopRequest", "Stopped", "leave_signals_to_the_parent", "stop_requests"]

SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Stopped(Exception):  # noqa: N818 - it ends a run and is not an error
    """Raised when a run stops early, after it has written a checkpoint.

    Attributes:
        interrupted: True if Ctrl-C or SIGTERM stopped the run, false if the time limit did.
    """

    def __init__(self, message: str, interrupted: bool) -> None:
        super().__init__(message)
        self.interrupted = interrupted


class StopRequest:
    """Pending request to stop: a signal or an expired time limit.

    Attributes:
        interrupted: True if a signal has arrived.
    """

    def __init__(self, max_minutes: float) -> None:
        self.interrupted = False
        self._deadline = time.monotonic() + 60 * max_minutes

    @property
    def expired(self) -> bool:
        """True if the time limit has passed."""
        return time.monotonic() > self._deadline


@contextmanager
def stop_requests(max_minutes: float = math.inf) -> Iterator[StopRequest]:
    """Convert Ctrl-C and SIGTERM into a flag that the training loop polls between steps.

    In another thread than the main one, as in a worker of Ray, signals keep their meaning.
    """
    request = StopRequest(max_minutes)
    if threading.current_thread() is not threading.main_thread():
        yield request
        return

    def set_flag(*_: object) -> None:
        request.interrupted = True

    previous = {kind: signal.signal(kind, set_flag) for kind in SIGNALS}
    try:
        yield request
    finally:
        for kind, handler in previous.items():
            signal.signal(kind, handler)


def leave_signals_to_the_parent(prepare: Callable[[int], None] | None, worker: int) -> None:
    """Prepare a loader process that ignores signals to its process group; the training process ends it.

    Otherwise the last step before the checkpoint could wait for a batch that never arrives.
    """
    for kind in SIGNALS:
        signal.signal(kind, signal.SIG_IGN)
    if prepare is not None:
        prepare(worker)
