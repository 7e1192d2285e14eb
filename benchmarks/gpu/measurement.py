"""Measurement on a CUDA device: report, agreement with the CPU, peak memory, and time inside ray marching."""

import json
import math
import threading
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch

from bokehnet.classical.cuda.march import cuda

__all__ = ["DeviceMemory", "Report", "TimedMarch", "agreement", "synchronize"]

# Differences above which a pixel is counted, scene-linear.
LIMITS = (1e-5, 1e-3, 1e-2)


class Report:
    """Rows of the table, printed and written one by one.

    Args:
        folder: Folder for ``cuda.json``; ``None`` to write no file.
        seconds: Time after which the remaining cases are skipped, seconds.
    """

    def __init__(self, folder: Path | None, seconds: float) -> None:
        self._folder, self._end = folder, time.monotonic() + seconds
        self.content: dict[str, Any] = {"rows": []}

    def add(self, part: str, name: str, megapixels: float, measure: Callable[[], dict[str, Any]]) -> None:
        """Measure a case, print its row and store it; a failure is stored with its traceback."""
        row: dict[str, Any] = {"part": part, "case": name, "megapixels": megapixels}
        if time.monotonic() > self._end:
            row["left_out"] = "no time left"
        else:
            try:
                row |= measure()
            except Exception as error:
                row |= {"failure": f"{type(error).__name__}: {error}", "traceback": traceback.format_exc()}
        self.content["rows"].append(row)
        print(_line(row), flush=True)
        self.write()

    def write(self) -> None:
        """Write the rows so far."""
        if self._folder is not None:
            self._folder.mkdir(parents=True, exist_ok=True)
            (self._folder / "cuda.json").write_text(json.dumps(self.content, indent=1) + "\n", "utf-8")


def _line(row: dict[str, Any]) -> str:
    """Return one line of the table."""
    start = f"{row['part']:9s} {row['case']:26s} {row['megapixels']:6.2f} MP "
    if "failure" in row:
        return start + f"FAILED {row['failure'].splitlines()[0][:150]}"
    if "left_out" in row:
        return start + row["left_out"]
    parts = [f"{row['psnr_db']:5.0f} dB, max {row['max_difference']:.1e}, {row['differing'][1]} px > 1e-3"]
    if "device_s" in row:
        copies = f" ({1000 * row['copies_s']:.1f} copies)" if "copies_s" in row else ""
        parts.append(f"{1000 * row['device_s']:.1f} ms{copies}")
    if "cpu_s" in row:
        parts.append(f"CPU {1000 * row['cpu_s']:.0f} ms")
    if "peak_mb" in row:
        parts.append(f"{row['peak_mb']:.0f} MB")
    return start + "; ".join(parts) + ("" if row.get("repeatable", True) else "; DIFFERS FROM RUN TO RUN")


def agreement(on_device: np.ndarray, on_cpu: np.ndarray) -> dict[str, Any]:
    """Compare a picture from the device with that from the CPU.

    Returns:
        PSNR in dB for a peak of 1, largest absolute difference, largest difference relative to max(light, 1),
        and number of pixels whose difference in any channel exceeds each of ``LIMITS``.
    """
    difference = np.abs(on_device.astype(float) - on_cpu)
    max_over_channels = difference.reshape(*difference.shape[:2], -1).max(-1)
    return {
        "psnr_db": -10 * math.log10(max(float(np.mean(difference**2)), 1e-30)),
        "max_difference": float(difference.max()),
        "max_relative": float((difference / np.maximum(np.abs(on_cpu), 1)).max()),
        "differing": [int(np.count_nonzero(~(max_over_channels <= limit))) for limit in LIMITS],
        "pixels": int(max_over_channels.size),
    }


class DeviceMemory:
    """Peak memory of the whole device above that at the start, bytes, sampled while the context is open."""

    def __enter__(self) -> "DeviceMemory":
        self.peak, self._stop = 0, threading.Event()
        if torch.cuda.is_available():
            torch.cuda.synchronize()
            torch.cuda.empty_cache()
        self._before = self._used()
        self._thread = threading.Thread(target=self._watch)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    def _watch(self) -> None:
        while not self._stop.wait(0.002):
            self.peak = max(self.peak, self._used() - self._before)

    @staticmethod
    def _used() -> int:
        if not torch.cuda.is_available():
            return 0
        free, total = torch.cuda.mem_get_info()
        return total - free


def synchronize() -> None:
    """Wait for the device if there is one."""
    if torch.cuda.is_available():
        torch.cuda.synchronize()


class TimedMarch:
    """Ray marching function that measures its calls.

    Args:
        march: Function for ``send`` of :func:`bokehnet.classical.layered.march.ray_marching.march`.

    Attributes:
        seconds: Time inside all calls.
        renders: Number of rendered pictures.
        copied: Time of the copies between host and device, seconds.
        bytes: Size of the copies.
    """

    def __init__(self, march: Callable[..., None]) -> None:
        self._march = march
        self.reset()

    def reset(self, copies: bool = False) -> None:
        """Reset all counters; with ``copies``, repeat and time the copies to and from the device."""
        self._copies = copies
        self.renders, self.seconds, self.copied, self.bytes = 0, 0.0, 0.0, 0

    def __call__(self, *arguments: Any) -> None:
        """Trace rays."""
        colors, cells, mask, bins, points, chances, weights = arguments[:7]
        counts, sums = arguments[-2:]
        is_new = arguments[-4] == arguments[-3] == 0  # first row and first ray of the call
        self.renders += is_new
        if self._copies:
            means, kept = cuda.device_array(sums.shape, sums.dtype), np.array(sums)
            sent = [counts, *((colors, cells, mask, *bins[:3], points, chances, weights) if is_new else ())]
            start = time.perf_counter()
            copies = [cuda.to_device(array) for array in sent]
            means.copy_to_host(kept)
            self.copied += time.perf_counter() - start
            self.bytes += sums.nbytes + sum(array.nbytes for array in sent)
            del copies
        start = time.perf_counter()
        self._march(*arguments)
        self.seconds += time.perf_counter() - start
