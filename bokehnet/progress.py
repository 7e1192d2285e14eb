"""Progress callbacks: the type, a part of a longer job, and the callback that ignores progress."""

from collections.abc import Callable

__all__ = ["Progress", "ignore_progress", "part_of"]

# Called with (steps done, total steps). An exception that it raises ends the work.
Progress = Callable[[int, int], None]


def ignore_progress(done: int, total: int) -> None:
    """Progress callback that does nothing."""


def part_of(progress: Progress | None, part: int, parts: int) -> Progress | None:
    """Return the progress callback of one of several equally long parts of a job.

    Args:
        progress: Callback of the whole job; ``None`` returns ``None``.
        part: Index of the part, from 0.
        parts: Number of parts.
    """
    if progress is None:
        return None
    return lambda done, total: progress(part * total + done, parts * total)
