"""Tells, the first time, why nothing seems to happen: numba compiles the kernels and keeps them on disk."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import typer

__all__ = ["compile_notice"]


@contextmanager
def compile_notice() -> Iterator[None]:
    """Say one line on stderr when a kernel is really compiled inside this block, not found in the cache."""
    from numba.core import event  # here, so that --help stays fast

    class Listener(event.Listener):  # type: ignore[misc]
        told = False

        def on_start(self, event: Any) -> None:
            if not self.told:
                self.told = True
                typer.echo(_NOTICE, file=sys.stderr)

        def on_end(self, event: Any) -> None:
            pass

    with event.install_listener("numba:compile", Listener()):
        yield


_NOTICE = "bokehnet: compiling for this machine, once; it may take a minute"
