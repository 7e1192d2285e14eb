"""Every parallel kernel runs inside the one lock; two at once would abort the process."""

import threading

import numpy as np
import pytest

from bokehnet.classical.parallel import parallel_region
from bokehnet.cli.app import run
from bokehnet.io.image import write_image, write_map
from bokehnet.precompiled.kernel import Kernel


def is_open() -> bool:
    """Return whether another thread could enter the region now."""
    results = []

    def look() -> None:
        lock = parallel_region._lock
        results.append(lock.acquire(blocking=False))
        if results[0]:
            lock.release()

    thread = threading.Thread(target=look)
    thread.start()
    thread.join()
    return results[0]


@pytest.mark.parametrize(
    "options",
    [
        (),
        ("--engine", "scatter", "--blades", "6", "--cats-eye", "0.5"),
        ("--engine", "hybrid", "--repair-disparity", "on"),
        ("--engine", "fast"),
        ("--lens", "double_gauss"),
        ("--lens", "petzval", "--max-memory", "700M"),
        ("--preset", "night-cinema"),
        ("--preset", "soap-bubble"),
    ],
    ids=" ".join,
)
def test_kernels_run_inside_the_region(monkeypatch, tmp_path, options):
    y, x = np.mgrid[:90, :120].astype(np.float32)
    image = np.stack([0.5 + 0.3 * np.sin(0.3 * x), 0.5 + 0.3 * np.cos(0.2 * y), 0.4 + 0 * x], -1)
    image[20:24, 30:34] = 1
    disparity = np.where(np.hypot(x - 60, y - 45) < 25, 0.9, 0.2 + 0.002 * x)
    write_image(tmp_path / "photo.png", image.astype(np.float32))
    write_map(tmp_path / "map.png", disparity.astype(np.float32))
    outside, seen, call = set(), set(), Kernel.__call__

    def watched(kernel, *arguments, **named):
        if kernel.options.get("parallel"):
            seen.add(kernel.name)
            if is_open():
                outside.add(kernel.name)
        return call(kernel, *arguments, **named)

    monkeypatch.setattr(Kernel, "__call__", watched)
    files = [str(tmp_path / name) for name in ("photo.png", "map.png", "out.png")]
    words = ["render", "-q", files[0], "--disparity", files[1], "--blur", "12", "--focus", "0.3"]
    assert run([*words, *options, "-o", files[2]]) == 0
    assert seen
    assert not outside
