"""Work for a Ray cluster: every scene is a task, and a task whose worker dies is done again elsewhere."""

import collections
import contextlib
import logging
import socket
from collections.abc import Callable, Iterator
from typing import Any

from bokehnet.checks import require_extra
from bokehnet.errors import BokehnetError, ParameterError

__all__ = ["render_on_cluster"]

# Scenes under way for each core: enough that none waits for another.
_AHEAD = 3
_PATIENCE = 10.0  # s


@contextlib.contextmanager
def render_on_cluster(
    make: Callable[[int], bytes], indices: list[int], address: str
) -> Iterator[Iterator[bytes]]:
    """Give ``make(index)`` in the order of ``indices``, computed by the workers of a cluster.

    All files are written by the process that asks, so workers need no common folder; they need the same
    version of this package, and its extras "train", "trace" and "cluster".

    Args:
        make: A function of a module, or a partial of one.
        indices: Its arguments.
        address: Of a cluster that runs: ``HOST:PORT`` from one of its machines, ``ray://HOST:PORT`` from
            elsewhere, ``auto`` for the one that runs here.

    Raises:
        MissingExtraError: Ray is not installed.
        ParameterError: There is no cluster at ``address``, or no core in it.
        BokehnetError: What ``make`` raised.
    """
    require_extra("ray", "cluster")
    import ray

    try:
        _knock(address)
        ray.init(address=address, log_to_driver=False, logging_level=logging.ERROR)
    except (OSError, ValueError, RuntimeError, ray.exceptions.RayError) as error:
        found = " ".join(str(error).split())
        expected = "the address of a running cluster"
        raise ParameterError("cluster", expected, address, shown=f"{address!r}: {found}") from error
    try:
        cores = int(ray.cluster_resources().get("CPU", 0))
        if not cores:
            expected = f"workers with cores at {address!r}"
            raise ParameterError("cluster", expected, address, "start them", shown="none")
        yield _in_order(ray, make, indices, _AHEAD * cores)
    finally:
        ray.shutdown()


def _knock(address: str) -> None:
    """Raise ``OSError`` or ``ValueError`` if nobody listens at ``address``: Ray itself tries for minutes."""
    if address == "auto":
        return
    host, separator, port = address.removeprefix("ray://").rpartition(":")
    if not separator:
        raise ValueError("need auto, HOST:PORT or ray://HOST:PORT")
    socket.create_connection((host.strip("[]"), int(port)), timeout=_PATIENCE).close()


def _in_order(ray: Any, make: Callable[[int], bytes], indices: list[int], most: int) -> Iterator[bytes]:
    """Results in order, with at most so many tasks under way."""
    task = ray.remote(num_cpus=1, max_retries=-1)(_call)
    waiting: collections.deque[Any] = collections.deque()
    left = iter(indices)
    while True:
        while len(waiting) < most and (index := next(left, None)) is not None:
            waiting.append(task.remote(make, index))
        if not waiting:
            return
        try:
            yield ray.get(waiting.popleft())
        except ray.exceptions.RayTaskError as error:
            if isinstance(error.cause, BokehnetError):
                raise error.cause from None
            raise


def _call(make: Callable[[int], bytes], index: int) -> bytes:
    return make(index)
