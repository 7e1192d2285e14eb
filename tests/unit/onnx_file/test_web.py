"""The example for the browser, in headless Chromium. Authority: the renderer of the package."""

import base64
import functools
import http.server
import re
import runpy
import shutil
import subprocess
import threading

import numpy as np
import pytest

from bokehnet.io.color import linear_to_srgb
from bokehnet.io.image import read_image, write_image, write_map
from bokehnet.io.maps import read_disparity
from bokehnet.onnx_file.renderer import build_model
from bokehnet.optics.coc import defocus_from_disparity
from bokehnet.rendering.renderer import BokehRenderer
from tests.conftest import ROOT
from tests.unit.onnx_file.running import decibels, picture, steps

BLUR, FOCUS = 14.0, 0.4


def program(*names):
    """Path of the first of these programs that is installed; skip without any."""
    found = next(filter(None, map(shutil.which, names)), None)
    if found is None:
        pytest.skip(f"needs {' or '.join(names)}, which is not installed")
    return found


@pytest.fixture
def folder(tmp_path):
    """The example with its packages, the renderer, a photo and its disparity."""
    npm = program("npm")
    shutil.copytree(ROOT / "examples/web", tmp_path, dirs_exist_ok=True)
    words = [npm, "install", "--no-audit", "--no-fund", "--ignore-scripts"]
    installed = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, timeout=200, check=False)
    if installed.returncode:
        pytest.skip(f"npm cannot install onnxruntime-web here: {installed.stderr.strip()[:200]}")
    (tmp_path / "fast.onnx").write_bytes(build_model().SerializeToString())
    disparity = steps(83, 110, 1)
    write_image(tmp_path / "photo.png", picture(83, 110))
    write_map(tmp_path / "disparity.png", (disparity - disparity.min()) / np.ptp(disparity))
    return tmp_path


@pytest.fixture
def address(folder):
    """Where the example's own server has it."""
    handler = runpy.run_path(str(folder / "serve.py"))["Handler"]
    server = http.server.ThreadingHTTPServer(("localhost", 0), functools.partial(handler, directory=folder))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://localhost:{server.server_port}"
    server.shutdown()


@pytest.mark.slow
def test_the_page_renders_what_the_package_renders(folder, address, tmp_path_factory):
    chromium = program("chromium", "chromium-browser", "google-chrome")
    words = [
        chromium,
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        f"--user-data-dir={tmp_path_factory.mktemp('profile')}",
        "--virtual-time-budget=300000",
        "--dump-dom",
        f"{address}/?photo=photo.png&disparity=disparity.png&K={BLUR}&focus={FOCUS}",
    ]
    page = subprocess.run(words, capture_output=True, text=True, timeout=300, check=True).stdout
    status = re.search(r'id="status">([^<]*)<', page)
    assert status, page[:2000]
    assert re.fullmatch(r"110x83 in \d+\.\d s", status[1])
    saved = re.search(r'href="data:image/png;base64,([^"]+)"', page)
    (folder / "saved.png").write_bytes(base64.b64decode(saved[1]))
    image, disparity = read_image(folder / "photo.png"), read_disparity(folder / "disparity.png")
    defocus = defocus_from_disparity(disparity, BLUR, FOCUS).astype(np.float32)
    wanted = BokehRenderer("fast").render(image, defocus).bokeh
    found = linear_to_srgb(read_image(folder / "saved.png"))
    assert decibels(found, linear_to_srgb(np.clip(wanted, 0, 1))) > 50
    assert decibels(found, linear_to_srgb(image)) < 40
