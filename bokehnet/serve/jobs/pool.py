"""Worker pool: one thread per worker process, which claims jobs and enforces their limits."""

import contextlib
import logging
import multiprocessing
import os
import signal
import threading
import time
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from bokehnet.serve.jobs.store import Claim, DamagedJob, JobStore
from bokehnet.serve.jobs.worker import WorkerLimits, work
from bokehnet.serve.metrics import Metrics
from bokehnet.serve.problems import Problem
from bokehnet.serve.service_settings import ServiceSettings

__all__ = ["Pool"]

_log = logging.getLogger(__name__)

# Seconds between polls of the folder, between heartbeats of a running job, and between removals of old files;
# and seconds for a cancelled job to end.
_POLL_INTERVAL_S, _HEARTBEAT_S, _CLEANUP_INTERVAL_S, _CANCEL_TIMEOUT_S = 0.25, 0.5, 30.0, 5.0

# Workers that may die on a job before the job fails.
_MAX_ATTEMPTS = 10


class Pool:
    """Workers of a service.

    Args:
        store: Job store.
        settings: Number of workers, and the limits of a job.
        metrics: Metrics of the service.
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

    @property
    def alive(self) -> bool:
        """True if all slots run, as far as they were started."""
        return all(thread.is_alive() or thread.ident is None for thread in self._threads)

    def start(self) -> None:
        """Start to claim jobs."""
        for thread in self._threads:
            thread.start()

    def wake(self) -> None:
        """Notify the workers of a new job."""
        with self._work:
            self._work.notify()

    def drain(self, seconds: float) -> None:
        """Claim no further job, give running ones this time to end, then end the workers."""
        self.draining = True
        end = time.monotonic() + seconds
        with self._work:
            self._work.notify_all()
            self._work.wait_for(lambda: not self._busy, max(0.0, end - time.monotonic()))
        self._stop.set()
        for thread in self._threads:
            if thread.ident is not None:
                thread.join(2 * _CANCEL_TIMEOUT_S)

    def _slot(self, number: int) -> None:
        worker, cleaned = _Worker(self._settings), time.monotonic()
        try:
            while not self._stop.is_set():
                if not worker.alive():
                    worker.end()
                    worker = _Worker(self._settings)
                try:
                    if number == 0 and time.monotonic() - cleaned > _CLEANUP_INTERVAL_S:
                        cleaned = time.monotonic()
                        self._store.clean()
                    claim = self._next() if worker.ready(_POLL_INTERVAL_S) else None
                except Exception:  # a full or unmounted disk, or a bug: the slot must go on
                    _log.exception("the store")
                    time.sleep(_POLL_INTERVAL_S)
                    continue
                if claim is None:
                    continue
                try:
                    self._render(worker, claim, str(number))
                except Exception:  # a bug, or a full disk: release the job for another attempt
                    _log.exception("job %s", claim.job)
                    worker.end()
                    with contextlib.suppress(OSError):  # otherwise its claim expires
                        self._store.release(claim)
                    time.sleep(_POLL_INTERVAL_S)
                finally:
                    with self._work:
                        self._busy -= 1
                        self._work.notify_all()
        finally:
            worker.end()

    def _next(self) -> Claim | None:
        """Claim a job, or wait briefly for one; ``_busy`` counts claimed jobs."""
        with self._work:
            claim = None if self.draining else self._store.claim()
            if claim is None:
                self._work.wait(_POLL_INTERVAL_S)
            else:
                self._busy += 1
            return claim

    def _render(self, worker: "_Worker", claim: Claim, label: str) -> None:
        start = time.monotonic()
        if claim.number > _MAX_ATTEMPTS:
            detail = f"{_MAX_ATTEMPTS} workers died on it; send a smaller picture"
            self._finish(claim, {"state": "failed", "problem": Problem("died", detail).document()}, start)
            return
        try:
            worker.pipe.send((str(claim.folder), f"result-{claim.number}"))
            self._finish(claim, self._wait_for_outcome(worker, claim, start, label), start)
        except (EOFError, BrokenPipeError, ConnectionResetError):
            worker.end()
            if not self._stop.is_set():
                self._metrics.deaths.inc()
            if worker.used_up_its_time():
                detail = "expected less processor time; send a smaller picture"
                self._finish(claim, {"state": "failed", "problem": Problem("time", detail).document()}, start)
                return
            self._store.release(claim)
            self.wake()

    def _wait_for_outcome(self, worker: "_Worker", claim: Claim, start: float, label: str) -> dict[str, Any]:
        """Wait for the outcome of a job, and enforce its limits."""
        limits, cancelled, progress = self._settings, 0.0, None
        while not self._stop.is_set():
            if worker.pipe.poll(_HEARTBEAT_S):
                kind, *message = worker.pipe.recv()
                if kind == "outcome":
                    outcome: dict[str, Any] = message[0]
                    return outcome
                if kind == "progress":
                    progress = {"stage": message[0], "share": message[1]}
            active = self._store.heartbeat(claim, progress)
            progress = None
            now, memory = time.monotonic(), worker.memory()
            self._metrics.memory.labels(label).set(memory)
            problem = None
            if now - start > limits.time_limit:
                problem = Problem("time", f"expected at most {limits.time_limit:g} s; send a smaller picture")
            elif memory > limits.memory_limit:
                detail = (
                    f"expected at most {limits.memory_limit} bytes, found {memory}; send a smaller picture"
                )
                problem = Problem("memory", detail)
            if problem is not None:
                worker.kill()
                return {"state": "failed", "problem": problem.document()}
            if not active and not cancelled:
                cancelled = now
                worker.pipe.send("cancel")
            if cancelled and now - cancelled > _CANCEL_TIMEOUT_S:
                worker.kill()
                return {"state": "cancelled"}
        raise EOFError  # the service is stopping: another one will claim the job

    def _finish(self, claim: Claim, outcome: dict[str, Any], start: float) -> None:
        now = time.monotonic()
        if outcome["state"] == "damaged":
            self._store.set_aside(claim.job)
            self._metrics.finished.labels("damaged").inc()
            return
        if self._store.finish(claim, outcome):
            self._metrics.finished.labels(outcome["state"]).inc()
            self._metrics.render.observe(now - start)
            self._metrics.total.observe(max(0.0, time.time() - claim.created))
            return
        if "result" in outcome:  # too late: the job was cancelled, or finished by another worker
            with contextlib.suppress(DamagedJob):
                view = self._store.view(claim.job)
                if view is not None and view["state"] == "done":
                    self._metrics.duplicates.inc()
            with contextlib.suppress(FileNotFoundError):
                (claim.folder / outcome["result"]).unlink()


class _Worker:
    """A render process."""

    def __init__(self, settings: ServiceSettings) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe: Connection
        self.pipe, child_pipe = context.Pipe()
        threads = max(1, (os.cpu_count() or 1) // max(1, settings.workers))
        limits = WorkerLimits(
            memory=settings.memory_limit, seconds=settings.time_limit, pixels=settings.max_pixels
        )
        arguments = (child_pipe, threads, limits)
        self._process = context.Process(target=work, args=arguments, daemon=True)
        self._process.start()
        self._ready = False
        child_pipe.close()  # so that the pipe closes with the process

    def alive(self) -> bool:
        """Return whether the process can accept a job."""
        return not self.pipe.closed and self._process.is_alive()

    def ready(self, seconds: float) -> bool:
        """Return whether its renderer is loaded, after waiting up to ``seconds``; only then send a job."""
        try:
            if not self._ready and self.pipe.poll(seconds):
                self._ready = self.pipe.recv() == ("ready",)
        except (EOFError, ConnectionResetError):  # it died; alive() reports it
            self._process.join()
        return self._ready

    def memory(self) -> int:
        """Return resident memory, bytes; 0 if the system does not report it."""
        try:
            pages = int(Path(f"/proc/{self._process.pid}/statm").read_text().split()[1])
        except (OSError, IndexError):
            return 0
        return pages * os.sysconf("SC_PAGE_SIZE")

    def used_up_its_time(self) -> bool:
        """Return whether the process ended at its limit of processor time."""
        return self._process.exitcode == -signal.SIGXCPU

    def kill(self) -> None:
        """Kill the process."""
        self._process.kill()
        self.end()

    def end(self) -> None:
        """Terminate the process."""
        if not self.pipe.closed:
            self.pipe.close()
        self._process.terminate()
        self._process.join()
