"""What is shown while one waits: a bar for callbacks, and why nothing seems to happen at first."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import typer

__all__ = ["compile_notice", "progress"]

_DELAY = 1.0  # s: what is done sooner needs no bar
_LOG_INTERVAL = 10.0  # s between lines when stderr is not a terminal
_NOTICE = "bokehnet: compiling for this machine, once; it may take a minute"


@contextmanager
def progress(label: str) -> Iterator[Callable[[int, int], None]]:
    """Show a bar on stderr while the block runs longer than a second.

    Args:
        label: what is being done, such as ``"rendering"``.

    Yields:
        A callback ``report(done, total)``; both count the same things, ``done`` from 0 to ``total``.
    """
    from tqdm import tqdm  # here, so that --help stays fast

    interval = 0.1 if sys.stderr.isatty() else _LOG_INTERVAL
    with tqdm(desc=label, file=sys.stderr, delay=_DELAY, mininterval=interval, dynamic_ncols=True) as bar:

        def report(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        yield report


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
