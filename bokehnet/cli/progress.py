"""A progress bar for callbacks."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

__all__ = ["progress"]

_DELAY = 1.0  # s: what is done sooner needs no bar
_LOG_INTERVAL = 10.0  # s between lines when stderr is not a terminal


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
