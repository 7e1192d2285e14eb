"""Previewer of scene files in Chromium: ``python -m benchmarks.experiments.programs.scene_preview``.

For each scene: pictures a second on the page while a pointer orbits and the width of the last, milliseconds
from a change of the focus to its first picture, and processor milliseconds of a draft. ``--figures DIR``
writes the table as a JSON file, ``--screenshot FILE.png`` the page of the first scene.
"""

import argparse
import re
import shutil
import statistics
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from time import process_time
from typing import Any

from benchmarks.figures import write_figures
from bokehnet.scenes.preview import ScenePreview, View

_COMMAND = "python -m benchmarks.experiments.programs.scene_preview --figures docs/figures"
_CONDITIONS = "two cores; pictures a second and milliseconds on the page in Chromium; draft of 256x171 pixels"
_COLUMNS = {
    "rate": ("pictures a second in an orbit", ".1f"),
    "width": ("width of a draft in motion, px", ".0f"),
    "focus": ("ms from focus to picture", ".0f"),
    "draft": ("processor ms of a draft", ".0f"),
}
_SCENES = ("configs/scene_balls.toml", "configs/scene_cards.toml")
_ORBIT_SECONDS, _CHANGES, _DRAFT_PX = 5.0, 9, 256

# Events a second of the pointer.
_POINTER_HZ = 60


def _draft_milliseconds(scene: str) -> float:
    preview = ScenePreview(scene)
    lens, times = preview.lens, []
    for number in range(6):
        view = View(
            lens=replace(lens, focus_distance=1 + 0.1 * number), azimuth=5.0 * number, width=_DRAFT_PX
        )
        start = process_time()
        preview.draft(view)
        times.append(1000 * (process_time() - start))
    return statistics.median(times[1:])


def _measure_page(page: Any, address: str) -> dict[str, float]:
    """Return pictures a second in an orbit, their width, and milliseconds from a focus to its picture."""

    def number(name: str) -> int:
        return int(page.evaluate(f"Number(document.body.dataset.{name} ?? 0)"))

    page.goto(address)
    while page.evaluate("document.body.dataset.stage") != "traced":
        page.wait_for_timeout(50)
    box = page.locator("#result").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    first, start = number("drafts"), page.evaluate("performance.now()")
    step = 0
    while (passed := page.evaluate("performance.now()") - start) < 1000 * _ORBIT_SECONDS:
        step += 1
        page.mouse.move(x + 60 + 2 * (step % 60), y + step % 20)
        time.sleep(1 / _POINTER_HZ)
    rate = 1000 * (number("drafts") - first) / passed
    width = number("width")
    page.mouse.up()
    times = []
    for change in range(_CHANGES):
        count = number("drafts")
        page.wait_for_timeout(800)  # the traced picture is on its way
        page.fill("#focus-distance", str(0.7 + 0.1 * change))
        page.press("#focus-distance", "Enter")
        while number("drafts") == count:
            page.wait_for_timeout(5)
        times.append(number("latency"))
    return {"rate": rate, "width": width, "focus": statistics.median(times)}


def main() -> None:
    """Entry of the command line."""
    from playwright.sync_api import sync_playwright

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--figures", type=Path, help="folder of the JSON file")
    parser.add_argument("--screenshot", type=Path, help="picture of the page")
    arguments = parser.parse_args()
    rows = {}
    for scene in _SCENES:
        words = [sys.executable, "-m", "bokehnet", "studio", "--no-browser", scene]
        studio = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
        assert studio.stdout is not None
        match = re.search(r"http://\S+", studio.stdout.readline())
        assert match is not None
        with sync_playwright() as driver:
            browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
            page = browser.new_page(viewport={"width": 1280, "height": 800})
            rows[Path(scene).stem] = _measure_page(page, match[0])
            if arguments.screenshot is not None and len(rows) == 1:
                page.wait_for_timeout(8000)
                page.screenshot(path=str(arguments.screenshot))
            browser.close()
        studio.terminate()
        studio.wait(20)
        rows[Path(scene).stem]["draft"] = _draft_milliseconds(scene)
        print(Path(scene).stem, rows[Path(scene).stem], flush=True)
    if arguments.figures:
        write_figures(arguments.figures / "scene_preview.json", _COMMAND, _CONDITIONS, _COLUMNS, rows)


if __name__ == "__main__":
    main()
