"""Access control of the studio: only its own page, which knows the token in its address, may talk to it."""

import secrets
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any

__all__ = ["CONTENT_POLICY", "Guard", "make_token"]

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
Application = Callable[[Scope, Receive, Send], Awaitable[None]]

CONTENT_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""Policy of every response: scripts and styles only from the studio's own files, none inline.

Source: W3C, "Content Security Policy Level 3".
"""

_HEADERS = (
    (b"content-security-policy", CONTENT_POLICY.encode()),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),  # the address contains the token
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cache-control", b"no-store"),
)

_SAFE_METHODS = ("GET", "HEAD")


def make_token() -> str:
    """Return an unguessable token of 192 random bits.

    Examples:
        >>> len(make_token()), make_token() == make_token()
        (32, False)
    """
    return secrets.token_urlsafe(24)


class Guard:
    """Filter that passes requests to this machine from the studio's own page with the token.

    DNS rebinding, where another site's name resolves to this machine, fails by ``Host``; other pages fail by
    ``Origin``; other programs and users fail by the token, the first part of every path.

    Args:
        app: Application for the passed requests; their paths come without the token.
        token: Token from :func:`make_token`.
        port: Port of the studio.

    Source: Jackson et al., "Protecting Browsers from DNS Rebinding Attacks", CCS 2007; Barth et al., "Robust
        Defenses for Cross-Site Request Forgery", CCS 2008.
    """

    def __init__(self, app: Application, *, token: str, port: int) -> None:
        self._app, self._token = app, token.encode()
        self._hosts = tuple(f"{name}:{port}".encode() for name in ("127.0.0.1", "localhost"))

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request (ASGI interface)."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        if scope["type"] != "http":
            await send({"type": "websocket.close", "code": 1008})
            return
        refusal = self._refusal(scope)

        async def guarded(message: MutableMapping[str, Any]) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", ()), *_HEADERS]
            await send(message)

        if refusal:
            body = refusal.encode()
            headers = [(b"content-type", b"text/plain; charset=utf-8"), (b"connection", b"close")]
            await guarded({"type": "http.response.start", "status": 403, "headers": headers})
            await guarded({"type": "http.response.body", "body": body})
            return
        _, _, rest = scope["path"].split("/", 2)
        inside = {**scope, "path": f"/{rest}", "raw_path": f"/{rest}".encode(), "root_path": ""}
        await self._app(inside, receive, guarded)

    def _refusal(self, scope: Scope) -> str:
        """Return the reason to reject a request, or an empty text."""
        headers: dict[bytes, list[bytes]] = {}
        for name, value in scope["headers"]:
            headers.setdefault(name.lower(), []).append(value)
        hosts, origins = headers.get(b"host", []), headers.get(b"origin", [])
        if len(hosts) != 1 or hosts[0].lower() not in self._hosts:
            return "expected this machine as the host, found another name"
        if len(origins) > 1 or any(origin.lower() != b"http://" + hosts[0].lower() for origin in origins):
            return "expected a request of the studio's own page, found one of another origin"
        if scope["method"] not in _SAFE_METHODS and not origins:
            return "expected a request of a page, found one without an origin"
        parts = scope["path"].split("/", 2)
        is_page = len(parts) == 3 and not parts[2] and scope["method"] == "GET"
        opens_page = is_page and headers.get(b"sec-fetch-dest") == [b"document"]  # from the redirect page
        sites = (b"none", b"same-origin", *((b"cross-site",) if opens_page else ()))
        if headers.get(b"sec-fetch-site", [b"none"])[0] not in sites:
            return "expected a request of the studio's own page, found one of another site"
        if len(parts) < 3 or not secrets.compare_digest(parts[1].encode(), self._token):
            return "expected the address that bokehnet studio printed, found one without its token"
        return ""
