"""Cancellation of a render."""

from typing import Protocol

from bokehnet.errors import RenderCancelled
from bokehnet.progress import Progress

__all__ = ["CancelSignal", "cancellable"]


class CancelSignal(Protocol):
    """Cancellation signal, such as a ``threading.Event``.

    Examples:
        >>> from time import monotonic
        >>> class Deadline:
        ...     def __init__(self, seconds):
        ...         self.end = monotonic() + seconds
        ...     def is_set(self):
        ...         return monotonic() >= self.end
        >>> import numpy as np
        >>> from bokehnet import BokehRenderer
        >>> picture, defocus = np.ones((24, 32, 3), np.float32), np.full((24, 32), 4, np.float32)
        >>> BokehRenderer("scatter").render_arrays(picture, defocus, cancel=Deadline(seconds=0))
        Traceback (most recent call last):
            ...
        bokehnet.errors.RenderCancelled: rendering was cancelled
    """

    def is_set(self) -> bool:
        """Return whether the work must stop."""
        ...


def cancellable(progress: Progress | None, cancel: CancelSignal | None) -> Progress:
    """Return a progress callback that raises ``RenderCancelled`` once ``cancel`` is set.

    Examples:
        >>> from threading import Event
        >>> report = cancellable(print, Event())
        >>> report(1, 4)
        1 4
    """

    def report(done: int, total: int) -> None:
        if cancel is not None and cancel.is_set():
            raise RenderCancelled("rendering was cancelled")
        if progress is not None:
            progress(done, total)

    return report
