"""Listens to a WebSocket, as RFC 6455 has it: what a server sends, and no answers but the handshake."""

import base64
import os
import socket
import struct
from collections.abc import Iterator
from contextlib import contextmanager

TEXT, BINARY, CLOSE = 1, 2, 8


@contextmanager
def messages(port: int, path: str, seconds: float = 180) -> Iterator[Iterator[str | bytes]]:
    """Give the messages of a server on this machine, until it is silent for so long."""
    with socket.create_connection(("127.0.0.1", port), timeout=seconds) as line:
        key = base64.b64encode(os.urandom(16)).decode()
        requested = (
            f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        )
        line.sendall(f"{requested}Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n\r\n".encode())
        file = line.makefile("rb")
        status = file.readline()
        assert b" 101 " in status, status
        while file.readline().strip():
            pass

        def frames() -> Iterator[str | bytes]:
            whole, kind = b"", 0
            while True:
                first, length = file.read(2)
                if length >= 126:
                    length = struct.unpack(
                        *((">H", file.read(2)) if length == 126 else (">Q", file.read(8)))
                    )[0]
                whole, kind = whole + file.read(length), first & 15 or kind
                if kind == CLOSE:
                    return
                if first & 128:
                    if kind in (TEXT, BINARY):
                        yield whole.decode() if kind == TEXT else whole
                    whole = b""

        yield frames()
