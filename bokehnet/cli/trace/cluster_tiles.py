"""Tiles of a picture on a Ray cluster: one task each, repeated elsewhere if its worker dies."""

import contextlib
from collections.abc import Iterable, Iterator

import numpy as np

from bokehnet.processes.cluster import cluster_connection, results_as_completed
from bokehnet.scenes.tiles import RunTiles, TileTask, run_tile

__all__ = ["tiles_on_cluster"]


@contextlib.contextmanager
def tiles_on_cluster(address: str) -> Iterator[RunTiles]:
    """Yield a function that runs tiles on a cluster.

    Workers read the scene themselves, so their machines must see the same folders. A tile that runs twice
    because its worker died gives the same result both times.

    Args:
        address: Address of a running cluster, as for :func:`bokehnet.processes.cluster.cluster_connection`.

    Raises:
        MissingExtraError: Ray is not installed.
        ParameterError: There is no cluster at ``address``.
    """
    with cluster_connection(address, "--ray") as (ray, _):

        def run(tasks: list[TileTask]) -> Iterable[tuple[int, np.ndarray]]:
            return results_as_completed(ray, _run, enumerate(tasks), len(tasks))

        yield run


def _run(task: TileTask) -> np.ndarray:
    """Run a tile in a worker, on one core."""
    import torch

    torch.set_num_threads(1)
    return run_tile(task)
