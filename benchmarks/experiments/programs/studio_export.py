"""Equality of studio exports and commands: ``python -m benchmarks.experiments.programs.studio_export``.

A studio opens the demo picture; in Chromium, for each of six settings, the export is clicked and saved, and
the displayed command and the copied Python code are run unchanged. Prints whether all three files are equal
byte for byte. Needs the extra studio, playwright and Chromium.
"""

import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from playwright.sync_api import Page, sync_playwright

import bokehnet
from benchmarks.speed.studio_latency import until

_ASSETS = Path(bokehnet.__file__).parent / "assets"

SIX: dict[str, tuple[str, dict[str, dict[str, Any]]]] = {
    "focus on a pixel": ("plain.png", {"focus": {"at": [256, 240]}}),
    "six blades, cat's-eye": (
        "shape.png",
        {"aperture": {"blades": 6, "curvature": 0.25, "cats_eye": 0.5}, "focus": {"value": 0.8}},
    ),
    "coma and spherical aberration": (
        "glass.png",
        {"lens": {"coma": -2.0, "spherical": 1.5}, "focus": {"value": 0.46}},
    ),
    "highlights, vignette, grain": (
        "light.png",
        {
            "highlights": {"threshold": 0.8, "gain": 4.0},
            "effects": {"vignette": 0.7, "grain": 0.3},
            "focus": {"value": 0.2},
        },
    ),
    "tilted plane, scatter, 16 bits": (
        "tilt.png",
        {
            "focus": {"value": 0.4, "tilt_x": -20.0},
            "engine": {"name": "scatter"},
            "output": {"bits": "16"},
        },
    ),
    "JPEG of quality 90, unmixed colours": (
        "colour.jpg",
        {"color": {"axial": 2.0}, "output": {"quality": 90}, "focus": {"value": 0.46}},
    ),
}
"""File name and settings of each export."""

_CHANGE = """
    ([blank, changes]) => fetch("api/state").then((answer) => answer.json()).then(async ({ settings }) => {
        for (const values of [blank, changes]) {
            const body = JSON.stringify({ changes: values });
            const headers = { "content-type": "application/json" };
            const answer = await fetch("api/change", { method: "POST", headers, body });
            if (!answer.ok) throw new Error(await answer.text());
        }
    })
"""


def default_changes() -> dict[str, dict[str, None]]:
    """Return changes that restore the defaults of all fields of the six settings."""
    blank: dict[str, dict[str, None]] = {}
    for _, changes in SIX.values():
        for group, fields in changes.items():
            blank.setdefault(group, {}).update(dict.fromkeys(fields))
    return blank


def exported(page: Page, name: str, changes: dict[str, dict[str, Any]]) -> tuple[bytes, str, str]:
    """Return the bytes that the page exports, the command it shows and the Python code it copies."""
    page.evaluate(_CHANGE, [default_changes(), changes])
    page.reload()
    page.wait_for_selector("body[data-settled]", timeout=240_000)
    page.fill("#out-name", name)
    page.keyboard.press("Tab")
    until(page, f"document.querySelector('#command').textContent.endsWith('{name}')")
    command = page.inner_text("#command")
    with page.expect_download(timeout=240_000) as download:
        page.click("#export")
    saved = Path(download.value.path()).read_bytes()
    page.click("#copy-python")
    until(page, "document.querySelector('#command').textContent.includes('import')")
    return saved, command, page.inner_text("#command")


def output_of(words: list[str], folder: Path, name: str) -> bytes:
    """Return the bytes of the file that a command writes."""
    (folder / name).unlink(missing_ok=True)
    subprocess.run(words, cwd=folder, check=True, stdout=subprocess.DEVNULL)
    return (folder / name).read_bytes()


def main() -> None:
    """Print a line for each of the six exports."""
    words = [sys.executable, "-m", "bokehnet", "studio", "--no-browser", str(_ASSETS / "demo.png")]
    words += ["--disparity", str(_ASSETS / "demo_disparity.png"), "--blur", "38"]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
    sandbox = ["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []
    equal = 0
    try:
        assert process.stdout is not None
        address = re.search(r"http://\S+", process.stdout.readline())
        assert address
        with sync_playwright() as driver, tempfile.TemporaryDirectory() as name:
            browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=sandbox)
            page = browser.new_page(viewport={"width": 1440, "height": 900}, accept_downloads=True)
            page.goto(address[0])
            for what, (output, changes) in SIX.items():
                saved, command, python = exported(page, output, changes)
                command_words = [sys.executable, "-m", *shlex.split(command), "-q"]
                matches = (
                    saved == output_of(command_words, Path(name), output),
                    saved == output_of([sys.executable, "-c", python], Path(name), output),
                )
                equal += all(matches)
                print(
                    f"{what}: {len(saved)} bytes; equal to the command's: {matches[0]}, "
                    f"Python's: {matches[1]}"
                )
                print(f"    {re.sub(re.escape(str(_ASSETS)) + '/', '', command)}", flush=True)
            browser.close()
    finally:
        process.terminate()
        process.wait(20)
    print(f"{equal} of {len(SIX)} equal")
    if equal < len(SIX):
        raise SystemExit(1)


if __name__ == "__main__":
    main()
