"""A service in a process of its own, as its users run it, and requests to it."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import numpy as np

from bokehnet.io.image import write_image, write_map

SETTINGS = {"camera": {"blur": 12}, "focus": {"value": 0.5}, "depth": {"repair": "off"}}
ENDED = ("done", "failed", "cancelled")
COMMAND = ["--blur", "12", "--focus", "0.5", "--repair-disparity", "off"]


@dataclass
class Service:
    """Its process, its address, and the folder of its jobs."""

    process: subprocess.Popen
    address: str
    folder: Path
    client: httpx.Client

    def post(self, folder: Path, headers: dict[str, str] | None = None, **fields: Any) -> httpx.Response:
        """Ask for photo.png with disparity.png of a folder to be rendered."""
        fields = {"settings": json.dumps(SETTINGS)} | fields
        files = {
            name: (f"{name}.png", (folder / f"{name}.png").read_bytes()) for name in ("image", "disparity")
        }
        return self.client.post("/v1/jobs", data=fields, files=files, headers=headers)

    def wait(
        self,
        job: str,
        seconds: float = 60,
        headers: dict[str, str] | None = None,
        states: tuple[str, ...] = ENDED,
    ) -> dict[str, Any]:
        """Wait until a job is in one of some states; return its description."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            response = self.client.get(f"/v1/jobs/{job}", headers=headers).json()
            if response["state"] in states:
                return response
            time.sleep(0.02)
        raise TimeoutError(str(response))

    def workers(self) -> list[int]:
        """Processes that render."""
        return [pid for pid in children(self.process.pid) if b"spawn_main" in command_line(pid)]

    def metric(self, name: str) -> float:
        """A counter's value; 0 where it has not been counted yet."""
        for line in self.client.get("/metrics").text.splitlines():
            if line.rpartition(" ")[0] == name:
                return float(line.rpartition(" ")[2])
        return 0.0


def children(pid: int) -> list[int]:
    """Processes of a process."""
    results = []
    for task in Path(f"/proc/{pid}/task").iterdir():
        results += [int(word) for word in (task / "children").read_text().split()]
    return results


def command_line(pid: int) -> bytes:
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return b""


def write_scene(folder: Path, height: int = 48, width: int = 64) -> None:
    """Write image.png, noise, and disparity.png, which rises to the right."""
    rng = np.random.default_rng(0)
    write_image(folder / "image.png", rng.random((height, width, 3), dtype=np.float32))
    ramp = np.tile(np.linspace(0, 1, width, dtype=np.float32), (height, 1))
    write_map(folder / "disparity.png", ramp)


@contextmanager
def service(folder: Path, *options: str, stop: int = signal.SIGTERM) -> Iterator[Service]:
    """Run ``bokehnet serve`` on a free port with its jobs in ``folder``."""
    command = [sys.executable, "-m", "bokehnet", "serve", "--port", "0", "--folder", str(folder), *options]
    with (folder.parent / "service.log").open("ab") as log:
        begun = log.tell()
        process = subprocess.Popen(
            command, stderr=log, stdout=log, env={**os.environ, "PYTHONUNBUFFERED": "1"}
        )
        try:
            address = _address(process, folder.parent / "service.log", begun)
            with httpx.Client(base_url=address, timeout=60, trust_env=False) as client:
                yield Service(process, address, folder, client)
        finally:
            process.send_signal(stop)
            try:
                process.wait(30)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
                raise


def _address(process: subprocess.Popen, log: Path, begun: int) -> str:
    end = time.monotonic() + 60
    while time.monotonic() < end and process.poll() is None:
        for line in log.read_bytes()[begun:].decode().splitlines():
            if "running on " in line:
                return line.split("running on ")[1].split()[0]
        time.sleep(0.05)
    raise RuntimeError(log.read_bytes()[begun:].decode())
