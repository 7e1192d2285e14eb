"""A Ray cluster that runs already: connected to for as long as a block lasts."""

import collections
import contextlib
import logging
import socket
from collections.abc import Callable, Generator, Iterable, Iterator
from typing import Any, TypeVar

from bokehnet.checks import require_extra
from bokehnet.errors import ParameterError

__all__ = ["as_they_end", "connected", "in_order"]

Given = TypeVar("Given")
Answer = TypeVar("Answer")

_PATIENCE = 10.0  # s


@contextlib.contextmanager
def connected(address: str, parameter: str = "cluster") -> Iterator[tuple[Any, int]]:
    """Give the module ``ray``, connected, and the number of the cluster's cores.

    Args:
        address: Of a cluster that runs: ``HOST:PORT`` from one of its machines, ``ray://HOST:PORT`` from
            elsewhere, ``auto`` for the one that runs here.
        parameter: What the address was given as, for errors.

    Raises:
        MissingExtraError: Ray is not installed.
        ParameterError: There is no cluster at ``address``, or no core in it.
    """
    require_extra("ray", "cluster")
    import ray

    try:
        _knock(address)
        ray.init(address=address, log_to_driver=False, logging_level=logging.ERROR)
    except (OSError, ValueError, RuntimeError, ray.exceptions.RayError) as error:
        found = " ".join(str(error).split())
        expected = "the address of a running cluster"
        raise ParameterError(parameter, expected, address, shown=f"{address!r}: {found}") from error
    try:
        cores = int(ray.cluster_resources().get("CPU", 0))
        if not cores:
            expected = f"workers with cores at {address!r}"
            raise ParameterError(parameter, expected, address, "start them", shown="none")
        yield ray, cores
    finally:
        ray.shutdown()


def as_they_end(
    ray: Any, work: Callable[[Given], Answer], tasks: Iterable[tuple[Any, Given]], most: int
) -> Generator[tuple[Any, Answer], None, None]:
    """Give the name of each task and what it came to, as tasks end; one whose worker dies is done again.

    When the caller stops, what is under way is given up.

    Args:
        ray: As :func:`connected` gives it.
        work: A function of a module.
        tasks: Name and argument of each.
        most: How many are under way at the most.
    """
    remote = _remote(ray, work)
    left, running = iter(tasks), dict[Any, Any]()
    try:
        while True:
            while len(running) < most and (task := next(left, None)) is not None:
                running[remote.remote(task[1])] = task[0]
            if not running:
                return
            done, _ = ray.wait(list(running), num_returns=1)
            for found in done:
                yield running.pop(found), ray.get(found)
    finally:
        for found in running:
            ray.cancel(found, force=True)


def in_order(
    ray: Any, work: Callable[[Given], Answer], arguments: Iterable[Given], most: int
) -> Generator[Answer, None, None]:
    """Give what tasks came to in their order, with at most so many under way; else as :func:`as_they_end`."""
    remote = _remote(ray, work)
    left, running = iter(arguments), collections.deque[Any]()
    try:
        while True:
            while len(running) < most and (argument := next(left, None)) is not None:
                running.append(remote.remote(argument))
            if not running:
                return
            yield ray.get(running.popleft())
    finally:
        for found in running:
            ray.cancel(found, force=True)


def _remote(ray: Any, work: Callable[[Given], Answer]) -> Any:
    """A task of it. Ray takes functions alone, and no partial ones."""

    def run(argument: Given) -> Answer:
        return work(argument)

    return ray.remote(num_cpus=1, max_retries=-1)(run)


def _knock(address: str) -> None:
    """Raise ``OSError`` or ``ValueError`` if nobody listens at ``address``: Ray itself tries for minutes."""
    if address == "auto":
        return
    host, separator, port = address.removeprefix("ray://").rpartition(":")
    if not separator:
        raise ValueError("need auto, HOST:PORT or ray://HOST:PORT")
    socket.create_connection((host.strip("[]"), int(port)), timeout=_PATIENCE).close()
