"""Attacks on the local server, as pages of other sites, other programs and crafted files try them."""

import asyncio
import re
import socket
import struct
import zipfile
import zlib
from collections.abc import Coroutine
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bokehnet.errors import BokehnetError, ConfigError, ImageFileError
from bokehnet.studio.files import uploads
from bokehnet.studio.files.archive import read_session
from bokehnet.studio.files.uploads import UploadTooLargeError, receive, safe_name
from bokehnet.studio.guard import CONTENT_POLICY

from .conftest import HOST, PORT, TOKEN

SECRET = "/etc/passwd"


def test_the_page_itself_is_served(client):
    answer = client.get("")
    assert answer.status_code == 200
    assert "bokehnet studio" in answer.text


@pytest.mark.parametrize(
    "path", ["/", "/api/state", "/wrong/api/state", f"/{TOKEN}x/api/state", f"/{TOKEN}", "//"]
)
def test_nothing_is_served_without_the_token(client, path):
    answer = client.get(f"http://{HOST}{path}")
    assert answer.status_code == 403
    assert "bokehnet studio</title>" not in answer.text


@pytest.mark.parametrize(
    "host", ["evil.example", f"evil.example:{PORT}", f"127.0.0.1.evil.example:{PORT}", "127.0.0.1", ""]
)
def test_a_name_that_leads_here_is_refused(client, host):
    """DNS rebinding: the page of evil.example asks its own name, which now leads to this machine."""
    assert client.get("api/state", headers={"host": host}).status_code == 403


def test_localhost_is_a_name_of_this_machine(client):
    headers = {"host": f"localhost:{PORT}", "origin": f"http://localhost:{PORT}"}
    assert client.get("api/state", headers=headers).status_code == 200


@pytest.mark.parametrize(
    "origin",
    ["http://evil.example", "null", f"https://{HOST}", f"http://localhost:{PORT}", "http://127.0.0.1:1"],
)
@pytest.mark.parametrize("method", ["GET", "POST"])
def test_pages_of_other_origins_are_refused(client, origin, method):
    assert client.request(method, "api/state", headers={"origin": origin}).status_code == 403


def test_a_form_without_an_origin_changes_nothing(client, opened):
    before = opened.settings
    del client.headers["origin"]
    try:
        answer = client.post("api/change", json={"changes": {"camera": {"blur": 1}}})
    finally:
        client.headers["origin"] = f"http://{HOST}"
    assert answer.status_code == 403
    assert opened.settings == before


@pytest.mark.parametrize("site", ["cross-site", "same-site"])
def test_an_image_tag_of_another_site_gets_nothing(client, site):
    assert client.get("api/state", headers={"sec-fetch-site": site}).status_code == 403


def test_no_other_origin_is_ever_allowed(client):
    requested = {"origin": "http://evil.example", "access-control-request-method": "POST"}
    answers = [client.options("api/change", headers=requested), client.get("api/state"), client.get("")]
    assert answers[0].status_code == 403
    for answer in answers:
        assert not [name for name in answer.headers if name.startswith("access-control")]


def test_every_answer_forbids_inline_scripts_and_frames(client):
    for path in ("", "main.js", "api/state", "api/nothing"):
        headers = client.get(path).headers
        assert headers["content-security-policy"] == CONTENT_POLICY
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["referrer-policy"] == "no-referrer"
    assert "unsafe" not in CONTENT_POLICY
    page = (Path(uploads.__file__).parents[1] / "page" / "index.html").read_text("utf-8")
    assert page.count("<script") == 1
    assert 'src="main.js"' in page
    for bad in (" onclick", " onload", " style=", "http://", "https://", "<style"):
        assert bad not in page, bad


def test_a_websocket_is_closed(client):
    from starlette.websockets import WebSocketDisconnect

    with pytest.raises(WebSocketDisconnect), client.websocket_connect(f"/{TOKEN}/api/state"):
        pass


@pytest.mark.parametrize(
    "path",
    [
        "../../../../../../etc/passwd",
        "%2e%2e/%2e%2e/%2e%2e/%2e%2e/%2e%2e/etc/passwd",
        "..%2f..%2f..%2f..%2f..%2f..%2fetc%2fpasswd",
        "//etc/passwd",
        "..%5c..%5c..%5cetc%5cpasswd",
        "../app.py",
        "%2e%2e/guard.py",
    ],
)
def test_no_file_next_to_the_page_can_be_reached(client, path):
    answer = client.get(f"http://{HOST}/{TOKEN}/{path}")
    assert answer.status_code in (403, 404)
    assert "root:" not in answer.text
    assert "import" not in answer.text


@pytest.mark.parametrize(
    ("group", "name", "value"),
    [
        ("input", "disparity", SECRET),
        ("input", "depth", SECRET),
        ("input", "depth_model", SECRET),
        ("input", "depth_convention", SECRET),
        ("input", "matte", SECRET),
        ("aperture", "image", SECRET),
        ("engine", "weights", "/etc"),
        ("lens", "name", SECRET),
        ("color", "glass", SECRET),
        ("color", "axial_map", SECRET),
        ("color", "equaliser", SECRET),
        ("output", "save_maps", "/tmp/studio_maps_of_a_page"),
    ],
)
def test_no_setting_opens_a_file_of_this_machine(client, opened, group, name, value):
    before = opened.settings
    answer = client.post("api/change", json={"changes": {group: {name: value}}})
    assert answer.status_code == 422
    assert answer.json()["path"] == f"{group}.{name}"
    assert opened.settings == before


@pytest.mark.parametrize("preset", [SECRET, "../../x.toml", "/tmp/mine.toml", "nothing"])
def test_a_preset_is_a_name_and_no_file(client, opened, preset):
    assert client.post("api/wear", json={"preset": preset}).status_code == 422


@pytest.mark.parametrize("name", ["../../out.png", "/tmp/out.png", "..\\out.png"])
def test_an_export_stays_in_the_studios_folder(client, opened, exported, name):
    exported(name)
    assert opened.result().name == "out.png"
    assert opened.folder in opened.result().parents


@pytest.mark.parametrize("name", ["x.toml", "x", "", "..", ".png", "a.exe", "x.png/"])
def test_names_of_other_things_are_refused(name):
    with pytest.raises(ImageFileError, match="expected a file that ends in"):
        safe_name(name)


def test_an_upload_over_its_declared_bound_is_not_read(client):
    answer = client.post("api/open?name=a.png", content=b"x", headers={"content-length": str(10**12)})
    assert answer.status_code == 413
    assert "MiB" in answer.json()["error"]


def finished(coroutine: Coroutine[Any, Any, Any]) -> None:
    """Run it in a thread of its own: a browser that another test has opened keeps a loop in this one."""
    with ThreadPoolExecutor(1) as thread:
        thread.submit(asyncio.run, coroutine).result()


def test_an_upload_that_does_not_say_is_cut_off(tmp_path):
    async def endless():
        while True:
            yield bytes(2**20)

    with pytest.raises(UploadTooLargeError, match="expected a file of up to 4 MiB"):
        finished(receive(endless(), tmp_path / "a.png", None, max_bytes=4 * 2**20))
    assert list(tmp_path.iterdir()) == []


def test_an_upload_that_never_ends_is_ended(tmp_path, monkeypatch):
    monkeypatch.setattr(uploads, "_MAX_SECONDS", 0.05)

    async def slow():
        while True:
            yield b"x"
            await asyncio.sleep(0.01)

    with pytest.raises(UploadTooLargeError, match="expected the file within"):
        finished(receive(slow(), tmp_path / "a.png", None))
    assert list(tmp_path.iterdir()) == []


def bomb(side: int) -> bytes:
    """A PNG file of a few kilobytes that says it has side x side pixels."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", side, side, 8, 2, 0, 0, 0)
    rows = zlib.compress(bytes(4 * 2**20), 9)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


@pytest.mark.parametrize("side", [10_000, 60_000])
def test_a_decompression_bomb_is_refused_and_the_picture_stays(client, opened, side):
    picture = opened.opened
    answer = client.post("api/open?name=bomb.png", content=bomb(side))
    assert answer.status_code == 422
    assert re.search("pixels|malicious", answer.json()["error"])
    assert opened.opened is picture


def test_a_broken_file_is_reported_in_one_line_without_a_path(client, opened, files):
    picture = opened.opened
    whole = (files / "photo.png").read_bytes()
    for content in (b"", b"no picture", whole[: len(whole) // 2]):
        answer = client.post("api/open?name=photo.png", content=content)
        assert answer.status_code == 422
        assert str(opened.folder) not in answer.text
        assert "photo.png" in answer.json()["error"]
    assert opened.opened is picture


def packed(path: Path, compression: int, names: dict[str, bytes]) -> Path:
    with zipfile.ZipFile(path, "w", compression) as archive:
        for name, content in names.items():
            archive.writestr(name, content)
    return path


@pytest.mark.parametrize(
    ("compression", "names"),
    [
        (zipfile.ZIP_DEFLATED, {"session.json": b"{}", "a.png": bytes(2**24)}),
        (zipfile.ZIP_STORED, {"session.json": b"{}", "../a.png": b"x"}),
        (zipfile.ZIP_STORED, {"session.json": b"{}", "/tmp/a.png": b"x"}),
        (zipfile.ZIP_STORED, {"session.json": b"{}"} | {f"{i}.png": b"x" for i in range(20)}),
        (zipfile.ZIP_STORED, {"session.json": b"[" * 100_000}),
        (zipfile.ZIP_STORED, {"session.json": b"[]"}),
        (zipfile.ZIP_STORED, {"other.json": b"{}"}),
    ],
    ids=["bomb", "upwards", "absolute", "many", "nested", "no table", "no session"],
)
def test_a_crafted_session_is_refused(tmp_path, compression, names):
    path, folder = packed(tmp_path / "a.bokeh", compression, names), tmp_path / "inside"
    folder.mkdir()
    with pytest.raises(ConfigError, match="expected"):
        read_session(path, folder)
    assert list(folder.rglob("*")) == []


def test_a_session_opens_no_file_of_this_machine(client, opened, tmp_path):
    picture = opened.opened
    for settings in (
        b'{"aperture": {"image": "/etc/passwd"}}',
        b'{"lens": {"name": "/etc/passwd"}}',
        b'{"lens": 3}',
    ):
        table = b'{"picture": "a.png", "strokes": [], "settings": ' + settings + b"}"
        path = packed(tmp_path / "a.bokeh", zipfile.ZIP_STORED, {"session.json": table, "a.png": b"x"})
        assert client.post("api/reopen", content=path.read_bytes()).status_code == 422
    assert opened.opened is picture


@pytest.mark.parametrize(
    "body",
    [
        b"no json",
        b"[]",
        b"[" * 200_000,
        b'{"changes": 3}',
        b'{"changes": {"camera": 3}}',
        b'{"changes": {"x": {"y": 1}}}',
    ],
)
def test_odd_requests_get_an_error(client, opened, body):
    answer = client.post("api/change", content=body)
    assert answer.status_code in (400, 422)
    assert "error" in answer.json()


def test_a_long_request_is_cut_off(client, opened):
    assert client.post("api/change", content=bytes(3 * 2**20)).status_code == 413


def test_a_helper_that_dies_is_reported_and_the_next_picture_works(client, opened, frames):
    opened.fine._process.kill()
    opened.fine._process.join()
    requested = {"width": 96, "height": 64, "client": "a"}
    assert frames(client.post("api/preview", json=requested).content)[-1][0]["stage"] == "final"


def test_a_task_that_takes_too_long_is_ended():
    from bokehnet.studio.background import BackgroundProcess

    process = BackgroundProcess()
    try:
        with pytest.raises(BokehnetError, match="expected this to finish"):
            process.run(np.ones, 3, seconds=0.0)
    finally:
        process.stop()


def test_the_redirect_page_opens_only_the_page(client):
    """A browser names another site where a file leads to the studio (Fetch Metadata, W3C)."""
    headers = {"sec-fetch-site": "cross-site", "sec-fetch-mode": "navigate", "sec-fetch-dest": "document"}
    del client.headers["origin"]
    try:
        assert client.get("", headers=headers).status_code == 200
        assert client.get("api/state", headers=headers).status_code == 403
        assert client.get("", headers=headers | {"sec-fetch-dest": "iframe"}).status_code == 403
        assert client.get("", headers={"sec-fetch-site": "cross-site"}).status_code == 403
    finally:
        client.headers["origin"] = f"http://{HOST}"


def test_the_token_is_in_a_private_page_not_in_the_command_line(tmp_path, session, monkeypatch):
    pytest.importorskip("uvicorn", reason="needs the extra studio")
    from bokehnet.studio import server
    from bokehnet.studio.app import make_app

    opened, said = [], []
    monkeypatch.setattr(server.webbrowser, "open", opened.append)
    monkeypatch.setattr(server.threading, "Timer", lambda seconds, call, words: Immediate(call, words))
    monkeypatch.setattr(server.uvicorn.Server, "run", lambda *_, **__: None)
    monkeypatch.setattr(session, "close", lambda: None)
    server.serve(session, make_app, tell=said.append)
    token = said[0].rstrip("/").rpartition("/")[2]
    assert token not in opened[0]
    page = Path(opened[0].removeprefix("file://"))
    assert token in page.read_text()
    assert page.stat().st_mode & 0o777 == 0o600
    assert page.parent.stat().st_mode & 0o777 == 0o700


def test_a_body_does_not_wait_for_the_acknowledgement_of_its_header(session, monkeypatch):
    """Authority: the option of the connection as the event loop sets it up (RFC 896, RFC 1122 4.2.3.4)."""
    pytest.importorskip("uvicorn", reason="needs the extra studio")
    from bokehnet.studio import server
    from bokehnet.studio.app import make_app

    found = []

    def run(_, sockets):
        async def connect():
            done = asyncio.Event()

            def accepted(reader, writer):
                connection = writer.get_extra_info("socket")
                found.append(connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY))
                writer.close()
                done.set()

            async with await asyncio.start_server(accepted, sock=sockets[0]):
                _, writer = await asyncio.open_connection(*sockets[0].getsockname())
                await done.wait()
                writer.close()

        asyncio.run(connect())

    monkeypatch.setattr(server.uvicorn.Server, "run", run)
    monkeypatch.setattr(session, "close", lambda: None)
    server.serve(session, make_app, browser=False, tell=lambda _: None)
    assert found == [1]


class Immediate:
    """A timer that runs at once."""

    def __init__(self, call, words):
        self.start = lambda: call(*words)
