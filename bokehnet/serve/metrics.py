"""What a service counts, as Prometheus reads it."""

from collections.abc import Callable
from typing import Any, TypeVar

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, generate_latest

__all__ = ["Metrics"]

_SECONDS = (0.05, 0.1, 0.25, 0.5, 1, 2.5, 5, 10, 30, 60, 120, 300)

_Kind = TypeVar("_Kind", Counter, Gauge, Histogram)


class Metrics:
    """Counters of one service; jobs that wait and run are asked for when they are read."""

    def __init__(self, unfinished: Callable[[], tuple[int, int]]) -> None:
        self._registry = CollectorRegistry()
        self._unfinished = unfinished

        def made(kind: type[_Kind], name: str, text: str, labels: tuple[str, ...] = (), **more: Any) -> _Kind:
            return kind(f"bokehnet_{name}", text, labels, registry=self._registry, **more)

        self.accepted: Counter = made(Counter, "jobs_accepted", "Jobs that were new.")
        self.finished: Counter = made(Counter, "jobs_finished", "Jobs by how they ended.", ("state",))
        self.doubled: Counter = made(Counter, "jobs_doubled", "Renderings of jobs that had ended meanwhile.")
        self.rejected: Counter = made(Counter, "rejected", "Requests by the problem in answer.", ("problem",))
        self.deaths: Counter = made(Counter, "worker_deaths", "Workers that died with a job in hand.")
        self.render: Histogram = made(
            Histogram, "job_render_seconds", "From claim to outcome.", buckets=_SECONDS
        )
        self.whole: Histogram = made(
            Histogram, "job_seconds", "From acceptance to outcome.", buckets=_SECONDS
        )
        self.requests: Counter = made(
            Counter, "http_requests", "Answers by method, route and status.", ("method", "route", "status")
        )
        self._waiting: Gauge = made(Gauge, "jobs_waiting", "Jobs that nobody has begun.")
        self._running: Gauge = made(Gauge, "jobs_running", "Jobs in hand.")
        self.memory: Gauge = made(Gauge, "worker_resident_bytes", "Memory of each worker.", ("worker",))

    def text(self) -> bytes:
        """Return them in Prometheus' text format."""
        waiting, running = self._unfinished()
        self._waiting.set(waiting)
        self._running.set(running)
        text: bytes = generate_latest(self._registry)
        return text
