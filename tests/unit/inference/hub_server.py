"""A hub of models on this machine: the requests of ``huggingface_hub``, and nothing else."""

import hashlib
import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

REVISION = "0123456789abcdef0123456789abcdef01234567"


@dataclass
class Hub:
    """Its address, its files by (repository, path), and what was asked."""

    files: dict[tuple[str, str], bytes]
    licence: str = "mit"
    gated: bool = False
    cut: int = 0  # how many more downloads break off half way
    asked: list[str] = field(default_factory=list)
    address: str = ""


@contextmanager
def hub_server(files: dict[tuple[str, str], bytes]) -> Iterator[Hub]:
    """Serve these files at one revision."""
    hub = Hub(files)

    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def log_message(self, *words: object) -> None:
            pass

        def do_HEAD(self) -> None:
            self.answer(body=False)

        def do_GET(self) -> None:
            self.answer(body=True)

        def answer(self, body: bool) -> None:
            hub.asked.append(f"{self.command} {self.path}")
            path = self.path.split("?")[0].strip("/")
            if hub.gated:
                return self.tell(403, b"no", {"X-Error-Code": "GatedRepo"}, body)
            if path.startswith("api/models/"):
                return self.model(path.removeprefix("api/models/"), body)
            if path.count("/") < 4:
                return self.tell(404, b"", {}, body)
            owner, name, _, revision, file = path.split("/", 4)
            content = hub.files.get((f"{owner}/{name}", file))
            if revision not in (REVISION, "main"):
                return self.tell(404, b"", {"X-Error-Code": "RevisionNotFound"}, body)
            if content is None:
                return self.tell(404, b"", {"X-Error-Code": "EntryNotFound"}, body)
            digest = hashlib.sha256(content).hexdigest()
            head = {"X-Repo-Commit": REVISION, "ETag": f'"{digest}"', "X-Linked-Size": str(len(content))}
            if body and hub.cut:
                hub.cut -= 1
                self.send_response(200)
                self.send_header("Content-Length", str(len(content)))
                self.end_headers()
                self.wfile.write(content[: len(content) // 2])
                self.close_connection = True
                return None
            begin = 0
            if (expected := self.headers.get("Range")) and body:
                begin = int(expected.removeprefix("bytes=").split("-")[0])
                head["Content-Range"] = f"bytes {begin}-{len(content) - 1}/{len(content)}"
            return self.tell(206 if begin else 200, content[begin:], head, body)

        def model(self, path: str, body: bool) -> None:
            repository = "/".join(path.split("/")[:2])
            listed = [
                {
                    "rfilename": file,
                    "size": len(content),
                    "blobId": "0" * 40,
                    "lfs": {
                        "sha256": hashlib.sha256(content).hexdigest(),
                        "size": len(content),
                        "pointerSize": 130,
                    },
                }
                for (owner, file), content in hub.files.items()
                if owner == repository
            ]
            if not listed:
                return self.tell(404, b"", {"X-Error-Code": "RepoNotFound"}, body)
            reports = {
                "_id": "1",
                "id": repository,
                "modelId": repository,
                "sha": REVISION,
                "siblings": listed,
                "cardData": {"license": hub.licence},
                "tags": [],
                "downloads": 0,
                "likes": 0,
                "private": False,
            }
            return self.tell(200, json.dumps(reports).encode(), {"Content-Type": "application/json"}, body)

        def tell(self, code: int, content: bytes, head: dict[str, str], body: bool) -> None:
            self.send_response(code)
            for name, value in head.items():
                self.send_header(name, value)
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            if body:
                self.wfile.write(content)

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.daemon_threads = True
    threading.Thread(target=server.serve_forever, daemon=True).start()
    hub.address = f"http://127.0.0.1:{server.server_address[1]}"
    try:
        yield hub
    finally:
        server.shutdown()
        server.server_close()


def write_table(folder: Path, name: str, convention: str, content: bytes | None) -> None:
    """Write a table of one network, tests/tiny, and its pins where ``content`` is known."""
    (folder / "table.toml").write_text(
        f'[{name}]\nabout = "made in a test"\nrepository = "tests/tiny"\nfile = "onnx/model.onnx"\n'
        f'licence = "mit"\nconvention = "{convention}"\nsize = "1 kB"\n'
    )
    pins = ""
    if content is not None:
        sha256 = hashlib.sha256(content).hexdigest()
        pins = f'[{name}]\nrevision = "{REVISION}"\nsha256 = "{sha256}"\nbytes = {len(content)}\n'
    (folder / "pins.toml").write_text(pins)
