"""A Ray cluster that runs already: connected to for as long as a block lasts."""

import contextlib
import logging
import socket
from collections.abc import Iterator
from typing import Any

from bokehnet.checks import require_extra
from bokehnet.errors import ParameterError

__all__ = ["connected"]

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


def _knock(address: str) -> None:
    """Raise ``OSError`` or ``ValueError`` if nobody listens at ``address``: Ray itself tries for minutes."""
    if address == "auto":
        return
    host, separator, port = address.removeprefix("ray://").rpartition(":")
    if not separator:
        raise ValueError("need auto, HOST:PORT or ray://HOST:PORT")
    socket.create_connection((host.strip("[]"), int(port)), timeout=_PATIENCE).close()
