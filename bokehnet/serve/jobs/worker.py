"""Worker process of a service: renders jobs in sequence, with a renderer that stays loaded."""

import contextlib
import math
import os
import signal
import sys
import threading
import time
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from bokehnet.errors import BokehnetError, RenderCancelled
from bokehnet.processes.limits import limit_address_space, limit_cpu_time
from bokehnet.serve.jobs.store import DamagedJob, file_sha256, read_table
from bokehnet.serve.problems import CANCELLED, Problem, problem_of

__all__ = ["WorkerLimits", "work"]

# Beyond the memory of a job: mappings of threads, kernels and networks, bytes. Beyond the time of
# a job, which the service enforces by the clock: s.
_EXTRA_ADDRESS_SPACE, _EXTRA_CPU_SECONDS = 4 * 2**30, 10.0

_PROGRESS_INTERVAL_S = 0.2


@dataclass(frozen=True, kw_only=True, slots=True)
class WorkerLimits:
    """Limits of a job: memory in bytes, time in seconds, and pixels of a picture."""

    memory: int
    seconds: float
    pixels: int


def work(pipe: Connection, threads: int, limits: WorkerLimits) -> None:
    """Render the jobs received from a pipe until it closes; main function of a worker.

    Receives ``(job folder, name of the result without its extension)``, and "cancel" at any time; sends
    ``("progress", stage, share)`` and, once for each job, ``("outcome", ...)``.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all processes; the service handles it
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(1))  # writers remove their temporary files
    import numba
    import OpenImageIO as oiio  # noqa: N813

    from bokehnet.render.renderer import BokehRenderer

    numba.set_num_threads(min(threads, numba.get_num_threads()))
    oiio.attribute("threads", threads)
    renderer = BokehRenderer(threads=threads)
    limit_address_space(limits.memory + _EXTRA_ADDRESS_SPACE)
    with contextlib.suppress(EOFError, BrokenPipeError, ConnectionResetError):
        pipe.send(("ready",))
        while True:
            task = pipe.recv()
            if task == "cancel":  # for a job that has just ended
                continue
            folder, name = task
            limit_cpu_time((limits.seconds + _EXTRA_CPU_SECONDS) * max(threads, os.cpu_count() or 1))
            pipe.send(("outcome", _outcome(pipe, renderer, Path(folder), name, limits.pixels)))


def _outcome(pipe: Connection, renderer: Any, folder: Path, name: str, max_pixels: int) -> dict[str, Any]:
    """Return the outcome of a job in the form of its store."""
    try:
        return _rendered(pipe, renderer, folder, name, max_pixels)
    except RenderCancelled:
        return {"state": "cancelled", "problem": CANCELLED.document()}
    except Problem as problem:
        return {"state": "failed", "problem": problem.document()}
    except (EOFError, BrokenPipeError, ConnectionResetError):
        raise
    except DamagedJob:
        return {"state": "damaged"}
    except Exception as error:
        if not isinstance(error, BokehnetError | MemoryError):
            import traceback

            traceback.print_exc()
        failure = problem_of(error)
        failure.detail = failure.detail.replace(f"{folder}{os.sep}", "")
        return {"state": "failed", "problem": failure.document()}


def _rendered(pipe: Connection, renderer: Any, folder: Path, name: str, max_pixels: int) -> dict[str, Any]:
    from bokehnet.render.cancellation import cancellable
    from bokehnet.render.exposure.memory_bounds import check_memory
    from bokehnet.scene.scene import read_scene
    from bokehnet.serve.requests import job_settings

    request = read_table(folder / "request.json")
    _check_inputs(folder, request)
    watch = _Watch(pipe)
    settings = job_settings(request, folder)
    image = folder / request["files"]["image"]
    for field, file in request["files"].items():
        height, width = _size(folder / file)
        if height * width > max_pixels:
            raise Problem(
                "too-many-pixels",
                f"{field}: expected at most {max_pixels} pixels, found {width}x{height}; send a smaller one",
                {"parameter": field, "max_pixels": max_pixels},
            )
    check_memory(image, settings)
    scene = read_scene(image, settings, progress=cancellable(watch.stage("reading", 0.0, 0.1), watch))
    focused = renderer.prepare(scene, settings, watch.stage("depth", 0.1, 0.35), cancel=watch)
    del scene
    result = renderer.render(
        focused, settings, watch.stage("rendering", 0.35, 0.95), cancel=watch, overwrite=True
    )
    file = f"{name}.{request['format']}"
    result.save(folder / file, watch.stage("writing", 0.95, 1.0))
    report = result.report
    return {
        "state": "done",
        "result": file,
        "result_sha256": file_sha256(folder / file),
        "report": {
            "width": result.bokeh.shape[1],
            "height": result.bokeh.shape[0],
            "engine": report.engine,
            "largest_blur_px": report.largest_blur,
            "focus_disparity": report.focus_disparity,
            "focus_distance_m": report.focus_distance,
            "repaired": report.repaired,
            "repair_reason": report.repair_reason,
            "notes": [note.replace(f"{folder}{os.sep}", "") for note in report.notes],
        },
    }


def _check_inputs(folder: Path, request: dict[str, Any]) -> None:
    """Raise ``DamagedJob`` unless the uploaded files are those that were accepted.

    Args:
        folder: Folder of the job.
        request: Its request; ``hashes`` holds the SHA-256 of each file, absent in those of earlier versions.
    """
    for field, expected in request.get("hashes", {}).items():
        try:
            is_intact = file_sha256(folder / request["files"][field]) == expected
        except (FileNotFoundError, IsADirectoryError):
            is_intact = False
        if not is_intact:
            raise DamagedJob(folder.name)


def _size(path: Path) -> tuple[int, int]:
    """Return height and width of a picture or a map, from its header."""
    from bokehnet.io.formats.heif import heif_size, is_heif
    from bokehnet.io.pixels import ImageFile

    if is_heif(path):
        return heif_size(path)
    with ImageFile(path) as file:
        return max(((part.height, part.width) for part in file.parts), key=math.prod)


class _Watch:
    """Sends progress through the pipe and receives cancellation from it."""

    def __init__(self, pipe: Connection) -> None:
        self._pipe, self._last, self._cancelled = pipe, 0.0, False
        self._lock = threading.Lock()  # writers report from several threads

    def is_set(self) -> bool:
        """Return whether the job was cancelled."""
        with self._lock:
            while not self._cancelled and self._pipe.poll():
                self._cancelled = self._pipe.recv() == "cancel"
            return self._cancelled

    def stage(self, label: str, begin: float, end: float) -> Any:
        """Return the progress callback of a stage, from the fraction ``begin`` to ``end`` of the job."""

        def report(done: int, total: int) -> None:
            now = time.monotonic()
            with self._lock:
                if now - self._last >= _PROGRESS_INTERVAL_S:
                    self._last = now
                    fraction = begin + (end - begin) * done / max(total, 1)
                    self._pipe.send(("progress", label, round(fraction, 3)))

        return report
