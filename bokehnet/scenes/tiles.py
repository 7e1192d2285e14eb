"""A large picture in tiles, strips of rows, that can be traced anywhere: pixels are those of the whole."""

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

# Samples of a pixel that a tile gets at a time; what is there can be kept after each such round.
_ROUND = 64

# Scene and tracers of this process, by scene, device and rows: a worker traces one picture.
_scenes: dict[tuple[str, str], SceneJob] = {}
_tracers: dict[tuple[str, str, tuple[int, int]], Tracer] = {}


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class TileTask:
    """Some samples of some rows; can be sent to another process.

    Attributes:
        scene: Scene file, a path that every process sees.
        overrides: See :func:`bokehnet.scenes.reader.read_scene`.
        digest: Of the scene as it was read where the picture is put together.
        device: Where rays are followed.
        rows: First row, and the row after the last.
        means: So far, (rows, W, 7), see ``Accumulation.stacked``.
        samples: So far.
        stop: How many there shall be.
    """

    scene: Path
    overrides: Mapping[str, Any]
    digest: str
    device: str
    rows: tuple[int, int]
    means: np.ndarray
    samples: int
    stop: int


# Runs tasks anywhere, and yields the index of each and what came out, in any order.
RunTiles = Callable[[list[TileTask]], Iterable[tuple[int, np.ndarray]]]


def tile_rows(height: int, tiles: int) -> list[tuple[int, int]]:
    """Rows of each of ``tiles`` strips of nearly one height, 1 to ``height`` of them."""
    edges = [height * tile // tiles for tile in range(tiles + 1)]
    return list(itertools.pairwise(edges))


def run_tile(task: TileTask) -> np.ndarray:
    """Means (rows, W, 7) after the samples of a task; the scene stays ready for the next one.

    Raises:
        ConfigError: The scene cannot be read here, or is another one here.
    """
    key = (task.digest, task.device)
    if key not in _scenes:
        _scenes.clear()
        _tracers.clear()
        job = read_scene(task.scene, task.overrides, task.device)
        if job.digest != task.digest:
            raise ConfigError(f"{task.scene}: is another scene here than where the picture was begun")
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
    """Yield the picture after each round of samples, up to ``samples`` in all.

    Args:
        film: So far.
        rows: Of each tile, from top to bottom.
        task: Makes a task of rows, their means, their samples and where to stop.
        run: Runs tasks.
        samples: How many there shall be.
    """
    while film.samples < samples:
        stop = min(samples, (film.samples // _ROUND + 1) * _ROUND)
        means = film.stacked().cpu().numpy()
        tasks = [task(part, means[part[0] : part[1]], film.samples, stop) for part in rows]
        after = means.copy()
        for index, found in run(tasks):
            after[slice(*rows[index])] = found
        film = Accumulation.from_stacked(torch.from_numpy(after).to(film.bokeh.device), stop)
        yield film
