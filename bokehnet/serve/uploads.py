"""Request bodies: limited in size and in idle time, streamed to disk and hashed."""

import asyncio
import hashlib
import http.client
import urllib.parse
import urllib.request
from pathlib import Path
from typing import Any

from bokehnet.errors import ParameterError
from bokehnet.serve.problems import Problem

__all__ = ["BoundedBody", "fetch_url", "save_upload"]

_BLOCK_BYTES = 2**20


class BoundedBody:
    """ASGI middleware that limits the size of request bodies and the pauses in them.

    Args:
        app: Application behind the middleware.
        max_bytes: Maximum size of a body.
        timeout: Maximum time between two parts of a body, s.
        authenticate: Called with the headers before the body is read; raises ``Problem``.
        respond: Returns the ASGI response for a problem.
    """

    def __init__(self, app: Any, max_bytes: int, timeout: float, authenticate: Any, respond: Any) -> None:
        self._app, self._max_bytes, self._timeout = app, max_bytes, timeout
        self._authenticate, self._respond = authenticate, respond

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        """Handle an ASGI connection."""
        if scope["type"] != "http" or scope["method"] != "POST":
            await self._app(scope, receive, send)
            return
        received, started, problem = 0, False, None

        async def bounded() -> Any:
            nonlocal received, problem
            try:
                message = await asyncio.wait_for(receive(), self._timeout)
            except TimeoutError:
                problem = Problem("too-slow", f"expected a part of the body within {self._timeout:g} s")
                raise problem from None
            received += len(message.get("body", b""))
            if received > self._max_bytes:
                problem = Problem(
                    "too-large", f"expected at most {self._max_bytes} bytes; send smaller files"
                )
                raise problem
            return message

        async def forwarded(message: Any) -> None:
            nonlocal started
            if problem is None:  # the application's response to our own exception is discarded
                started = True
                await send(message)

        headers = dict(scope["headers"])
        length = headers.get(b"content-length", b"0")
        try:
            self._authenticate(headers)
            if length.isdigit() and int(length) > self._max_bytes:
                raise Problem("too-large", f"expected at most {self._max_bytes} bytes, found {int(length)}")
            await self._app(scope, bounded, forwarded)
        except Problem as error:
            problem = error
        except Exception:
            if problem is None:
                raise
        if problem is not None and not started:
            problem.headers["Connection"] = "close"
            await self._respond(problem)(scope, receive, send)


def save_upload(source: Any, target: Path) -> str:
    """Write an uploaded file to ``target``; return its SHA-256."""
    digest = hashlib.sha256()
    with target.open("wb") as file:
        while block := source.read(_BLOCK_BYTES):
            digest.update(block)
            file.write(block)
    return digest.hexdigest()


def fetch_url(address: str, hosts: tuple[str, ...], target: Path, max_bytes: int, timeout: float) -> str:
    """Download a signed address to ``target``; return its SHA-256.

    Only https, only allowed hosts, and no redirections.

    Raises:
        ParameterError: The address is not allowed.
        Problem: The address cannot be read, or its content is too large.
    """
    parts = urllib.parse.urlsplit(address)
    if parts.scheme != "https" or (parts.hostname or "").lower() not in hosts:
        allowed = ", ".join(f"https://{host}/" for host in hosts) or "none in this service"
        raise ParameterError("image_url", f"an address that begins with one of: {allowed}", address)
    opener = urllib.request.build_opener(_NoRedirection())
    try:
        with opener.open(address, timeout=timeout) as response, target.open("wb") as file:
            received, digest = 0, hashlib.sha256()
            while block := response.read(_BLOCK_BYTES):
                received += len(block)
                if received > max_bytes:
                    raise Problem(
                        "too-large", f"image_url: expected at most {max_bytes} bytes; send a smaller file"
                    )
                digest.update(block)
                file.write(block)
    except (OSError, ValueError, http.client.HTTPException) as error:
        raise Problem("input", f"image_url: cannot be read: {' '.join(str(error).split())}") from error
    return digest.hexdigest()


class _NoRedirection(urllib.request.HTTPRedirectHandler):
    def redirect_request(self, *words: Any, **more: Any) -> None:
        """Follow no redirection: it could lead into the internal network of the service."""
