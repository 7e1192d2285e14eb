"""Prometheus metrics of a service."""

from collections.abc import Callable
from typing import Any, TypeVar

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, generate_latest

__all__ = ["Metrics"]

_BUCKETS_S = (0.05, 0.1, 0.25, 0.5, 1, 2.5, 5, 10, 30, 60, 120, 300)

_Kind = TypeVar("_Kind", Counter, Gauge, Histogram)


class Metrics:
    """Metrics of one service; the numbers of waiting and running jobs are read on each request."""

    def __init__(self, unfinished: Callable[[], tuple[int, int]]) -> None:
        self._registry = CollectorRegistry()
        self._unfinished = unfinished

        def make(kind: type[_Kind], name: str, text: str, labels: tuple[str, ...] = (), **more: Any) -> _Kind:
            return kind(f"bokehnet_{name}", text, labels, registry=self._registry, **more)

        self.accepted: Counter = make(Counter, "jobs_accepted", "New jobs.")
        self.finished: Counter = make(Counter, "jobs_finished", "Finished jobs by final state.", ("state",))
        self.duplicates: Counter = make(Counter, "jobs_doubled", "Renderings of jobs that were already done.")
        self.rejected: Counter = make(Counter, "rejected", "Rejected requests by problem.", ("problem",))
        self.deaths: Counter = make(Counter, "worker_deaths", "Workers that died while rendering a job.")
        self.render: Histogram = make(
            Histogram, "job_render_seconds", "From claim to outcome.", buckets=_BUCKETS_S
        )
        self.total: Histogram = make(
            Histogram, "job_seconds", "From acceptance to outcome.", buckets=_BUCKETS_S
        )
        self.requests: Counter = make(
            Counter, "http_requests", "Responses by method, route and status.", ("method", "route", "status")
        )
        self._waiting: Gauge = make(Gauge, "jobs_waiting", "Jobs in the queue.")
        self._running: Gauge = make(Gauge, "jobs_running", "Jobs being rendered.")
        self.memory: Gauge = make(Gauge, "worker_resident_bytes", "Memory of each worker.", ("worker",))

    def text(self) -> bytes:
        """Return the metrics in Prometheus' text format."""
        waiting, running = self._unfinished()
        self._waiting.set(waiting)
        self._running.set(running)
        text: bytes = generate_latest(self._registry)
        return text
