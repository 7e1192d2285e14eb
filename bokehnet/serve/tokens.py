"""Who may ask: bearer tokens, each with the name of a client."""

import hashlib
import hmac
from pathlib import Path

from bokehnet.errors import ConfigError
from bokehnet.io.text import read_text
from bokehnet.serve.problems import Problem

__all__ = ["Tokens"]

_SHORTEST = 16  # characters


class Tokens:
    """The clients of a service; without a file anybody is one, all of one name.

    Args:
        path: A file with a line NAME:TOKEN for each; # begins a comment.

    Raises:
        ConfigError: The file cannot be read, or a line is none of these.
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
            if not name or len(token) < _SHORTEST:
                raise ConfigError(
                    f"{path}: line {number}: expected NAME:TOKEN, a token of at least {_SHORTEST} characters"
                )
            self._names[_digest(token)] = name
        if not self._names:
            raise ConfigError(f"{path}: expected a line NAME:TOKEN, found none")

    @property
    def needed(self) -> bool:
        """Whether a token must be shown."""
        return self._names is not None

    def client(self, authorization: str | None) -> str:
        """Return the client's name, or raise ``Problem`` where its token is unknown."""
        if self._names is None:
            return ""
        kind, _, token = (authorization or "").partition(" ")
        shown, found = _digest(token.strip()), None
        for known, name in self._names.items():  # all of them, so that time tells nothing
            if hmac.compare_digest(known, shown):
                found = name
        if kind.lower() != "bearer" or found is None:
            detail = "expected the header Authorization: Bearer TOKEN with a token of this service"
            raise Problem("unauthorized", detail, headers={"WWW-Authenticate": "Bearer"})
        return found


def _digest(token: str) -> bytes:
    return hashlib.sha256(token.encode()).digest()
