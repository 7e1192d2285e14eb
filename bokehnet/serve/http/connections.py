"""Bounds on connections: their number, and the time until a request has arrived."""

import asyncio
from typing import Any

__all__ = ["MAX_CONNECTIONS", "REQUEST_SECONDS", "bounded_protocol"]

MAX_CONNECTIONS, REQUEST_SECONDS = 512, 10.0
"""Open connections of a service, and time for the head of a request to arrive, s."""


def bounded_protocol(base: Any, max_connections: int, seconds: float) -> Any:
    """Return a protocol class of the HTTP server whose connections are bounded.

    A connection without a complete request head is closed after ``seconds``. Above ``max_connections`` the
    oldest of these is closed for the new one; if all are busy with requests, the new one is closed.

    Args:
        base: Protocol class of uvicorn.
        max_connections: Maximum number of open connections.
        seconds: Time for the head of a request to arrive, from the connection or the previous response.
    """
    waiting: dict[Any, asyncio.TimerHandle] = {}  # in order of their beginning

    class BoundedProtocol(base):  # type: ignore[misc]
        """Connection with a deadline for its next request."""

        _last: Any = None  # request that has arrived

        def connection_made(self, transport: Any) -> None:
            super().connection_made(transport)
            if len(self.connections) > max_connections:
                oldest = next(iter(waiting), self)
                oldest._forget()
                oldest.transport.abort()
                if oldest is self:
                    return
            self._await_request()

        def data_received(self, data: bytes) -> None:
            super().data_received(data)
            self._note_request()

        def on_response_complete(self) -> None:
            self._await_request()
            super().on_response_complete()
            self._note_request()

        def connection_lost(self, exc: Exception | None) -> None:
            self._forget()
            super().connection_lost(exc)

        def _await_request(self) -> None:
            self._forget()
            waiting[self] = self.loop.call_later(seconds, self._expire)

        def _note_request(self) -> None:
            if self.cycle is not self._last:
                self._last = self.cycle
                if not getattr(self.cycle, "response_complete", True):
                    self._forget()

        def _forget(self) -> None:
            timer = waiting.pop(self, None)
            if timer is not None:
                timer.cancel()

        def _expire(self) -> None:
            self._forget()
            self.transport.abort()

    return BoundedProtocol
