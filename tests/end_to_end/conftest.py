import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from bokehnet.io.image import write_image, write_map

ROOT = Path(__file__).resolve().parents[2]


def until(page, expression: str, seconds: float = 40) -> None:
    """Wait until an expression is true; playwright's own way is code from a text, which the page forbids."""
    end = time.monotonic() + seconds
    while not page.evaluate(expression):
        assert time.monotonic() < end, expression
        page.wait_for_timeout(30)


class Studio:
    """A studio in a process of its own."""

    def __init__(self, *arguments: object) -> None:
        words = [sys.executable, "-m", "bokehnet", "studio", "--no-browser", *map(str, arguments)]
        self.process = subprocess.Popen(words, cwd=ROOT, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        self.address = re.search(r"http://\S+", self.process.stdout.readline())[0]

    def end(self) -> None:
        self.process.terminate()
        self.process.wait(20)


@pytest.fixture(scope="package")  # no longer: its event loop keeps other tests from their own
def browser() -> Iterator[object]:
    """The distribution's Chromium, or playwright's own."""
    pytest.importorskip("starlette", reason="needs the extra studio")
    api = pytest.importorskip("playwright.sync_api", reason="drives a browser with playwright")
    path = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    sandbox = ["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []
    with api.sync_playwright() as driver:
        try:
            opened = driver.chromium.launch(executable_path=path, args=sandbox)
        except api.Error as error:
            pytest.skip(f"needs Chromium, found none that starts: {str(error).splitlines()[0]}")
        yield opened
        opened.close()


@pytest.fixture(scope="session")
def files(tmp_path_factory) -> Path:
    """A picture with lights and its map: a near square before a far wall."""
    folder = tmp_path_factory.mktemp("studio_files")
    rng = np.random.default_rng(5)
    image = (0.05 + 0.4 * rng.random((120, 180, 3))).astype(np.float32)
    image[8::24, 8::24] = 1
    disparity = np.full((120, 180), 0.2, np.float32)
    disparity[30:90, 60:120] = 0.8
    write_image(folder / "photo.png", image)
    write_map(folder / "map.png", disparity)
    return folder


@pytest.fixture(scope="module")
def studio(files) -> Iterator[Studio]:
    pytest.importorskip("starlette", reason="needs the extra studio")
    result = Studio(
        files / "photo.png",
        *("--disparity", files / "map.png", "--blur", 12, "--focus", 0, "--repair-disparity", "off"),
    )
    yield result
    result.end()


@pytest.fixture
def page(browser, studio) -> Iterator[object]:
    """A page of the studio as the command line opened it, whose scripts must not fail."""
    context = browser.new_context(viewport={"width": 1280, "height": 800}, accept_downloads=True)
    context.set_default_timeout(30_000)
    headers = {"origin": studio.address.rsplit("/", 2)[0]}
    plain = {"aperture": {"blades": None}, "camera": {"blur": 12}, "focus": {"value": 0}}
    for _ in range(context.request.get(f"{studio.address}api/state").json()["done"]):
        context.request.post(f"{studio.address}api/undo", headers=headers)
    context.request.post(f"{studio.address}api/change", headers=headers, data={"changes": plain})
    opened, faults = context.new_page(), []
    opened.on("pageerror", lambda error: faults.append(str(error)))
    opened.on(
        "console", lambda result: faults.append(result.text) if "Content Security" in result.text else None
    )
    opened.goto(studio.address)
    opened.wait_for_selector("body[data-settled]")
    until(opened, "document.querySelector('#command').textContent !== ''")  # comes after the picture
    yield opened
    assert faults == []
    context.close()


@pytest.fixture
def settle() -> Callable[..., None]:
    """Do something on a page, and wait until its last picture is there."""

    def after(page, action: Callable[[], object]) -> None:
        count = page.evaluate("Number(document.body.dataset.settled ?? 0)")
        action()
        until(page, f"Number(document.body.dataset.settled ?? 0) > {count}")

    return after


@pytest.fixture
def pixels() -> Callable[..., np.ndarray]:
    """Return the pixels of a canvas, (H, W, 4)."""

    def read(page, canvas: str = "#result") -> np.ndarray:
        result = page.evaluate(
            """(name) => {
                const canvas = document.querySelector(name), { width, height } = canvas;
                return [width, height, [...canvas.getContext("2d").getImageData(0, 0, width, height).data]];
            }""",
            canvas,
        )
        return np.array(result[2], np.uint8).reshape(result[1], result[0], 4)

    return read
