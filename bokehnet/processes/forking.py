"""Renewal of locks and sessions in forked processes, which have only one of the parent's threads."""

import os
import threading
import weakref
from typing import Protocol

__all__ = ["ForkSafeLock", "Renewable", "renew_in_children"]


class Renewable(Protocol):
    """Object that a forked process must renew."""

    def renew(self) -> None:
        """Discard state of the parent; called in the child before anything else."""
        ...


_renewables: weakref.WeakSet[Renewable] = weakref.WeakSet()


def renew_in_children(item: Renewable) -> None:
    """Call ``item.renew()`` in every process forked from this one while the item exists."""
    _renewables.add(item)


class ForkSafeLock:
    """Reentrant lock that is released in forked processes."""

    def __init__(self) -> None:
        self._lock = threading.RLock()
        renew_in_children(self)

    def __enter__(self) -> None:
        self._lock.acquire()

    def __exit__(self, *_: object) -> None:
        self._lock.release()

    def renew(self) -> None:
        """Release the lock: the thread that held it does not exist in the child."""
        self._lock = threading.RLock()


def _renew_all() -> None:
    for item in list(_renewables):
        item.renew()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_renew_all)
