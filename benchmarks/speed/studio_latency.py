"""Latency of the studio from input to painted pixels, in a browser on the same machine.

    python -m benchmarks.speed.studio_latency [FOLDER] [--clicks 12]

``FOLDER`` holds 21.jpg and 21.png (by default the photographs of ../shared/real). Measures from the time
stamp of the pointer event to the first task after the frame that draws the pixels: for the first picture, for
the picture at screen resolution, and for the engine's final picture. The inputs are a photograph of 1080x1350
pixels and its enlargement to 12 megapixels; the window is 1440x900, the blur up to 60 preview pixels, without
disparity repair. Before that, opens the photograph and its map in the page of a studio without a picture, and
prints for each the time to its first preview and the processor seconds of the studio's processes.

Waits at most ``--patience`` seconds for a stage, and for the thumbnails before the inputs, which a busy
machine computes late; prints what did not arrive. Needs the extra studio, playwright and Chromium.
"""

import argparse
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
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
_JOBS_DONE = (
    "fetch('api/jobs').then((a) => a.json()).then((jobs) => jobs.repair.state !== 'running')"
    ".then((done) => done && document.body.dataset.presets)"
)
TWELVE = (3098, 3872)  # width, height


def enlarged(source: Path, target: Path) -> Path:
    """Write a picture or map enlarged to 12 megapixels."""
    roi = oiio.ROI(0, TWELVE[0], 0, TWELVE[1])
    oiio.ImageBufAlgo.resize(oiio.ImageBuf(str(source)), roi=roi).write(str(target))
    return target


def until(page: Page, expression: str, seconds: float) -> bool:
    """Return whether a JavaScript expression becomes true in time."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if page.evaluate(expression):
            return True
        page.wait_for_timeout(30)
    return False


def processor_seconds(pid: int) -> float:
    """Return the processor seconds of a process and its children so far."""
    ticks = 0
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:  # has just ended
            continue
        if pid in (int(stat.parent.name), int(fields[1])):
            ticks += int(fields[11]) + int(fields[12])
    return ticks / os.sysconf("SC_CLK_TCK")


@contextmanager
def studio(*words: str) -> Iterator[tuple[str, int]]:
    """Run a studio; yield its address and process."""
    command = [sys.executable, "-m", "bokehnet", "studio", "--no-browser", *words]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        address = re.search(r"http://\S+", process.stdout.readline())
        assert address
        yield address[0], process.pid
    finally:
        process.terminate()
        process.wait(20)


def measure_opening(picture: Path, disparity: Path, browser: Any, patience: float) -> None:
    """Open a photograph and then its map in the page; print the time to the first preview of each."""
    with studio() as (address, pid):
        page = browser.new_page(viewport={"width": 1440, "height": 900})
        page.goto(address)
        page.wait_for_selector("body[data-ready]")
        page.wait_for_timeout(4000)  # the background processes start
        for control, path in (("#open", picture), ("#map", disparity)):
            page.evaluate("performance.clearMeasures(); window.choiceTime = performance.now()")
            used = processor_seconds(pid)
            page.set_input_files(control, path)
            shown = until(page, "performance.getEntriesByType('measure').length", patience)
            used = processor_seconds(pid) - used
            ends = page.evaluate(
                "performance.getEntriesByType('measure')"
                ".map((one) => one.startTime + one.duration - window.choiceTime)"
            )
            time_text = f"{min(ends):6.0f} ms" if shown else f"none in {patience:g} s"
            print(
                f"opening {path.name}: first preview {time_text}, {used:.2f} processor s of the studio",
                flush=True,
            )
            until(page, _JOBS_DONE, patience)
        page.close()


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


def act(
    page: Page, kind: str, count: int, rng: random.Random, wait: str, patience: float
) -> dict[str, list[float]]:
    """Repeat one kind of input, each time waiting for a stage; print how often it did not arrive."""
    missed = 0
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
        missed += not until(page, f"{stages}.includes(document.body.dataset.stage)", patience)
        page.wait_for_timeout(60 if kind == "slider" else _PAUSE_MS)
        for stage, times in stage_times(page).items():
            times_by_stage[stage] += times
    if kind == "slider":
        page.mouse.up()
    if missed:
        print(f"  {kind}: stage {wait} did not arrive in {patience:g} s for {missed} of {count} inputs")
    return times_by_stage


def percentiles(times: list[float]) -> str:
    """Return p50 and p95 as text."""
    if not times:
        return "      -      "
    return f"{np.percentile(times, 50):6.0f} {np.percentile(times, 95):6.0f}"


def measure(
    picture: Path, disparity: Path, clicks: int, browser: Any, kinds: tuple[str, ...], patience: float
) -> None:
    """Measure one picture and print its table."""
    blur = 0.05 * oiio.ImageBuf(str(picture)).spec().width
    words = ["--disparity", str(disparity), "--blur", f"{blur:g}", "--focus", "0.4"]
    with studio(str(picture), *words, "--repair-disparity", "off") as (address, _):
        page = browser.new_page(viewport={"width": 1440, "height": 900})
        page.goto(address)
        if not until(page, "document.body.dataset.settled", patience):
            print(f"{picture.name}: no final picture in {patience:g} s")
        if not until(page, _JOBS_DONE, patience):
            print(f"{picture.name}: thumbnails not ready after {patience:g} s; the inputs compete with them")
        rng = random.Random(0)
        size = page.evaluate(
            "[document.querySelector('#result').width, document.querySelector('#result').height]"
        )
        print(f"{picture.name}: preview {size[0]}x{size[1]}; milliseconds, p50 and p95")
        for kind in kinds:
            act(page, kind, 2, rng, "scatter", patience)  # warm
            times = act(page, kind, clicks, rng, "scatter", patience)
            final_times = act(page, kind, 3, rng, "final", patience)["final"] if kind == "click" else []
            row = "   ".join(
                f"{WORDS[stage]} {percentiles(times[stage] if stage != 'final' else final_times)}"
                for stage in STAGES
            )
            print(f"  {kind:<7} {row}", flush=True)
        page.close()


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", nargs="?", type=Path, default=SHARED)
    parser.add_argument("--clicks", type=int, default=12)
    parser.add_argument("--patience", type=float, default=20, help="longest wait for one stage, s")
    parser.add_argument("--only", choices=("opening", "small", "large"))
    parser.add_argument("--kind", choices=KINDS, help="only this kind; default: all three")
    arguments = parser.parse_args()
    sandbox = ["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []
    with sync_playwright() as driver, tempfile.TemporaryDirectory() as folder:
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=sandbox)
        small = arguments.folder / "21.jpg", arguments.folder / "21.png"
        if arguments.only in (None, "opening"):
            measure_opening(*small, browser, arguments.patience)
        kinds = (arguments.kind,) if arguments.kind else KINDS
        if arguments.only in (None, "small"):
            measure(*small, arguments.clicks, browser, kinds, arguments.patience)
        if arguments.only in (None, "large"):
            names = "21_12mp.jpg", "21.png"
            large = [enlarged(path, Path(folder) / name) for path, name in zip(small, names, strict=True)]
            measure(*large, arguments.clicks, browser, kinds, arguments.patience)
        browser.close()
    print(f"load of the machine: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")


if __name__ == "__main__":
    main()
