"""Errors as problem documents, RFC 9457."""

from typing import Any

from bokehnet.errors import BokehnetError, ParameterError

__all__ = ["CANCELLED", "MEDIA_TYPE", "Problem", "problem_of"]

MEDIA_TYPE = "application/problem+json"

_MAX_TEXT_CHARACTERS = 2000  # of a member of a document

# Status and title by kind of problem.
_KINDS = {
    "parameter": (422, "A parameter is wrong"),
    "input": (422, "The files cannot be rendered"),
    "request": (422, "The request is not as described"),
    "idempotency": (422, "The idempotency key belongs to another request"),
    "too-many-pixels": (413, "The picture is too large"),
    "too-large": (413, "The request is too large"),
    "too-slow": (408, "The upload stalled"),
    "unauthorized": (401, "A token is required"),
    "not-found": (404, "Not found"),
    "not-done": (409, "There is no result yet"),
    "queue-full": (429, "The queue is full"),
    "draining": (503, "The service is stopping"),
    "time": (422, "The job took too long"),
    "memory": (422, "The job took too much memory"),
    "died": (500, "The worker died"),
    "cancelled": (410, "The job was cancelled"),
    "damaged": (500, "The files of the job are damaged"),
    "bug": (500, "A bug in the service"),
}


class Problem(Exception):  # noqa: N818  # named after RFC 9457
    """Invalid request of a client, or failure of its job.

    Args:
        kind: One of the kinds above.
        detail: One line: subject, expected, found, way out.
        parts: Additional members of the document.
        headers: HTTP headers of the response.
    """

    def __init__(
        self,
        kind: str,
        detail: str,
        parts: dict[str, Any] | None = None,
        headers: dict[str, str] | None = None,
    ) -> None:
        super().__init__(detail)
        self.kind, self.detail, self.parts, self.headers = kind, detail, parts or {}, headers or {}
        self.status, self.title = _KINDS[kind]

    def document(self, instance: str = "") -> dict[str, Any]:
        """Return the members of the document."""
        members: dict[str, Any] = {
            "type": f"urn:bokehnet:problem:{self.kind}",
            "title": self.title,
            "status": self.status,
            "detail": self.detail,
        }
        members |= ({"instance": instance} if instance else {}) | self.parts
        return {key: _encodable(value) for key, value in members.items()}


def _encodable(value: Any) -> Any:
    """Return a value whose text can be encoded as UTF-8 and is of bounded length."""
    if not isinstance(value, str):
        return value
    text = value.encode("utf-8", "replace").decode()
    return text if len(text) <= _MAX_TEXT_CHARACTERS else f"{text[:_MAX_TEXT_CHARACTERS]}..."


CANCELLED = Problem("cancelled", "cancelled by its client")


def problem_of(error: BaseException) -> Problem:
    """Return the problem for an error of the package; fields keep their paths."""
    detail = " ".join(str(error).split())
    if isinstance(error, ParameterError):
        parts = {"parameter": error.parameter, "expected": error.expected, "remedy": error.remedy}
        if error.has_got:
            parts["got"] = str(error.got)
        return Problem("parameter", detail, {key: value for key, value in parts.items() if value})
    if isinstance(error, BokehnetError):
        return Problem("input", detail)
    if isinstance(error, MemoryError):
        return Problem("memory", "the picture does not fit into memory; send a smaller one")
    return Problem("bug", f"{type(error).__name__}: {detail}")
