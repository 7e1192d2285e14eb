"""Bodies of requests: bounded in size and in patience, streamed to the disk and hashed on the way."""

import asyncio
import hashlib
import http.client
import urllib.parse
import urllib.request
from pathlib import Path
from typing import Any

from bokehnet.errors import ParameterError
from bokehnet.serve.problems import Problem

__all__ = ["BoundedBody", "fetch", "keep"]

_BLOCK = 2**20


class BoundedBody:
    """ASGI middleware: no body is larger than allowed, and none stands still for longer than allowed.

    Args:
        app: What it stands before.
        most: Bytes of a body.
        patience: Seconds between two parts of it.
        admit: Is given the headers before anything of the body is read; raises ``Problem``.
        answer: Makes an ASGI answer of a problem.
    """

    def __init__(self, app: Any, most: int, patience: float, admit: Any, answer: Any) -> None:
        self._app, self._most, self._patience = app, most, patience
        self._admit, self._answer = admit, answer

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        """See ASGI."""
        if scope["type"] != "http" or scope["method"] != "POST":
            await self._app(scope, receive, send)
            return
        taken, begun, problem = 0, False, None

        async def bounded() -> Any:
            nonlocal taken, problem
            try:
                message = await asyncio.wait_for(receive(), self._patience)
            except TimeoutError:
                problem = Problem("too-slow", f"expected a part of the body within {self._patience:g} s")
                raise problem from None
            taken += len(message.get("body", b""))
            if taken > self._most:
                problem = Problem("too-large", f"expected at most {self._most} bytes; send smaller files")
                raise problem
            return message

        async def noticed(message: Any) -> None:
            nonlocal begun
            if problem is None:  # what the application makes of our own exception is not sent
                begun = True
                await send(message)

        headers = dict(scope["headers"])
        length = headers.get(b"content-length", b"0")
        try:
            self._admit(headers)
            if length.isdigit() and int(length) > self._most:
                raise Problem("too-large", f"expected at most {self._most} bytes, found {int(length)}")
            await self._app(scope, bounded, noticed)
        except Problem as found:
            problem = found
        except Exception:
            if problem is None:
                raise
        if problem is not None and not begun:
            problem.headers["Connection"] = "close"
            await self._answer(problem)(scope, receive, send)


def keep(source: Any, target: Path) -> str:
    """Write a file that came to ``target``; return its SHA-256."""
    digest = hashlib.sha256()
    with target.open("wb") as file:
        while block := source.read(_BLOCK):
            digest.update(block)
            file.write(block)
    return digest.hexdigest()


def fetch(address: str, hosts: tuple[str, ...], target: Path, most: int, patience: float) -> str:
    """Fetch a signed address to ``target``; return its SHA-256.

    Only https, only hosts that the service was told of, and no redirection away from them.

    Raises:
        ParameterError: The address is none of these.
        Problem: It cannot be read, or is too large.
    """
    parts = urllib.parse.urlsplit(address)
    if parts.scheme != "https" or (parts.hostname or "").lower() not in hosts:
        allowed = ", ".join(f"https://{host}/" for host in hosts) or "none in this service"
        raise ParameterError("image_url", f"an address that begins with one of: {allowed}", address)
    opener = urllib.request.build_opener(_NoRedirection())
    try:
        with opener.open(address, timeout=patience) as answer, target.open("wb") as file:
            taken, digest = 0, hashlib.sha256()
            while block := answer.read(_BLOCK):
                taken += len(block)
                if taken > most:
                    raise Problem(
                        "too-large", f"image_url: expected at most {most} bytes; send a smaller file"
                    )
                digest.update(block)
                file.write(block)
    except (OSError, ValueError, http.client.HTTPException) as error:
        raise Problem("input", f"image_url: cannot be read: {' '.join(str(error).split())}") from error
    return digest.hexdigest()


class _NoRedirection(urllib.request.HTTPRedirectHandler):
    def redirect_request(self, *words: Any, **more: Any) -> None:
        """Follow none: it could lead to the service's own network."""
