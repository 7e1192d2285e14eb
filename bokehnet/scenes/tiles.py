"""Tiles: strips of rows of a large picture that other processes can trace, with identical pixels."""

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from bokehnet.errors import ConfigError
from bokehnet.raytrace.tracer import Accumulation, Tracer
from bokehnet.scenes.reader import SceneJob, read_scene

__all__ = ["RunTiles", "TileTask", "advance_tiles", "run_tile", "tile_rows"]

# Samples per pixel and round; the picture can be saved after each round.
_SAMPLES_PER_ROUND = 64

# Cached scene and tracers of this process, by scene, device and rows: a worker traces one picture.
_scenes: dict[tuple[str, str], SceneJob] = {}
_tracers: dict[tuple[str, str, tuple[int, int]], Tracer] = {}


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class TileTask:
    """Task to trace samples of a range of rows; picklable.

    Attributes:
        scene: Scene file, at a path that every process can read.
        overrides: See :func:`bokehnet.scenes.reader.read_scene`.
        digest: Digest of the scene in the process that assembles the picture.
        device: Device that traces the rays.
        rows: First row and end row.
        means: Means so far, (rows, W, 7), see ``Accumulation.stacked``.
        samples: Samples per pixel so far.
        stop: Samples per pixel after the task.
    """

    scene: Path
    overrides: Mapping[str, Any]
    digest: str
    device: str
    rows: tuple[int, int]
    means: np.ndarray
    samples: int
    stop: int


# Function that runs tasks and yields the index and the result of each, in any order.
RunTiles = Callable[[list[TileTask]], Iterable[tuple[int, np.ndarray]]]


def tile_rows(height: int, tiles: int) -> list[tuple[int, int]]:
    """Return the rows of each of ``tiles`` strips of nearly equal height; ``tiles`` is 1 to ``height``."""
    edges = [height * tile // tiles for tile in range(tiles + 1)]
    return list(itertools.pairwise(edges))


def run_tile(task: TileTask) -> np.ndarray:
    """Return the means (rows, W, 7) after the samples of a task; caches the scene for the next task.

    Raises:
        ConfigError: This process cannot read the scene, or reads a different one.
    """
    key = (task.digest, task.device)
    if key not in _scenes:
        _scenes.clear()
        _tracers.clear()
        job = read_scene(task.scene, task.overrides, task.device)
        if job.digest != task.digest:
            raise ConfigError(f"{task.scene}: differs from the scene of the process that started the picture")
        _scenes[key] = job
    if (*key, task.rows) not in _tracers:
        _tracers.clear()
        _tracers[(*key, task.rows)] = _scenes[key].tracer(task.device, task.rows)
    tracer = _tracers[(*key, task.rows)]
    film = Accumulation.from_stacked(torch.from_numpy(task.means.copy()).to(task.device), task.samples)
    while film.samples < task.stop:
        film = tracer.advance(film, task.stop)
    return np.asarray(film.stacked().cpu().numpy())


def advance_tiles(
    film: Accumulation,
    rows: list[tuple[int, int]],
    task: Callable[[tuple[int, int], np.ndarray, int, int], TileTask],
    run: RunTiles,
    samples: int,
) -> Iterator[Accumulation]:
    """Yield the picture after each round of samples, up to ``samples`` in total.

    Args:
        film: State of the picture.
        rows: Rows of each tile, from top to bottom.
        task: Function that makes a task of rows, their means, their samples and the final samples.
        run: Function that runs tasks.
        samples: Final samples per pixel.
    """
    while film.samples < samples:
        stop = min(samples, (film.samples // _SAMPLES_PER_ROUND + 1) * _SAMPLES_PER_ROUND)
        means = film.stacked().cpu().numpy()
        tasks = [task(part, means[part[0] : part[1]], film.samples, stop) for part in rows]
        updated = means.copy()
        for index, tile_means in run(tasks):
            updated[slice(*rows[index])] = tile_means
        film = Accumulation.from_stacked(torch.from_numpy(updated).to(film.bokeh.device), stop)
        yield film
