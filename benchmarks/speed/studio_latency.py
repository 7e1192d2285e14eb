"""Latency of the studio from input to painted pixels, in a browser on the same machine.

    python -m benchmarks.speed.studio_latency [FOLDER] [--clicks 30]

``FOLDER`` holds 21.jpg and 21.png (by default the photographs of ../shared/real). Measures from the time
stamp of the pointer event to the first task after the frame that draws the pixels: for the first picture, for
the picture at screen resolution, and for the engine's final picture. The inputs are a photograph of 1080x1350
pixels and its enlargement to 12 megapixels; the window is 1440x900, the blur up to 60 preview pixels, without
disparity repair. Needs the extra studio, playwright and Chromium.
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

SHARED = Path(__file__).resolve().parents[3] / "shared" / "real"
KINDS = ("click", "slider", "preset")
STAGES = ("draft", "scatter", "final")
WORDS = {"draft": "first", "scatter": "screen", "final": "engine"}
_PAUSE_MS = 300  # between two clicks
TWELVE = (3098, 3872)  # width, height


def enlarged(source: Path, target: Path) -> Path:
    """Write a picture or map enlarged to 12 megapixels."""
    roi = oiio.ROI(0, TWELVE[0], 0, TWELVE[1])
    oiio.ImageBufAlgo.resize(oiio.ImageBuf(str(source)), roi=roi).write(str(target))
    return target


def until(page: Page, expression: str, seconds: float = 240) -> None:
    """Wait until a JavaScript expression is true."""
    for _ in range(int(seconds / 0.03)):
        if page.evaluate(expression):
            return
        page.wait_for_timeout(30)
    raise SystemExit(f"timeout after {seconds:g} s: {expression}")


def stage_times(page: Page) -> dict[str, list[float]]:
    """Return milliseconds of each stage since the last call; the draft is the first picture of any kind."""
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
    """Repeat one kind of input, each time waiting for a stage."""
    times_by_stage: dict[str, list[float]] = {stage: [] for stage in STAGES}
    sheet = page.locator("#sheet").bounding_box()
    blur = page.locator("#blur").bounding_box()
    presets = page.locator("#presets button")
    assert sheet
    assert blur
    if kind == "slider":
        page.mouse.move(blur["x"] + 0.5 * blur["width"], blur["y"] + blur["height"] / 2)
        page.mouse.down()
    for index in range(count):
        page.evaluate("() => { delete document.body.dataset.stage; performance.clearMeasures(); }")
        if kind == "click":
            x = sheet["x"] + rng.uniform(0.1, 0.9) * sheet["width"]
            y = sheet["y"] + rng.uniform(0.1, 0.9) * sheet["height"]
            page.mouse.click(x, y)
        elif kind == "slider":
            x = blur["x"] + (0.3 + 0.4 * rng.random()) * blur["width"]
            page.mouse.move(x, blur["y"] + blur["height"] / 2)
        else:
            presets.nth(1 + index % (presets.count() - 1)).click()
        stages = {"scatter": "['scatter', 'final']", "final": "['final']"}[wait]
        until(page, f"{stages}.includes(document.body.dataset.stage)")
        page.wait_for_timeout(60 if kind == "slider" else _PAUSE_MS)
        for stage, times in stage_times(page).items():
            times_by_stage[stage] += times
    if kind == "slider":
        page.mouse.up()
    return times_by_stage


def percentiles(times: list[float]) -> str:
    """Return p50 and p95 as text."""
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
            times = act(page, kind, clicks, rng, "scatter")
            final_times = act(page, kind, 3, rng, "final")["final"] if kind == "click" else []
            row = "   ".join(
                f"{WORDS[stage]} {percentiles(times[stage] if stage != 'final' else final_times)}"
                for stage in STAGES
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
    parser.add_argument("--kind", choices=KINDS, help="only this kind; default: all three")
    arguments = parser.parse_args()
    sandbox = ["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []
    with sync_playwright() as driver, tempfile.TemporaryDirectory() as folder:
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=sandbox)
        small = arguments.folder / "21.jpg", arguments.folder / "21.png"
        large = [
            enlarged(path, Path(folder) / name)
            for path, name in zip(small, ("21_12mp.jpg", "21.png"), strict=True)
        ]
        for name, (picture, disparity) in {"small": small, "large": large}.items():
            if arguments.only in (None, name):
                measure(
                    picture,
                    disparity,
                    arguments.clicks,
                    browser,
                    (arguments.kind,) if arguments.kind else KINDS,
                )
        browser.close()
    print(f"load of the machine: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")


if __name__ == "__main__":
    main()
