"""Tiles of a picture on a Ray cluster: each is a task; one whose worker dies is done again elsewhere."""

import contextlib
from collections.abc import Iterable, Iterator

import numpy as np

from bokehnet.cluster import as_they_end, connected
from bokehnet.scenes.tiles import RunTiles, TileTask, run_tile

__all__ = ["tiles_on_cluster"]


@contextlib.contextmanager
def tiles_on_cluster(address: str) -> Iterator[RunTiles]:
    """Give what runs tiles on a cluster.

    Workers read the scene themselves, so their machines must see the same folders. A tile that is done twice,
    since its worker died late, is the same both times.

    Args:
        address: Of a cluster that runs, as :func:`bokehnet.cluster.connected` takes it.

    Raises:
        MissingExtraError: Ray is not installed.
        ParameterError: There is no cluster at ``address``.
    """
    with connected(address, "--ray") as (ray, _):

        def run(tasks: list[TileTask]) -> Iterable[tuple[int, np.ndarray]]:
            return as_they_end(ray, _run, enumerate(tasks), len(tasks))

        yield run


def _run(task: TileTask) -> np.ndarray:
    """A tile in a worker, on one core."""
    import torch

    torch.set_num_threads(1)
    return run_tile(task)
