"""Rendering is private: no socket of the internet is opened, and no number for the device is kept."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

COMMANDS = {
    "demo": ["demo", "-o", "out.png"],
    "render": [
        "render",
        *(str(ROOT / "bokehnet" / "assets" / "demo.png"), "-o", "out.png", "--engine", "hybrid"),
        *("--disparity", str(ROOT / "bokehnet" / "assets" / "demo_disparity.png")),
        *("--blur", "20", "--focus", "0.4", "--repair-disparity", "on"),
    ],
}


def run(folder, command, *before):
    """A command in a process whose caches lie in the folder, where no variable forbids telemetry."""
    home = folder / "home"
    home.mkdir()
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "HOME": str(home), "XDG_CACHE_HOME": str(home)}
    environment.pop("ORT_DISABLE_TELEMETRY", None)
    words = [*before, sys.executable, "-m", "bokehnet", *COMMANDS[command]]
    done = subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, timeout=580)
    assert done.returncode == 0, done.stderr
    assert (folder / "out.png").stat().st_size > 100_000
    return home


@pytest.mark.parametrize("command", COMMANDS)
def test_no_number_for_the_device_is_kept(tmp_path, command):
    """ONNX Runtime 1.31 would keep one in the folder of caches, in ``Microsoft/DeveloperTools``."""
    home = run(tmp_path, command)
    assert {path.name for path in home.iterdir()} <= {"numba"}


@pytest.mark.parametrize("command", COMMANDS)
def test_no_socket_of_the_internet_is_opened(tmp_path, command):
    """The authority is the kernel: ``strace`` sees every system call of all threads and children."""
    tracer = shutil.which("strace")
    if tracer is None:
        pytest.skip("needs strace, which is not installed")
    log = tmp_path / "calls.txt"
    probe = subprocess.run([tracer, "-o", str(log), "true"], capture_output=True)
    if probe.returncode != 0:
        pytest.skip("needs the right to trace processes, which is not given here")
    run(tmp_path, command, tracer, "-f", "-e", "trace=network", "-o", str(log))
    calls = log.read_text()
    assert "exited with 0" in calls  # it was traced to its end
    assert [line for line in calls.splitlines() if "AF_INET" in line] == []
