"""Who renders: a thread for each worker process, which claims jobs and watches over their limits."""

import contextlib
import logging
import multiprocessing
import os
import threading
import time
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from bokehnet.serve.metrics import Metrics
from bokehnet.serve.problems import Problem
from bokehnet.serve.service_settings import ServiceSettings
from bokehnet.serve.store import Claim, JobStore
from bokehnet.serve.worker import work

__all__ = ["Pool"]

_log = logging.getLogger(__name__)

# Seconds: between looks at the folder, at a running job, and at what is old; and for a cancelled job to end.
_LOOK, _BEAT, _CLEAN, _GRACE = 0.25, 0.5, 30.0, 5.0

# Workers that may die of a job before it counts as its fault.
_ATTEMPTS = 10


class Pool:
    """The workers of a service.

    Args:
        store: Where jobs are.
        settings: How many, and the limits of a job.
        metrics: What happens is counted there.
    """

    def __init__(self, store: JobStore, settings: ServiceSettings, metrics: Metrics) -> None:
        self._store, self._settings, self._metrics = store, settings, metrics
        self._stop, self._work = threading.Event(), threading.Condition()
        self._busy = 0
        self._threads = [
            threading.Thread(target=self._slot, args=(number,), daemon=True, name=f"slot-{number}")
            for number in range(settings.workers)
        ]
        self.draining = False

    def start(self) -> None:
        """Begin to take jobs."""
        for thread in self._threads:
            thread.start()

    def wake(self) -> None:
        """Say that a job has come."""
        with self._work:
            self._work.notify()

    def drain(self, seconds: float) -> None:
        """Take no further job, let the running ones end for so long, then end the workers."""
        self.draining = True
        end = time.monotonic() + seconds
        with self._work:
            self._work.notify_all()
            self._work.wait_for(lambda: not self._busy, max(0.0, end - time.monotonic()))
        self._stop.set()
        for thread in self._threads:
            if thread.ident is not None:
                thread.join(2 * _GRACE)

    def _slot(self, number: int) -> None:
        worker, cleaned = _Worker(self._settings), time.monotonic()
        try:
            while not self._stop.is_set():
                if not worker.alive():
                    worker.end()
                    worker = _Worker(self._settings)
                try:
                    if number == 0 and time.monotonic() - cleaned > _CLEAN:
                        cleaned = time.monotonic()
                        self._store.clean()
                    claim = self._next() if worker.ready(_LOOK) else None
                except OSError:  # a full disk, or one that is away: looked at again
                    _log.exception("the store")
                    time.sleep(_LOOK)
                    continue
                if claim is None:
                    continue
                try:
                    self._render(worker, claim, str(number))
                except Exception:  # a bug, or a full disk: the job is tried again, the worker goes on
                    _log.exception("job %s", claim.job)
                    worker.end()
                    with contextlib.suppress(OSError):  # else its claim grows old
                        self._store.release(claim)
                    time.sleep(_LOOK)
                finally:
                    with self._work:
                        self._busy -= 1
                        self._work.notify_all()
        finally:
            worker.end()

    def _next(self) -> Claim | None:
        """Take a job, or wait a little for one; ``_busy`` counts it."""
        with self._work:
            claim = None if self.draining else self._store.claim()
            if claim is None:
                self._work.wait(_LOOK)
            else:
                self._busy += 1
            return claim

    def _render(self, worker: "_Worker", claim: Claim, label: str) -> None:
        begun = time.monotonic()
        if claim.number > _ATTEMPTS:
            detail = f"{_ATTEMPTS} workers died of it; send a smaller picture"
            self._ended(claim, {"state": "failed", "problem": Problem("died", detail).document()}, begun)
            return
        try:
            worker.pipe.send((str(claim.folder), f"result-{claim.number}"))
            self._ended(claim, self._watched(worker, claim, begun, label), begun)
        except (EOFError, BrokenPipeError, ConnectionResetError):
            worker.end()
            if not self._stop.is_set():
                self._metrics.deaths.inc()
            self._store.release(claim)
            self.wake()

    def _watched(self, worker: "_Worker", claim: Claim, begun: float, label: str) -> dict[str, Any]:
        """Wait for the outcome of a job, and see to its limits."""
        limits, cancelled, progress = self._settings, 0.0, None
        while not self._stop.is_set():
            if worker.pipe.poll(_BEAT):
                kind, *told = worker.pipe.recv()
                if kind == "outcome":
                    outcome: dict[str, Any] = told[0]
                    return outcome
                if kind == "progress":
                    progress = {"stage": told[0], "share": told[1]}
            wanted = self._store.beat(claim, progress)
            progress = None
            now, memory = time.monotonic(), worker.memory()
            self._metrics.memory.labels(label).set(memory)
            problem = None
            if now - begun > limits.time_limit:
                problem = Problem("time", f"expected at most {limits.time_limit:g} s; send a smaller picture")
            elif memory > limits.memory_limit:
                detail = (
                    f"expected at most {limits.memory_limit} bytes, found {memory}; send a smaller picture"
                )
                problem = Problem("memory", detail)
            if problem is not None:
                worker.kill()
                return {"state": "failed", "problem": problem.document()}
            if not wanted and not cancelled:
                cancelled = now
                worker.pipe.send("cancel")
            if cancelled and now - cancelled > _GRACE:
                worker.kill()
                return {"state": "cancelled"}
        raise EOFError  # the service ends: another one will take the job

    def _ended(self, claim: Claim, outcome: dict[str, Any], begun: float) -> None:
        now = time.monotonic()
        if self._store.finish(claim, outcome):
            self._metrics.finished.labels(outcome["state"]).inc()
            self._metrics.render.observe(now - begun)
            self._metrics.whole.observe(max(0.0, time.time() - claim.created))
            return
        if "result" in outcome:  # too late: the job was cancelled, or another worker has done it, too
            told = self._store.view(claim.job)
            if told is not None and told["state"] == "done":
                self._metrics.doubled.inc()
            with contextlib.suppress(FileNotFoundError):
                (claim.folder / outcome["result"]).unlink()


class _Worker:
    """A process that renders."""

    def __init__(self, settings: ServiceSettings) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe: Connection
        self.pipe, theirs = context.Pipe()
        threads = max(1, (os.cpu_count() or 1) // max(1, settings.workers))
        self._process = context.Process(target=work, args=(theirs, threads, settings.max_pixels), daemon=True)
        self._process.start()
        self._ready = False
        theirs.close()  # so that the pipe ends with the process

    def alive(self) -> bool:
        """Whether it can be given a job."""
        return not self.pipe.closed and self._process.is_alive()

    def ready(self, seconds: float) -> bool:
        """Whether its renderer is there; waited for so long. No job is in its hands before."""
        try:
            if not self._ready and self.pipe.poll(seconds):
                self._ready = self.pipe.recv() == ("ready",)
        except (EOFError, ConnectionResetError):  # it died; alive() will tell
            self._process.join()
        return self._ready

    def memory(self) -> int:
        """Resident bytes; 0 where the system does not tell."""
        try:
            pages = int(Path(f"/proc/{self._process.pid}/statm").read_text().split()[1])
        except (OSError, IndexError):
            return 0
        return pages * os.sysconf("SC_PAGE_SIZE")

    def kill(self) -> None:
        """End it at once."""
        self._process.kill()
        self.end()

    def end(self) -> None:
        """Let it end."""
        if not self.pipe.closed:
            self.pipe.close()
        self._process.terminate()
        self._process.join()
