"""Connection to a running Ray cluster, and iteration over the results of tasks on it."""

import collections
import contextlib
import logging
import socket
from collections.abc import Callable, Generator, Iterable, Iterator
from typing import Any, TypeVar

from bokehnet.checks import require_extra
from bokehnet.errors import ParameterError

__all__ = ["cluster_connection", "results_as_completed", "results_in_order"]

Argument = TypeVar("Argument")
Result = TypeVar("Result")

_CONNECT_TIMEOUT = 10.0  # s


@contextlib.contextmanager
def cluster_connection(address: str, parameter: str = "cluster") -> Iterator[tuple[Any, int]]:
    """Yield the connected module ``ray`` and the number of cores of the cluster.

    Args:
        address: Address of a running cluster: ``HOST:PORT`` from one of its machines, ``ray://HOST:PORT``
            from elsewhere, ``auto`` for a local one.
        parameter: Name of the address in errors.

    Raises:
        MissingExtraError: Ray is not installed.
        ParameterError: There is no cluster at ``address``, or it has no cores.
    """
    require_extra("ray", "cluster")
    import ray

    try:
        _check_reachable(address)
        ray.init(address=address, log_to_driver=False, logging_level=logging.ERROR)
    except (OSError, ValueError, RuntimeError, ray.exceptions.RayError) as error:
        reason = " ".join(str(error).split())
        expected = "the address of a running cluster"
        raise ParameterError(parameter, expected, address, shown=f"{address!r}: {reason}") from error
    try:
        cores = int(ray.cluster_resources().get("CPU", 0))
        if not cores:
            expected = f"workers with cores at {address!r}"
            raise ParameterError(parameter, expected, address, "start them", shown="none")
        yield ray, cores
    finally:
        ray.shutdown()


def results_as_completed(
    ray: Any, work: Callable[[Argument], Result], tasks: Iterable[tuple[Any, Argument]], max_running: int
) -> Generator[tuple[Any, Result], None, None]:
    """Yield name and result of each task on completion; repeat a task if its worker dies.

    When the caller stops, running tasks are cancelled.

    Args:
        ray: Module yielded by :func:`cluster_connection`.
        work: Module-level function.
        tasks: Name and argument of each task.
        max_running: Maximum number of tasks that run at the same time.
    """
    remote = _remote(ray, work)
    remaining, running = iter(tasks), dict[Any, Any]()
    try:
        while True:
            while len(running) < max_running and (task := next(remaining, None)) is not None:
                running[remote.remote(task[1])] = task[0]
            if not running:
                return
            done, _ = ray.wait(list(running), num_returns=1)
            for task_id in done:
                yield running.pop(task_id), ray.get(task_id)
    finally:
        for task_id in running:
            ray.cancel(task_id, force=True)


def results_in_order(
    ray: Any, work: Callable[[Argument], Result], arguments: Iterable[Argument], max_running: int
) -> Generator[Result, None, None]:
    """Yield the results in the order of the tasks; otherwise as :func:`results_as_completed`."""
    remote = _remote(ray, work)
    remaining, running = iter(arguments), collections.deque[Any]()
    try:
        while True:
            while len(running) < max_running and (argument := next(remaining, None)) is not None:
                running.append(remote.remote(argument))
            if not running:
                return
            yield ray.get(running.popleft())
    finally:
        for task_id in running:
            ray.cancel(task_id, force=True)


def _remote(ray: Any, work: Callable[[Argument], Result]) -> Any:
    """Return a remote function; Ray accepts neither methods nor partial functions."""

    def run(argument: Argument) -> Result:
        return work(argument)

    return ray.remote(num_cpus=1, max_retries=-1)(run)


def _check_reachable(address: str) -> None:
    """Raise ``OSError`` or ``ValueError`` if ``address`` is unreachable: Ray itself retries for minutes."""
    if address == "auto":
        return
    host, separator, port = address.removeprefix("ray://").rpartition(":")
    if not separator:
        raise ValueError("need auto, HOST:PORT or ray://HOST:PORT")
    socket.create_connection((host.strip("[]"), int(port)), timeout=_CONNECT_TIMEOUT).close()
