"""What a forked process must have anew: of its parent it has the memory, but no thread save one."""

import os
import threading
import weakref
from typing import Protocol

__all__ = ["ForkSafeLock", "Renewed", "renew_in_children"]


class Renewed(Protocol):
    """Something that a forked process makes anew."""

    def renew(self) -> None:
        """Forget what belongs to the parent; called in the child, before anything else."""
        ...


_kept: weakref.WeakSet[Renewed] = weakref.WeakSet()


def renew_in_children(item: Renewed) -> None:
    """Call ``item.renew()`` in every process that is forked from this one, while the item lives."""
    _kept.add(item)


class ForkSafeLock:
    """A lock that one thread may take more than once; open in a forked process, whoever held it before."""

    def __init__(self) -> None:
        self._lock = threading.RLock()
        renew_in_children(self)

    def __enter__(self) -> None:
        self._lock.acquire()

    def __exit__(self, *_: object) -> None:
        self._lock.release()

    def renew(self) -> None:
        """Open the lock: the thread that held it is not there."""
        self._lock = threading.RLock()


def _renew_all() -> None:
    for item in list(_kept):
        item.renew()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_renew_all)
