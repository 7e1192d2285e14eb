"""How time and memory are measured, and the pictures they are measured on."""

import multiprocessing
import statistics
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import numpy as np

from bokehnet.tools.peak_memory import PeakMemory, memory_status

__all__ = ["extra_memory", "in_own_process", "median_seconds", "peak_memory", "scene", "time_in_turns"]


def scene(width: int, height: int, blur: float) -> tuple[np.ndarray, np.ndarray]:
    """Noise behind discs and stripes at several depths; the largest radius is ``blur``."""
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
    """Call ``function`` in a fresh process, whose memory and threads nothing else has touched."""
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        return pool.submit(function, *arguments).result()


def time_in_turns(runs: dict[str, Callable[[], Any]], rounds: int) -> list[dict[str, float]]:
    """Seconds of each run in each round; all take turns, so that a slow moment of the machine hits all."""
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
    """Median time of one run."""
    return statistics.median(row["run"] for row in time_in_turns({"run": run}, repeats))


def peak_memory() -> int:
    """Most memory this process has held so far, bytes."""
    return memory_status("VmHWM")


def extra_memory(run: Callable[[], np.ndarray]) -> int:
    """Bytes that ``run`` held at its peak beyond what was there before and beyond its result. Linux only."""
    peak = PeakMemory()
    result = run()
    assert peak.extra is not None
    return peak.extra - result.nbytes
