"""How long it is from the hand to painted pixels in the studio, in a browser on the same machine.

    python -m benchmarks.studio_latency [FOLDER] [--clicks 30]

``FOLDER`` holds 21.jpg and 21.png (by default the photographs of ../shared/real). Each is measured from the
time stamp of the pointer's event to the first task after the frame in which the pixels are drawn: for the
first picture, for the one at the size of the screen, and for the engine's own. A photograph of 1080x1350
pixels and its enlargement to 12 megapixels; the window is 1440x900, blur up to 60 pixels of
the preview, the map as it is.
Needs the extra studio, playwright and Chromium.
"""

import argparse
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio  # noqa: N813
from playwright.sync_api import Page, sync_playwright

SHARED = Path(__file__).resolve().parents[2] / "shared" / "real"
KINDS = ("click", "slider", "preset")
STAGES = ("draft", "scatter", "final")
WORDS = {"draft": "first", "scatter": "screen", "final": "engine"}
_PAUSE = 300  # milliseconds of a hand between two clicks
TWELVE = (3098, 3872)  # width, height


def enlarged(source: Path, target: Path) -> Path:
    """Write a picture or a map at 12 megapixels."""
    roi = oiio.ROI(0, TWELVE[0], 0, TWELVE[1])
    oiio.ImageBufAlgo.resize(oiio.ImageBuf(str(source)), roi=roi).write(str(target))
    return target


def until(page: Page, expression: str, seconds: float = 240) -> None:
    """Wait until an expression is true."""
    for _ in range(int(seconds / 0.03)):
        if page.evaluate(expression):
            return
        page.wait_for_timeout(30)
    raise SystemExit(f"not within {seconds:g} s: {expression}")


def measured(page: Page) -> dict[str, list[float]]:
    """Milliseconds of each stage since the last look; the first is the draft, or what came in its place."""
    entries = page.evaluate(
        """() => {
            const found = performance.getEntriesByType("measure")
                .map((one) => [one.name.split(" ")[1], one.duration, one.startTime]);
            performance.clearMeasures();
            return found;
        }"""
    )
    times: dict[str, list[float]] = {
        stage: [t for name, t, _ in entries if name == stage] for stage in STAGES
    }
    starts: dict[float, float] = {}
    for _, duration, start in entries:
        starts[start] = min(duration, starts.get(start, duration))
    times["draft"] = list(starts.values())
    return times


def act(page: Page, kind: str, count: int, rng: random.Random, wait: str) -> dict[str, list[float]]:
    """Do one thing several times, each time waiting for a stage."""
    found: dict[str, list[float]] = {stage: [] for stage in STAGES}
    sheet = page.locator("#sheet").bounding_box()
    blur = page.locator("#blur").bounding_box()
    presets = page.locator("#presets button")
    assert sheet
    assert blur
    if kind == "slider":
        page.mouse.move(blur["x"] + 0.5 * blur["width"], blur["y"] + blur["height"] / 2)
        page.mouse.down()
    for at in range(count):
        page.evaluate("() => { delete document.body.dataset.stage; performance.clearMeasures(); }")
        if kind == "click":
            x = sheet["x"] + rng.uniform(0.1, 0.9) * sheet["width"]
            y = sheet["y"] + rng.uniform(0.1, 0.9) * sheet["height"]
            page.mouse.click(x, y)
        elif kind == "slider":
            x = blur["x"] + (0.3 + 0.4 * rng.random()) * blur["width"]
            page.mouse.move(x, blur["y"] + blur["height"] / 2)
        else:
            presets.nth(1 + at % (presets.count() - 1)).click()
        later = {"scatter": "['scatter', 'final']", "final": "['final']"}[wait]
        until(page, f"{later}.includes(document.body.dataset.stage)")
        page.wait_for_timeout(60 if kind == "slider" else _PAUSE)
        for stage, times in measured(page).items():
            found[stage] += times
    if kind == "slider":
        page.mouse.up()
    return found


def told(times: list[float]) -> str:
    """p50 and p95."""
    if not times:
        return "      -      "
    return f"{np.percentile(times, 50):6.0f} {np.percentile(times, 95):6.0f}"


def measure(picture: Path, disparity: Path, clicks: int, browser: Any, kinds: tuple[str, ...]) -> None:
    """Measure one picture and print its table."""
    words = [sys.executable, "-m", "bokehnet", "studio", "--no-browser", str(picture)]
    blur = 0.05 * oiio.ImageBuf(str(picture)).spec().width
    words += ["--disparity", str(disparity), "--blur", f"{blur:g}", "--focus", "0.4"]
    words += ["--repair-disparity", "off"]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        address = re.search(r"http://\S+", process.stdout.readline())
        assert address
        page = browser.new_page(viewport={"width": 1440, "height": 900})
        page.goto(address[0])
        page.wait_for_selector("body[data-settled]", timeout=240_000)
        until(
            page,
            "fetch('api/jobs').then((a) => a.json()).then((jobs) => jobs.repair.state !== 'running')",
            400,
        )
        until(page, "document.body.dataset.presets")
        rng = random.Random(0)
        size = page.evaluate(
            "[document.querySelector('#result').width, document.querySelector('#result').height]"
        )
        print(f"{picture.name}: preview {size[0]}x{size[1]}; milliseconds, p50 and p95")
        for kind in kinds:
            act(page, kind, 3, rng, "scatter")  # warm
            found = act(page, kind, clicks, rng, "scatter")
            last = act(page, kind, 3, rng, "final")["final"] if kind == "click" else []
            row = "   ".join(
                f"{WORDS[stage]} {told(found[stage] if stage != 'final' else last)}" for stage in STAGES
            )
            print(f"  {kind:<7} {row}", flush=True)
        page.close()
    finally:
        process.terminate()
        process.wait(20)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", nargs="?", type=Path, default=SHARED)
    parser.add_argument("--clicks", type=int, default=30)
    parser.add_argument("--only", choices=("small", "large"))
    parser.add_argument("--kind", choices=KINDS, help="only this; default all three")
    given = parser.parse_args()
    sandbox = ["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []
    with sync_playwright() as driver, tempfile.TemporaryDirectory() as folder:
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=sandbox)
        small = given.folder / "21.jpg", given.folder / "21.png"
        large = [
            enlarged(path, Path(folder) / name)
            for path, name in zip(small, ("21_12mp.jpg", "21.png"), strict=True)
        ]
        for name, (picture, disparity) in {"small": small, "large": large}.items():
            if given.only in (None, name):
                measure(picture, disparity, given.clicks, browser, (given.kind,) if given.kind else KINDS)
        browser.close()
    print(f"load of the machine: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")


if __name__ == "__main__":
    main()
