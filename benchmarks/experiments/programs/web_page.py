"""Time and longest blocking task of the page without a server in a browser.

    python -m benchmarks.experiments.programs.web_page FOLDER [--photo 21.jpg] [--disparity 21.png] [--K 54]
    [--focus 0.4]

``FOLDER`` is made by ``python -m tools.release --web --out FOLDER`` (see web/README.md) and holds the
photograph and its disparity. Needs playwright and Chromium. Uses only WebAssembly, as without a graphics
card.
"""

import argparse
import functools
import http.server
import os
import runpy
import shutil
import threading
import time
from pathlib import Path
from typing import Any

from playwright.sync_api import Page, sync_playwright

_WATCH = """
    window.tasks = [];
    new PerformanceObserver((list) => {
        for (const one of list.getEntries()) tasks.push(one.duration);
    }).observe({ type: "longtask", buffered: true });
"""

_DRAG = """
    async ([from, to, seconds]) => {
        const slider = document.querySelector("[name=focus]");
        const before = window.previews ?? 0, end = performance.now() + 1000 * seconds;
        while (performance.now() < end) {
            const part = ((performance.now() / 1000) % 1);
            slider.value = (from + (to - from) * part).toFixed(3);
            slider.dispatchEvent(new Event("input", { bubbles: true }));
            await new Promise(requestAnimationFrame);
        }
        return ((window.previews ?? 0) - before) / seconds;
    }
"""


def serve(folder: Path) -> http.server.ThreadingHTTPServer:
    """Serve the folder with its own server."""
    handler = runpy.run_path(str(folder / "serve.py"))["Handler"]
    handler.log_message = lambda *_: None
    server = http.server.ThreadingHTTPServer(("localhost", 0), functools.partial(handler, directory=folder))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    return server


def status(page: Page) -> str:
    """Return the status line of the page."""
    return page.inner_text("#status")


def wait(page: Page, limit: float) -> float:
    """Wait for the picture; return the seconds."""
    start = reported = time.monotonic()
    while not (" in " in status(page) or "Failed" in status(page)):
        if time.monotonic() > start + limit:
            fraction = page.evaluate("document.querySelector('progress').value")
            raise SystemExit(f"timeout after {limit:g} s; {fraction:.0%} done")
        if time.monotonic() > reported + 20:
            reported = time.monotonic()
            print(
                f"    {reported - start:4.0f} s: "
                f"{page.evaluate('document.querySelector(`progress`).value'):.0%}"
            )
        page.wait_for_timeout(200)
    return time.monotonic() - start


def longest(page: Page) -> str:
    """Return number and maximum duration of the long tasks of the page."""
    tasks = sorted(page.evaluate("tasks"), reverse=True)
    return f"{len(tasks)} tasks above 50 ms" + (f", the longest {tasks[0]:.0f} ms" if tasks else "")


def measure(browser: Any, address: str, query: str, seconds: float, drag: float) -> None:
    """Open the page, wait, drag the focus, and print the times."""
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    page.add_init_script(_WATCH)
    page.goto(f"{address}/?{query}")
    wait(page, seconds)
    print(f"  {status(page)}; {longest(page)}")
    if drag and page.evaluate("window.previews !== undefined"):
        page.evaluate("tasks.length = 0")
        rate = page.evaluate(_DRAG, [0.1, 0.9, drag])
        size = page.evaluate("`${preview.width}x${preview.height}`")
        print(f"  preview while the focus is dragged: {rate:.1f} frames/s at {size}; {longest(page)}")
    page.close()


def main() -> None:
    """Print the times."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--photo", default="21.jpg")
    parser.add_argument("--disparity", default="21.png")
    parser.add_argument("--K", type=float, default=54.0)
    parser.add_argument("--focus", type=float, default=0.4)
    parser.add_argument("--limit", type=float, default=900.0, help="maximum seconds to wait")
    parser.add_argument("--drag", type=float, default=5.0, help="seconds of dragging")
    arguments = parser.parse_args()
    server = serve(arguments.folder)
    sandbox = ["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []
    query = (
        f"photo={arguments.photo}&disparity={arguments.disparity}&K={arguments.K:g}&focus={arguments.focus:g}"
    )
    print(f"{arguments.photo}, K {arguments.K:g}")
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=sandbox)
        address = f"http://localhost:{server.server_port}"
        measure(browser, address, query, arguments.limit, arguments.drag)
        browser.close()
    server.shutdown()
    print(f"load of the machine: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")


if __name__ == "__main__":
    main()
