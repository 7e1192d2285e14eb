"""Attacks on a running studio: ``python -m benchmarks.experiments.programs.studio_attacks``.

A studio opens the demo picture. Plain sockets, without normalization by a client, send requests for data that
it must not disclose, with host names, origins, paths and files that it must not accept. Prints the status and
the longest line of each answer. The paths lead to a secret file; at the end the studio must still show the
same picture, and no answer may contain the secret or the token. Needs the extra studio.
"""

import contextlib
import io
import json
import re
import socket
import struct
import subprocess
import sys
import tempfile
import zipfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import bokehnet

_ASSETS = Path(bokehnet.__file__).parent / "assets"
_SECRET = "the secret of this machine"


@dataclass(frozen=True, kw_only=True)
class Attack:
    """Malicious request.

    Attributes:
        what: Description.
        path: Path after the token; a path that begins with ``/`` replaces the token.
        method: HTTP method.
        headers: Headers that override those of the studio's page; "" omits one.
        body: Body of the request.
        allowed: Status codes of a refusal.
    """

    what: str
    path: str
    method: str = "GET"
    headers: dict[str, str] = field(default_factory=dict)
    body: bytes = b""
    allowed: tuple[int, ...] = (403,)


def bomb(side: int) -> bytes:
    """Return a PNG file of some kilobytes that declares side x side pixels."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", side, side, 8, 2, 0, 0, 0)
    rows = zlib.compress(bytes(2**22), 9)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


def packed(names: dict[str, bytes], *, compressed: bool = False) -> bytes:
    """Return a session file with these members."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED if compressed else zipfile.ZIP_STORED) as archive:
        for name, content in names.items():
            archive.writestr(name, content)
    return buffer.getvalue()


def attacks(secret: Path, port: int) -> Iterator[Attack]:
    """Yield all attacks."""
    yield Attack(what="no token", path="/")
    yield Attack(what="another token", path=f"/{'A' * 32}/api/state")
    yield Attack(what="rebinding: Host of evil.example", path="", headers={"Host": f"evil.example:{port}"})
    name = f"127.0.0.1.evil.example:{port}"
    yield Attack(what="rebinding: this machine's name under another", path="", headers={"Host": name})
    yield Attack(what="no Host", path="", headers={"Host": ""}, allowed=(400, 403))
    for origin in ("http://evil.example", "null", f"https://127.0.0.1:{port}", "http://127.0.0.1:1"):
        headers = {"Origin": origin}
        yield Attack(what=f"Origin {origin}".replace(str(port), "PORT"), path="api/state", headers=headers)
    change = {"method": "POST", "body": b'{"changes": {"camera": {"blur": 1}}}'}
    yield Attack(what="a form without Origin", path="api/change", headers={"Origin": ""}, **change)
    site = {"Sec-Fetch-Site": "cross-site", "Origin": ""}
    yield Attack(what="an image tag of another site", path="api/state", headers=site)
    preflight = {"Origin": "http://evil.example", "Access-Control-Request-Method": "POST"}
    yield Attack(what="a preflight of another origin", path="api/change", method="OPTIONS", headers=preflight)
    upgrade = {"Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Version": "13"}
    upgrade |= {"Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==", "Origin": "http://evil.example"}
    yield Attack(what="a WebSocket of another origin", path="api/state", headers=upgrade)
    up = "../" * 12 + str(secret).lstrip("/")
    for path in (up, up.replace("..", "%2e%2e"), up.replace("/", "%2f"), "/" + str(secret), "../app.py"):
        label = path.replace(str(secret).lstrip("/"), "SECRET").replace(
            str(secret).lstrip("/").replace("/", "%2f"), "SECRET"
        )
        yield Attack(what=f"path {label[:24]}", path=path, allowed=(403, 404))
    for group, setting in (
        ("input", "disparity"),
        ("engine", "weights"),
        ("lens", "name"),
        ("aperture", "image"),
        ("output", "save_maps"),
    ):
        body = json.dumps({"changes": {group: {setting: str(secret)}}}).encode()
        yield Attack(
            what=f"{group}.{setting} = SECRET", path="api/change", method="POST", body=body, allowed=(422,)
        )
    body = json.dumps({"preset": str(secret)}).encode()
    yield Attack(what="preset = SECRET", path="api/wear", method="POST", body=body, allowed=(422,))
    body = json.dumps({"name": f"../../{secret.name}.exe"}).encode()
    yield Attack(what="export to a path", path="api/export", method="POST", body=body, allowed=(422,))
    yield Attack(
        what="upload says 1 TB",
        path="api/open?name=a.png",
        method="POST",
        headers={"Content-Length": str(10**12)},
        body=b"x",
        allowed=(413,),
    )
    for side in (10_000, 60_000):
        yield Attack(
            what=f"PNG of kilobytes, {side}x{side}",
            path="api/open?name=a.png",
            method="POST",
            body=bomb(side),
            allowed=(422,),
        )
    yield Attack(
        what="a broken JPEG",
        path="api/open?name=a.jpg",
        method="POST",
        body=b"\xff\xd8\xff\xe0 no picture",
        allowed=(422,),
    )
    yield Attack(what="an executable", path="api/open?name=a.exe", method="POST", body=b"MZ", allowed=(422,))
    sessions = {
        "session: a bomb": packed({"session.json": b"{}", "a.png": bytes(2**24)}, compressed=True),
        "session: climbs": packed({"session.json": b"{}", "../a.png": b"x"}),
        "session: nested deep": packed({"session.json": b"[" * 100_000}),
        "session: opening = SECRET": packed(
            {
                "session.json": json.dumps(
                    {"picture": "a.png", "strokes": [], "settings": {"aperture": {"image": str(secret)}}}
                ).encode(),
                "a.png": b"x",
            }
        ),
    }
    for what, content in sessions.items():
        yield Attack(what=what, path="api/reopen", method="POST", body=content, allowed=(422,))
    yield Attack(what="no JSON", path="api/change", method="POST", body=b"no json", allowed=(400,))
    yield Attack(
        what="JSON nested 200000 deep", path="api/change", method="POST", body=b"[" * 200_000, allowed=(400,)
    )
    yield Attack(
        what="3 MiB of JSON", path="api/change", method="POST", body=bytes(3 * 2**20), allowed=(413,)
    )
    yield Attack(what="TRACE", path="api/state", method="TRACE", allowed=(403, 405))


def send(port: int, token: str, attack: Attack) -> bytes:
    """Return the complete response of a socket."""
    headers = {"Host": f"127.0.0.1:{port}", "Origin": f"http://127.0.0.1:{port}", "Connection": "close"}
    headers |= {"Content-Length": str(len(attack.body))} | attack.headers
    path = attack.path if attack.path.startswith("/") else f"/{token}/{attack.path}"
    lines = [
        f"{attack.method} {path} HTTP/1.1",
        *(f"{name}: {value}" for name, value in headers.items() if value),
    ]
    response = b""
    with (
        socket.create_connection(("127.0.0.1", port), timeout=60) as connection,
        contextlib.suppress(ConnectionError),
    ):
        with contextlib.suppress(ConnectionError):  # it may refuse before all is sent
            connection.sendall("\r\n".join([*lines, "", ""]).encode() + attack.body)
        while part := connection.recv(65536):
            response += part
    return response


def main() -> None:
    """Print a line for each attack."""
    words = [sys.executable, "-m", "bokehnet", "studio", "--no-browser", str(_ASSETS / "demo.png")]
    words += ["--disparity", str(_ASSETS / "demo_disparity.png"), "--blur", "38", "--repair-disparity", "off"]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
    failures, tried = [], 0
    with tempfile.TemporaryDirectory() as folder:
        secret = Path(folder) / "secret.txt"
        secret.write_text(_SECRET)
        try:
            assert process.stdout is not None
            address = re.search(r"http://127.0.0.1:(\d+)/([^/]+)/", process.stdout.readline())
            assert address
            port, token = int(address[1]), address[2]
            state = Attack(what="", path="api/state")
            print("| attack | status | answer |\n|---|---|---|")
            before = send(port, token, state).partition(b"\r\n\r\n")[2]
            for attack in attacks(secret, port):
                tried += 1
                response = send(port, token, attack)
                head, _, body = response.partition(b"\r\n\r\n")
                status = int(head.split()[1]) if head else 0
                leaked = (
                    _SECRET.encode() in response
                    or token.encode() in response
                    or b"access-control" in head.lower()
                )
                refused = status in attack.allowed and not leaked
                failures += [] if refused else [attack.what]
                message = max(body.decode("utf-8", "replace").splitlines() or [""], key=len)
                message = json.loads(message).get("error", message) if message.startswith("{") else message
                message = message.replace(folder, "").replace("|", " ").strip()
                print(f"| {attack.what} | {'' if refused else 'WRONG '}{status} | {message[:110]} |")
            after = send(port, token, state).partition(b"\r\n\r\n")[2]
        finally:
            process.terminate()
            process.wait(20)
    same = bool(before) and before == after
    print(
        f"{tried} tried, {len(failures)} not refused; the studio shows the same picture and settings: {same}"
    )
    if failures or not same:
        raise SystemExit(1)


if __name__ == "__main__":
    main()
