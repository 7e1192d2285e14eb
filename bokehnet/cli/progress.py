"""What is shown while one waits: a bar for callbacks, and why nothing seems to happen at first."""

import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

from bokehnet.progress import Progress

__all__ = ["compile_notice", "progress", "stages", "write_above"]

_DELAY = 1.0  # s: what is done sooner needs no bar
_LOG_INTERVAL = 10.0  # s between lines when stderr is not a terminal
_BAR = "{desc}: {percentage:3.0f}%|{bar}| {elapsed}, {remaining} left{postfix}"
_NOTICE = "bokehnet: compiling for this machine, once; it may take a minute"


@contextmanager
def progress(label: str, *, hidden: bool = False, counted: bool = True) -> Iterator[Progress]:
    """Show a bar on stderr while the block runs longer than a second, also before anything is done.

    Args:
        label: what is being done, such as ``"rendering"``.
        hidden: show none.
        counted: show how many things are done; else the share.

    Yields:
        A callback ``report(done, total)``; both count the same things, ``done`` from 0 to ``total``.
    """
    from tqdm import tqdm  # here, so that --help stays fast

    interval = 0.1 if sys.stderr.isatty() else _LOG_INTERVAL
    ended = threading.Event()
    with tqdm(
        desc=label,
        file=sys.stderr,
        delay=_DELAY,
        mininterval=interval,
        dynamic_ncols=True,
        disable=hidden,
        bar_format=None if counted else _BAR,
    ) as bar:

        def report(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        def tick() -> None:
            wait = _DELAY
            while not ended.wait(wait):
                bar.delay = 0  # else its end takes it for one that was never shown
                bar.refresh()
                wait = max(1.0, interval)

        ticker = threading.Thread(target=tick, daemon=True)
        if not hidden:
            ticker.start()
        try:
            yield report
        finally:
            ended.set()
            if not hidden:
                ticker.join()


def _add_to_bars(text: str) -> None:
    """Let bars that are shown say more, from their next refreshing on."""
    from tqdm import tqdm

    for bar in list(getattr(tqdm, "_instances", ())):
        bar.set_postfix_str(text, refresh=False)


def write_above(line: str) -> None:
    """Write a line on stderr, above a bar that is shown."""
    from tqdm import tqdm

    tqdm.write(line, file=sys.stderr)
    for bar in list(getattr(tqdm, "_instances", ())):  # which are all shown from now on
        bar.delay = 0


@contextmanager
def stages(*, hidden: bool = False) -> Iterator[Callable[[str], Progress]]:
    """Show a bar on stderr for each stage of the block that runs longer than a second.

    Args:
        hidden: Show none.

    Yields:
        A callback that ends the bar before and begins that of a stage, such as ``"rendering"``; it gives a
        callback ``report(done, total)`` as :func:`progress` does.
    """
    with ExitStack() as shown:

        def begin(label: str) -> Progress:
            shown.close()
            return shown.enter_context(progress(label, hidden=hidden, counted=False))

        yield begin


@contextmanager
def compile_notice(*, hidden: bool = False) -> Iterator[None]:
    """Say one line on stderr when a kernel is really compiled inside this block, not found in the cache.

    A bar that is shown tells how many functions were compiled, as long as that goes on.
    """
    if hidden:
        yield
        return
    from numba.core import event  # here, so that --help stays fast

    own = threading.get_ident()

    class Listener(event.Listener):  # type: ignore[misc]
        told = begun = within = 0

        def on_start(self, event: Any) -> None:
            if threading.get_ident() != own:  # another thread only looks what there is
                return
            if not self.told:
                self.told = 1
                write_above(_NOTICE)
            self.begun, self.within = self.begun + 1, self.within + 1
            _add_to_bars(f"compiling, functions so far: {self.begun}")

        def on_end(self, event: Any) -> None:
            if threading.get_ident() == own:
                self.within -= 1
                if not self.within:
                    _add_to_bars("")

    with event.install_listener("numba:compile", Listener()):
        yield
