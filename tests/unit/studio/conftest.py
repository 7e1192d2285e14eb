import json
import struct
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from bokehnet.io.image import write_image, write_map
from bokehnet.settings.settings import RenderSettings
from bokehnet.studio.session import Session

PORT, TOKEN = 8123, "a-token-that-tests-know"
HOST = f"127.0.0.1:{PORT}"
SIZE = (96, 64)  # width, height


@pytest.fixture(scope="session")
def files(tmp_path_factory):
    """A picture with lights and its map: a near square before a far wall."""
    folder = tmp_path_factory.mktemp("studio_files")
    width, height = SIZE
    rng = np.random.default_rng(5)
    image = (0.05 + 0.4 * rng.random((height, width, 3))).astype(np.float32)
    image[8::16, 8::16] = 1
    disparity = np.full((height, width), 0.2, np.float32)
    disparity[20:50, 30:60] = 0.8
    write_image(folder / "photo.png", image)
    write_map(folder / "map.png", disparity)
    return folder


@pytest.fixture(scope="session")
def session() -> Iterator[Session]:
    result = Session()
    result.start()
    yield result
    result.close()


@pytest.fixture(autouse=True)
def _without_preset(request) -> None:
    """Deselect the preset of the test before, which a new picture keeps."""
    if "session" in request.fixturenames:
        request.getfixturevalue("session").preset = ""


@pytest.fixture
def opened(session, files) -> Session:
    reports = {
        "input": {"disparity": str(files / "map.png")},
        "camera": {"blur": 12},
        "focus": {"value": 0},
        "depth": {"repair": "off"},
    }
    session.open(files / "photo.png", RenderSettings().updated(reports))
    while session.jobs["light"]["state"] == "running":  # its estimate changes the picture
        time.sleep(0.01)
    return session


@pytest.fixture(scope="session")
def client(session):
    """Asks as the studio's own page does."""
    pytest.importorskip("httpx", reason="asks the application as a browser does, with httpx")
    testclient = pytest.importorskip("starlette.testclient", reason="needs the extra studio")
    from bokehnet.studio.app import make_app

    app = make_app(session, token=TOKEN, port=PORT)
    return testclient.TestClient(
        app, base_url=f"http://{HOST}/{TOKEN}/", headers={"origin": f"http://{HOST}"}
    )


@pytest.fixture
def frames() -> Callable[[bytes], list]:
    """Headers and pixels of an answer, without progress messages."""

    def read(body: bytes) -> list:
        results = []
        while body:
            (size,) = struct.unpack("<I", body[:4])
            header, body = json.loads(body[4 : 4 + size]), body[4 + size :]
            pixels, body = body[: header["bytes"]], body[header["bytes"] :]
            if header["stage"] != "progress":
                shape = (header.get("height", 0), header.get("width", 0), 4)
                results.append((header, np.frombuffer(pixels, np.uint8).reshape(shape) if pixels else None))
        return results

    return read


@pytest.fixture
def exported(client) -> Callable[[str], bytes]:
    """Export under a name, and return the file's bytes."""

    def export(name: str) -> bytes:
        assert client.post("api/export", json={"name": name}).status_code == 200
        end = time.monotonic() + 120
        while (job := client.get("api/jobs").json()["export"])["state"] == "running":
            assert time.monotonic() < end
            time.sleep(0.05)
        assert job["state"] == "done", job
        return client.get("api/result").content

    return export
