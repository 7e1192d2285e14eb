"""Request bodies: limited in size and in idle time, streamed to disk and hashed."""

import asyncio
import hashlib
import http.client
import logging
import time
import urllib.parse
import urllib.request
from pathlib import Path
from typing import Any

from bokehnet.errors import ParameterError
from bokehnet.serve.problems import Problem

__all__ = ["BoundedBody", "fetch_url", "save_upload"]

_BLOCK_BYTES = 2**20

# Uploads at once, and time of a whole upload in units of the longest pause.
_MAX_UPLOADS, _MAX_PAUSES = 32, 10
_UPLOADING = "bokehnet.uploading"

_HTTPS_PORT = 443
_log = logging.getLogger(__name__)


class BoundedBody:
    """ASGI middleware that limits request bodies: their number at once, size, pauses and time.

    Args:
        app: Application behind the middleware.
        max_bytes: Maximum size of a body.
        timeout: Maximum time between two parts of a body, s; the whole may take ten times as long.
        admit: Called with the headers before the body is read; raises ``Problem``.
        respond: Returns the ASGI response for a problem.
    """

    def __init__(self, app: Any, max_bytes: int, timeout: float, admit: Any, respond: Any) -> None:
        self._app, self._max_bytes, self._timeout = app, max_bytes, timeout
        self._admit, self._respond = admit, respond
        self._uploads = 0

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        """Handle an ASGI connection."""
        if scope["type"] != "http" or scope["method"] != "POST":
            await self._app(scope, receive, send)
            return
        received, started, problem = 0, False, None
        end = time.monotonic() + _MAX_PAUSES * self._timeout

        async def bounded() -> Any:
            nonlocal received, problem
            remaining = min(self._timeout, end - time.monotonic())
            try:
                message = await asyncio.wait_for(receive(), max(remaining, 0.001))
            except TimeoutError:
                detail = f"expected a part of the body within {self._timeout:g} s, and all of it within "
                problem = Problem("too-slow", f"{detail}{_MAX_PAUSES * self._timeout:g} s")
                raise problem from None
            if not message.get("more_body", False):
                self._end_upload(scope)
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
            self._admit(headers)
            self._begin_upload(scope)
            if length.isdigit() and int(length) > self._max_bytes:
                raise Problem("too-large", f"expected at most {self._max_bytes} bytes, found {int(length)}")
            await self._app(scope, bounded, forwarded)
        except Problem as error:
            problem = error
        except Exception:
            if problem is None:
                raise
        finally:
            self._end_upload(scope)
        if problem is not None and not started:
            problem.headers["Connection"] = "close"
            await self._respond(problem)(scope, receive, send)

    def _begin_upload(self, scope: Any) -> None:
        """Count an upload; raise ``Problem`` if too many are in progress."""
        if self._uploads >= _MAX_UPLOADS:
            detail = f"expected fewer than {_MAX_UPLOADS} uploads at once; try again later"
            raise Problem("queue-full", detail, headers={"Retry-After": "2"})
        self._uploads += 1
        scope[_UPLOADING] = True

    def _end_upload(self, scope: Any) -> None:
        if scope.pop(_UPLOADING, False):
            self._uploads -= 1


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

    Only https, only allowed hosts and ports, and no redirections. The reason of a failure is logged, not
    returned: it would describe the network of the service.

    Args:
        address: Address of the file.
        hosts: Allowed hosts, ``name`` for port 443 or ``name:port``.
        target: File to write.
        max_bytes: Maximum size.
        timeout: Maximum time of a pause; the whole may take ten times as long, s.

    Raises:
        ParameterError: The address is not allowed.
        Problem: The address cannot be read, or its content is too large.
    """
    if not _is_allowed(address, hosts):
        allowed = ", ".join(f"https://{host}/" for host in hosts) or "none in this service"
        raise ParameterError("image_url", f"an address that begins with one of: {allowed}", address)
    opener = urllib.request.build_opener(_NoRedirection())
    try:
        with opener.open(address, timeout=timeout) as response, target.open("wb") as file:
            received, digest, end = 0, hashlib.sha256(), time.monotonic() + _MAX_PAUSES * timeout
            while block := response.read(_BLOCK_BYTES):
                received += len(block)
                if received > max_bytes:
                    raise Problem(
                        "too-large", f"image_url: expected at most {max_bytes} bytes; send a smaller file"
                    )
                if time.monotonic() > end:
                    raise TimeoutError("too slow")
                digest.update(block)
                file.write(block)
    except (OSError, ValueError, http.client.HTTPException) as error:
        place = urllib.parse.urlsplit(address)
        _log.warning("image_url https://%s%s: %s", place.netloc, place.path, error)  # no signature
        raise Problem("input", "image_url: cannot be read; check the address") from error
    return digest.hexdigest()


def _is_allowed(address: str, hosts: tuple[str, ...]) -> bool:
    """Return whether an address is https at an allowed host and port."""
    try:
        parts = urllib.parse.urlsplit(address)
        port = parts.port or _HTTPS_PORT
    except ValueError:
        return False
    name = (parts.hostname or "").lower()
    own = {f"{name}:{port}"} | ({name} if port == _HTTPS_PORT else set())
    return parts.scheme == "https" and address.isascii() and bool(own & set(hosts))


class _NoRedirection(urllib.request.HTTPRedirectHandler):
    def redirect_request(self, *words: Any, **more: Any) -> None:
        """Follow no redirection: it could lead into the internal network of the service."""
