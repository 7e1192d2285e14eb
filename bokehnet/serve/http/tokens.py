"""Authentication by bearer tokens, each with the name of a client."""

import hashlib
import hmac
from pathlib import Path

from bokehnet.errors import ConfigError
from bokehnet.io.files.text import read_text
from bokehnet.serve.problems import Problem

__all__ = ["Tokens"]

_MIN_TOKEN_LENGTH = 16  # characters


class Tokens:
    """Clients of a service; without a file all requests belong to one anonymous client.

    Args:
        path: File with a line NAME:TOKEN for each client; # begins a comment.

    Raises:
        ConfigError: The file cannot be read, or a line has another form.
    """

    def __init__(self, path: Path | None) -> None:
        self._names: dict[bytes, str] | None = None
        if path is None:
            return
        self._names = {}
        for number, line in enumerate(read_text(path, "tokens").splitlines(), start=1):
            line = line.split("#")[0].strip()
            if not line:
                continue
            name, _, token = (part.strip() for part in line.partition(":"))
            if not name or len(token) < _MIN_TOKEN_LENGTH:
                raise ConfigError(
                    f"{path}: line {number}: expected NAME:TOKEN, "
                    f"a token of at least {_MIN_TOKEN_LENGTH} characters"
                )
            self._names[_digest(token)] = name
        if not self._names:
            raise ConfigError(f"{path}: expected a line NAME:TOKEN, found none")

    @property
    def needed(self) -> bool:
        """True if requests need a token."""
        return self._names is not None

    def client(self, authorization: str | None) -> str:
        """Return the client's name, or raise ``Problem`` if its token is unknown."""
        if self._names is None:
            return ""
        kind, _, token = (authorization or "").partition(" ")
        digest, client = _digest(token.strip()), None
        for known, name in self._names.items():  # always all of them: constant time
            if hmac.compare_digest(known, digest):
                client = name
        if kind.lower() != "bearer" or client is None:
            detail = "expected the header Authorization: Bearer TOKEN with a token of this service"
            raise Problem("unauthorized", detail, headers={"WWW-Authenticate": "Bearer"})
        return client


def _digest(token: str) -> bytes:
    return hashlib.sha256(token.encode()).digest()
