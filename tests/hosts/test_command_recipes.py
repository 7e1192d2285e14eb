"""Recipes that call the command line: Nuke's command, and a chunk of a farm. Authority: that command line."""

import os
import runpy
import subprocess
import sys

import numpy as np
import pytest

from bokehnet.io.channels import write_channels
from tests.conftest import ROOT

KNOBS = {
    "command": "bokehnet",
    "math": "depth",
    "center": 2.0,
    "focal": 50.0,
    "fstop": 1.4,
    "haperture": 36.0,
    "filter_type": "bladed",
    "blades": 6,
    "roundness": 0.5,
    "rotation": 10.0,
    "aspect": 0.5,
}


@pytest.fixture
def shot(tmp_path):
    """Three frames with their depth."""
    rng = np.random.default_rng(0)
    depth = np.where(np.arange(32) < 16, 2.0, 6.0).astype(np.float32) * np.ones((24, 1), np.float32)
    for frame in (1, 2, 3):
        colors = dict(zip("RGB", rng.random((3, 24, 32), dtype=np.float32), strict=True))
        write_channels(tmp_path / f"in.{frame:04d}.exr", {**colors, "depth.Z": depth})
    return tmp_path


@pytest.fixture
def chunk(shot):
    """Run the farm's script with a bokehnet that is this one."""
    program = shot / "bin/bokehnet"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m bokehnet "$@"\n', encoding="utf-8")
    program.chmod(0o755)
    paths = {"PATH": f"{program.parent}:{os.environ['PATH']}", "PYTHONPATH": str(ROOT)}

    def run(*words):
        command = ["sh", str(ROOT / "integrations/farm/render_chunk.sh"), *words]
        return subprocess.run(command, cwd=shot, env={**os.environ, **paths}, capture_output=True, text=True)

    return run


def test_nukes_command_renders(cli, shot):
    command_line = runpy.run_path(str(ROOT / "integrations/nuke/bokehnet_nuke.py"))["command_line"]
    program, *words = command_line(KNOBS, str(shot / "in.0001.exr"), str(shot / "out.exr"))
    assert program == "bokehnet"
    done = cli(*words)
    assert (done.code, done.err) == (0, "")
    assert (shot / "out.exr").exists()
    inverse = command_line({**KNOBS, "math": "far=0", "center": 0.5}, "in.exr", "out.exr")
    assert inverse[inverse.index("--depth-unit") + 1] == "1/m"
    assert inverse[inverse.index("--focus-distance") + 1] == "2"


def test_a_chunk_that_failed_renders_what_is_missing_alone(chunk, shot):
    lens = ["--depth", "in.####.exr", "--focus-distance", "2", "--focal-length", "50", "--f-number", "1"]
    call = ["1", "3", "in.####.exr", "out.####.exr", *lens, "--sensor-width", "36", "--engine", "scatter"]
    hidden = (shot / "in.0002.exr").rename(shot / "later.exr")
    done = chunk(*call)
    assert done.returncode == 1
    assert "1 of 3 frames failed: 2" in done.stderr
    times = {path.name: path.stat().st_mtime_ns for path in shot.glob("out.*.exr")}
    assert sorted(times) == ["out.0001.exr", "out.0003.exr"]
    hidden.rename(shot / "in.0002.exr")
    assert chunk(*call).returncode == 0
    assert len(list(shot.glob("out.*.exr"))) == 3
    assert all((shot / name).stat().st_mtime_ns == time for name, time in times.items())
    assert chunk("1").returncode == 2
