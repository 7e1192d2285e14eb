"""Measurement of time and memory, and the test picture."""

import multiprocessing
import statistics
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import numpy as np

from bokehnet.tools.peak_memory import PeakMemory, memory_status

__all__ = [
    "extra_memory",
    "in_own_process",
    "median_seconds",
    "peak_memory",
    "processor_seconds",
    "scene",
    "time_in_turns",
]


def scene(width: int, height: int, blur: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a picture of noise with discs and stripes at several depths; the maximum radius is ``blur``."""
    rng = np.random.default_rng(0)
    image = rng.random((height, width, 3), dtype=np.float32)
    y, x = np.mgrid[:height, :width].astype(np.float32)
    disparity = 0.15 + 0.25 * y / height
    for number in range(12):
        centre = rng.random(2) * (height, width)
        inside = np.hypot(y - centre[0], x - centre[1]) < rng.uniform(0.03, 0.15) * width
        disparity = np.where(inside, 0.2 + 0.05 * number, disparity)
    defocus = blur * (disparity - 0.35) / np.abs(disparity - 0.35).max()
    return image, defocus.astype(np.float32)


def in_own_process(function: Callable[..., Any], *arguments: Any) -> Any:
    """Call ``function`` in a new process with its own memory and threads."""
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        return pool.submit(function, *arguments).result()


def time_in_turns(runs: dict[str, Callable[[], Any]], rounds: int) -> list[dict[str, float]]:
    """Return the seconds of each run in each round; runs alternate, so that all share slow periods."""
    rows = []
    for _ in range(rounds):
        row = {}
        for name, run in runs.items():
            start = time.perf_counter()
            run()
            row[name] = time.perf_counter() - start
        rows.append(row)
    return rows


def median_seconds(run: Callable[[], Any], repeats: int) -> float:
    """Return the median time of one run, seconds."""
    return statistics.median(row["run"] for row in time_in_turns({"run": run}, repeats))


def processor_seconds(run: Callable[[], Any], repeats: int = 3) -> float:
    """Return the median processor time of one run, seconds, which other programs change less than time."""
    seconds = []
    for _ in range(repeats):
        start = time.process_time()
        run()
        seconds.append(time.process_time() - start)
    return statistics.median(seconds)


def peak_memory() -> int:
    """Return the peak memory of this process so far, bytes."""
    return memory_status("VmHWM")


def extra_memory(run: Callable[[], np.ndarray]) -> int:
    """Return the peak memory of ``run`` in addition to previous memory and its result, bytes. Linux only."""
    peak = PeakMemory()
    result = run()
    assert peak.extra is not None
    return peak.extra - result.nbytes
