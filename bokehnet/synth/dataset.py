"""Writes a whole set of shards; a killed run goes on where it stopped and gives the same bytes."""

import contextlib
import functools
import json
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from bokehnet.checks import check_at_least
from bokehnet.config import build_config, check_same, dump_json, to_dict
from bokehnet.errors import ConfigError, DataFileError
from bokehnet.io.atomic import remove_leftovers, write_atomic, write_text
from bokehnet.progress import Progress, ignore_progress
from bokehnet.synth.cluster import render_on_cluster
from bokehnet.synth.config import SynthConfig
from bokehnet.synth.shards import DESCRIPTION, encode_sample, shard_name, write_members

__all__ = ["end_with_parent", "start_worker", "write_dataset"]


def write_dataset(
    config: SynthConfig,
    out_dir: str | Path,
    workers: int = 1,
    progress: Progress | None = None,
    cluster: str | None = None,
) -> None:
    """Render all scenes of ``config`` and write them as shards; shards that exist are kept.

    Args:
        config: What to make; it is also written, as ``dataset.json``.
        out_dir: Folder, made if missing. One process may write to it at a time.
        workers: Processes that render.
        progress: Called with the number of scenes that are there and that there will be.
        cluster: Address of a Ray cluster that renders in their stead; its workers may die at any time.

    Raises:
        ConfigError: The folder holds a set made with another configuration.
        DataFileError: The folder cannot be written.
        ParameterError: ``workers`` is less than 1, or there is no such cluster.
        MissingExtraError: A package is missing that rendering needs.
    """
    check_at_least("workers", workers, 1)
    folder = Path(out_dir)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        _claim(folder, config)
        remove_leftovers(folder)
        missing = [number for number in range(config.shards) if not (folder / shard_name(number)).exists()]
        wanted = [index for number in missing for index in _scenes_of(number, config)]
        make = functools.partial(_make_bytes, config)
        on = (
            render_on_cluster(make, wanted, cluster) if cluster and wanted else _render(make, wanted, workers)
        )
        with on as samples:
            _write_shards(folder, config, missing, samples, progress or ignore_progress)
    except OSError as error:
        if isinstance(error, DataFileError):
            raise
        raise DataFileError(f"cannot write data set {folder}: {error.strerror or error}") from error


def _write_shards(
    folder: Path,
    config: SynthConfig,
    missing: list[int],
    samples: Iterator[bytes],
    progress: Progress,
) -> None:
    """Write the shards ``missing`` of their ``samples``, which come in order."""
    done = config.scenes - sum(len(_scenes_of(number, config)) for number in missing)
    progress(done, config.scenes)

    def take(numbers: Iterable[int]) -> Iterator[tuple[str, bytes]]:
        nonlocal done
        for index in numbers:
            yield f"{index:08d}.npz", next(samples)
            done += 1
            progress(done, config.scenes)

    for number in missing:

        def write(temporary: Path, number: int = number) -> None:
            with temporary.open("wb") as stream:
                write_members(stream, take(_scenes_of(number, config)))

        write_atomic(folder / shard_name(number), write, error=DataFileError)


def _scenes_of(shard: int, config: SynthConfig) -> range:
    first = shard * config.scenes_per_shard
    return range(first, min(first + config.scenes_per_shard, config.scenes))


def _make_bytes(config: SynthConfig, index: int) -> bytes:
    from bokehnet.synth.pairs import make_sample  # needs torch; reading shards does not

    return encode_sample(make_sample(config, index))


@contextlib.contextmanager
def _render(make: Callable[[int], bytes], indices: list[int], workers: int) -> Iterator[Iterator[bytes]]:
    """Give ``make(index)`` in the order of ``indices``; processes end with this context or its process."""
    if workers == 1 or len(indices) < 2:
        yield map(make, indices)
        return
    executor = ProcessPoolExecutor(
        min(workers, len(indices)), multiprocessing.get_context("spawn"), initializer=start_worker
    )
    try:
        yield executor.map(make, indices)
    finally:
        executor.shutdown(wait=True, cancel_futures=True)


def start_worker() -> None:
    """Prepare a process that works for another: use one thread, leave Ctrl-C to it and do not outlive it."""
    import torch

    torch.set_num_threads(1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent()


def end_with_parent() -> None:
    """Let this process, started by ``multiprocessing``, not outlive the one that started it."""

    def watch() -> None:
        parent = multiprocessing.parent_process()
        assert parent is not None
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _claim(folder: Path, config: SynthConfig) -> None:
    """Write ``dataset.json``, or compare it with ``config`` when it is there."""
    path = folder / DESCRIPTION
    if not path.exists():
        if any(folder.glob("shard-*.tar")):
            raise ConfigError(f"{folder}: has shards but no {DESCRIPTION}; choose another folder")
        write_text(path, dump_json(config), error=DataFileError)
        return
    try:
        there = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ConfigError(f"{path}: expected a configuration as JSON: {error}") from error
    # Sets that were begun before a key was known have its default.
    there = to_dict(build_config(there, SynthConfig, str(path)))
    check_same(f"{folder}: holds a set", there, to_dict(config), "choose another folder")
