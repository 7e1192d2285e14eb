"""Work for a Ray cluster: every scene is a task, and a task whose worker dies is done again elsewhere."""

import contextlib
from collections.abc import Callable, Iterator
from typing import Any

from bokehnet.cluster import connected, in_order
from bokehnet.errors import BokehnetError

__all__ = ["render_on_cluster"]

# Scenes under way for each core: enough that none waits for another.
_AHEAD = 3


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
    with connected(address) as (ray, cores):
        yield _in_order(ray, make, indices, _AHEAD * cores)


def _in_order(ray: Any, make: Callable[[int], bytes], indices: list[int], most: int) -> Iterator[bytes]:
    """Results in order, with at most so many tasks under way."""
    try:
        yield from in_order(ray, make, indices, most)
    except ray.exceptions.RayTaskError as error:
        if isinstance(error.cause, BokehnetError):
            raise error.cause from None
        raise
