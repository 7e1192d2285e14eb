"""Writer of whole sets of shards; a killed run resumes and writes the same bytes."""

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

from bokehnet.checks import check_at_least, require_extra
from bokehnet.config import build_config, check_same, dump_json, to_dict
from bokehnet.errors import ConfigError, DataFileError
from bokehnet.io.files.atomic import remove_leftovers, write_atomic, write_text
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
    """Render all scenes of ``config`` and write them as shards; existing shards are kept.

    Args:
        config: Configuration of the set; also written as ``dataset.json``.
        out_dir: Folder of the set; created if missing. Only one process may write to it at a time.
        workers: Number of processes that render.
        progress: Called with the number of finished scenes and the total number.
        cluster: Address of a Ray cluster that renders instead; its workers may die at any time.

    Raises:
        ConfigError: The folder holds a set made with another configuration.
        DataFileError: The folder cannot be written.
        ParameterError: ``workers`` is below 1, or there is no such cluster.
        MissingExtraError: A package that rendering needs is missing.
    """
    check_at_least("workers", workers, 1)
    if cluster is None:
        require_extra("torch", "train")
    folder = Path(out_dir)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        _claim(folder, config)
        remove_leftovers(folder)
        missing = [number for number in range(config.shards) if not (folder / shard_name(number)).exists()]
        pending = [index for number in missing for index in _scenes_of(number, config)]
        make = functools.partial(_make_bytes, config)
        renderer = (
            render_on_cluster(make, pending, cluster)
            if cluster and pending
            else _render(make, pending, workers)
        )
        with renderer as samples:
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
    """Write the shards ``missing`` from ``samples``, which arrive in order."""
    done = config.scenes - sum(len(_scenes_of(number, config)) for number in missing)
    progress(done, config.scenes)

    def members(numbers: Iterable[int]) -> Iterator[tuple[str, bytes]]:
        nonlocal done
        for index in numbers:
            yield f"{index:08d}.npz", next(samples)
            done += 1
            progress(done, config.scenes)

    for number in missing:

        def write(temporary: Path, number: int = number) -> None:
            with temporary.open("wb") as stream:
                write_members(stream, members(_scenes_of(number, config)))

        write_atomic(folder / shard_name(number), write, error=DataFileError)


def _scenes_of(shard: int, config: SynthConfig) -> range:
    first = shard * config.scenes_per_shard
    return range(first, min(first + config.scenes_per_shard, config.scenes))


def _make_bytes(config: SynthConfig, index: int) -> bytes:
    from bokehnet.synth.pairs import make_sample  # needs torch; reading shards does not

    return encode_sample(make_sample(config, index))


@contextlib.contextmanager
def _render(make: Callable[[int], bytes], indices: list[int], workers: int) -> Iterator[Iterator[bytes]]:
    """Yield an iterator of ``make(index)`` in order; worker processes end with this context."""
    if workers == 1 or len(indices) < 2:
        from bokehnet.raytrace.threads import one_torch_thread

        with one_torch_thread():
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
    """Prepare a worker process: single-threaded, without handling of Ctrl-C, and ending with its parent."""
    import torch

    torch.set_num_threads(1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent()


def end_with_parent() -> None:
    """End this process, started by ``multiprocessing``, when its parent ends."""

    def watch() -> None:
        parent = multiprocessing.parent_process()
        assert parent is not None
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _claim(folder: Path, config: SynthConfig) -> None:
    """Write ``dataset.json``, or compare an existing one with ``config``."""
    path = folder / DESCRIPTION
    if not path.exists():
        if any(folder.glob("shard-*.tar")):
            raise ConfigError(f"{folder}: has shards but no {DESCRIPTION}; choose another folder")
        write_text(path, dump_json(config), error=DataFileError)
        return
    try:
        existing = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ConfigError(f"{path}: expected a configuration as JSON: {error}") from error
    # Sets from before a key existed have its default.
    existing = to_dict(build_config(existing, SynthConfig, str(path)))
    check_same(f"{folder}: holds a set", existing, to_dict(config), "choose another folder")
