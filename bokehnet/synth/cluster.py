"""Rendering on a Ray cluster: every scene is a task; the task of a dead worker runs again elsewhere."""

import contextlib
from collections.abc import Callable, Iterator
from typing import Any

from bokehnet.errors import BokehnetError
from bokehnet.processes.cluster import cluster_connection, results_in_order

__all__ = ["render_on_cluster"]

# Scenes in progress per core: enough that no core is idle.
_TASKS_PER_CORE = 3


@contextlib.contextmanager
def render_on_cluster(
    make: Callable[[int], bytes], indices: list[int], address: str
) -> Iterator[Iterator[bytes]]:
    """Yield an iterator of ``make(index)`` in the order of ``indices``, computed on a cluster.

    The calling process writes all files, so workers need no shared folder; they need the same version of this
    package, and its extras "train", "trace" and "cluster".

    Args:
        make: Module-level function, or a partial of one.
        indices: Arguments of ``make``.
        address: Address of a running cluster: ``HOST:PORT`` from one of its machines, ``ray://HOST:PORT``
            from elsewhere, ``auto`` for the local cluster.

    Raises:
        MissingExtraError: Ray is not installed.
        ParameterError: There is no cluster at ``address``, or it has no cores.
        BokehnetError: Raised by ``make``.
    """
    with cluster_connection(address) as (ray, cores):
        yield _in_order(ray, make, indices, _TASKS_PER_CORE * cores)


def _in_order(ray: Any, make: Callable[[int], bytes], indices: list[int], max_tasks: int) -> Iterator[bytes]:
    """Yield the results in order, with at most ``max_tasks`` tasks in progress."""
    try:
        yield from results_in_order(ray, make, indices, max_tasks)
    except ray.exceptions.RayTaskError as error:
        if isinstance(error.cause, BokehnetError):
            raise error.cause from None
        raise
