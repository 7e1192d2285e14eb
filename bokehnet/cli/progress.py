"""Progress bars for callbacks, and the notice while kernels compile."""

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

from bokehnet.progress import Progress

__all__ = ["compile_notice", "progress", "stages", "write_above"]

_DELAY = 1.0  # s before a bar appears
_INTERVAL = 1.0  # s between refreshes of a bar without a report
_LINE_INTERVAL = 30.0  # s between lines where stderr is no terminal
_BAR = "{desc}: {percentage:3.0f}%|{bar}| {elapsed}, {remaining} left{postfix}"
_NOTICE = "bokehnet: compiling kernels for this machine, once; this may take a minute"


@contextmanager
def progress(
    label: str, *, hidden: bool = False, counted: bool = True, lines: bool = False
) -> Iterator[Progress]:
    """Show a bar on stderr if the block runs longer than a second, even before the first report.

    A stderr that is no terminal, such as a log file, gets no bar, but lines on request.

    Args:
        label: Activity, such as ``"rendering"``.
        hidden: True to show nothing.
        counted: True to show counts, False to show a percentage.
        lines: True to print a line at the first report, and then at most every half minute, where stderr is
            no terminal.

    Yields:
        Callback ``report(done, total)``, with ``done`` from 0 to ``total``.
    """
    from tqdm import tqdm  # here, so that --help stays fast

    if lines and not hidden and not _stderr_is_terminal():
        yield _line_printer(label)
        return
    hidden = hidden or not _stderr_is_terminal()
    ended = threading.Event()
    with tqdm(
        desc=label,
        file=sys.stderr,
        delay=_DELAY,
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
                bar.delay = 0  # otherwise closing treats the bar as never shown
                bar.refresh()
                wait = _INTERVAL

        ticker = threading.Thread(target=tick, daemon=True)
        if not hidden:
            ticker.start()
        try:
            yield report
        finally:
            ended.set()
            if not hidden:
                ticker.join()


def _line_printer(label: str) -> Progress:
    """Return a callback that prints reports as lines, with the remaining time once it can be estimated."""
    from tqdm import tqdm

    begin: tuple[float, int] | None = None  # time and steps at the first report
    printed = 0.0

    def report(done: int, total: int) -> None:
        nonlocal begin, printed
        now, left = time.monotonic(), ""
        if begin is None:
            begin = now, done
        elif now - printed < _LINE_INTERVAL:
            return
        elif done > begin[1]:
            seconds = (now - begin[0]) * (total - done) / (done - begin[1])
            left = f", {tqdm.format_interval(seconds)} left"
        printed = now
        sys.stderr.write(f"bokehnet: {label}: {done} of {total}{left}\n")
        sys.stderr.flush()

    return report


def _stderr_is_terminal() -> bool:
    return sys.stderr.isatty()


def _add_to_bars(text: str) -> None:
    """Append a text to all visible bars, effective from their next refresh."""
    from tqdm import tqdm

    for bar in list(getattr(tqdm, "_instances", ())):
        bar.set_postfix_str(text, refresh=False)


def write_above(line: str) -> None:
    """Write a line to stderr, above any visible bar; bars that wait for their delay stay invisible."""
    from tqdm import tqdm

    bars = list(getattr(tqdm, "_instances", ()))
    if not any(bar.format_dict["elapsed"] >= bar.delay for bar in bars):
        sys.stderr.write(f"{line}\n")
        return
    tqdm.write(line, file=sys.stderr)
    for bar in bars:  # the write has made all bars visible
        bar.delay = 0


@contextmanager
def stages(*, hidden: bool = False) -> Iterator[Callable[[str], Progress]]:
    """Show one bar on stderr for each stage of the block that runs longer than a second.

    Args:
        hidden: True to show nothing.

    Yields:
        Callback that ends the previous bar and begins that of a stage, such as ``"rendering"``. It returns a
        callback ``report(done, total)`` as in :func:`progress`.
    """
    with ExitStack() as shown:

        def begin(label: str) -> Progress:
            shown.close()
            return shown.enter_context(progress(label, hidden=hidden, counted=False))

        yield begin


@contextmanager
def compile_notice(*, hidden: bool = False) -> Iterator[None]:
    """Print one line on stderr if the block compiles a kernel, i.e. does not find it in the cache.

    A visible bar shows the number of compiled functions meanwhile.
    """
    if hidden:
        yield
        return
    from numba.core import event  # here, so that --help stays fast

    own = threading.get_ident()

    class Listener(event.Listener):  # type: ignore[misc]
        notified = begun = within = 0

        def on_start(self, event: Any) -> None:
            if threading.get_ident() != own:  # other threads only probe the cache
                return
            if not self.notified:
                self.notified = 1
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
