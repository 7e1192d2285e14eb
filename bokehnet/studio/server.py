"""Start of the studio: a local port, an address with a token, a page in the browser."""

import html
import os
import socket
import threading
import webbrowser
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import uvicorn

from bokehnet.errors import BokehnetError
from bokehnet.studio.guard import Application, make_token

__all__ = ["Served", "serve", "write_redirect"]

_HOST = "127.0.0.1"


class Served(Protocol):
    """Session of a page."""

    @property
    def folder(self) -> Path:
        """Private folder."""
        ...

    def close(self) -> None:
        """Stop all work and remove the folder."""
        ...


def serve(
    session: Served,
    make_app: Callable[..., Application],
    *,
    port: int = 0,
    browser: bool = True,
    tell: Callable[[str], None],
) -> None:
    """Serve a session until Ctrl-C.

    Args:
        session: Session to serve; closed at the end.
        make_app: Function of session, ``token`` and ``port`` that returns the application.
        port: Port to listen on; 0 uses any free port.
        browser: True to open the page in the browser.
        tell: Callback that receives the address.

    Raises:
        BokehnetError: The port is taken.
    """
    # asyncio disables Nagle's algorithm only where the protocol is given: else a body waits 40 ms for the
    # acknowledgement of its header.
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP) as listener:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind((_HOST, port))
        except OSError as error:
            raise BokehnetError(f"--port: expected a free port, {port} is in use; leave it out") from error
        listener.listen(128)  # before publishing the address
        port, token = listener.getsockname()[1], make_token()
        app = make_app(session, token=token, port=port)
        config = uvicorn.Config(
            app,
            log_level="critical",
            access_log=False,
            server_header=False,
            timeout_graceful_shutdown=1,
            ws="none",
        )
        address = f"http://{_HOST}:{port}/{token}/"
        tell(address)
        if browser:
            page = write_redirect(session.folder, address)
            threading.Timer(0.5, webbrowser.open, (page.as_uri(),)).start()
        try:
            uvicorn.Server(config).run(sockets=[listener])
        finally:
            session.close()


def write_redirect(folder: Path, address: str) -> Path:
    """Write a page that leads to an address with its token, readable by this user alone, and return its path.

    The browser gets the path: other users of the machine can read its command line, but not this file.

    Args:
        folder: Private folder.
        address: Address of the studio.
    """
    page = folder / "open.html"
    with os.fdopen(os.open(page, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="utf-8") as file:
        file.write(f'<!doctype html><meta http-equiv="refresh" content="0;url={html.escape(address)}">\n')
    return page
