"""``--max-memory`` bounds the whole program, from reading to writing."""

import subprocess
import sys

import numpy as np
import pytest

from bokehnet.io.image import read_image, write_image, write_map
from bokehnet.render.exposure.memory_bounds import min_memory
from bokehnet.settings.settings import RenderSettings

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="other units of peak memory")


# The peak that a parent reads of its child begins with the parent's own, so the program prints it.
PROGRAM = """
import sys
from pathlib import Path
from bokehnet.cli.app import run
code = run(sys.argv[1:])
print(next(x for x in Path("/proc/self/status").read_text().splitlines() if x.startswith("VmHWM")).split()[1])
sys.exit(code)
"""


def peak_of(*words: str) -> int:
    """Largest resident size of one command line, bytes, as the kernel counts it."""
    done = subprocess.run([sys.executable, "-c", PROGRAM, *words], capture_output=True, text=True, check=True)
    return int(done.stdout) * 1024


@pytest.fixture
def large(tmp_path, monkeypatch):
    """Fourteen megapixels: 230 MB with their defocus, four times as much when scattered at once."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(0)
    picture = np.repeat(np.repeat(rng.random((600, 375, 3), dtype=np.float32), 8, 0), 8, 1)
    write_image("photo.png", picture)
    write_image("photo.exr", picture)
    write_map("map.png", np.linspace(0, 1, 4800)[:, None].repeat(3000, 1))


@pytest.mark.slow
def test_the_program_stays_within_its_bound(large):
    options = ("--disparity", "map.png", "--blur", "20", "--focus", "0.3", "--engine", "scatter")
    options += ("--repair-disparity", "off")
    bounded = (*options, "--max-memory", "910M")
    assert peak_of("render", "photo.exr", *options, "-o", "whole.exr") > 910 * 2**20
    assert peak_of("render", "photo.png", *bounded, "-o", "out.png") < 910 * 2**20
    assert peak_of("render", "photo.exr", *bounded, "-o", "out.exr") < 910 * 2**20
    error = read_image("out.exr") - read_image("whole.exr")
    assert -10 * np.log10(np.mean(error**2) + 1e-20) > 60


@pytest.mark.slow
def test_the_least_is_enough_for_networks(large):
    """Near squares all over, so that both networks look at, and correct, all of the picture."""
    near = np.kron(np.arange(40 * 25).reshape(40, 25) % 2, np.ones((120, 120)))
    write_map("squares.png", 0.1 + 0.8 * near)
    reports = {"input": {"disparity": "squares.png"}, "camera": {"blur": 20}, "focus": {"value": 0.3}}
    least = min_memory(RenderSettings().updated(reports), "fast", 3000, 4800)
    words = ("--disparity", "squares.png", "--blur", "20", "--focus", "0.3", "--engine", "fast")
    repair = ("--repair-disparity", "on", "--max-memory", str(least))
    assert peak_of("render", "photo.png", *words, *repair, "-o", "out.png") <= least
