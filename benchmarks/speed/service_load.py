"""Load test of the service: its command, HTTP clients, killed workers, a full queue.

    python -m benchmarks.speed.service_load [--jobs 60] [--kills 20] [--steady 500] [--size 240x180]

Each client sends a picture and its disparity, waits for the end, and fetches the result; every result must
have the same bytes as the first. Prints pictures per second and the 50th, 95th and 99th percentile of the
time from the request to the fetched picture for 1, 4 and 16 clients; then the lost or duplicated jobs after
20 kills of random workers; the number of requests that a full queue refuses; and the memory of the service
and its workers over many jobs. ``--ray N`` uses N replicas of Ray Serve on a local cluster instead.
"""

import argparse
import contextlib
import hashlib
import json
import os
import random
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx
import numpy as np

from bokehnet.io.image import write_image, write_map

_SETTINGS = json.dumps({"camera": {"blur": 24}, "focus": {"value": 0.5}, "depth": {"repair": "off"}})
_CLIENTS = (1, 4, 16)
_JOB_TIMEOUT_S = 300.0  # under load
_START_TIMEOUT_S = 120.0  # of the service


class Client:
    """Client that sends one picture repeatedly.

    Args:
        address: Address of the service.
        files: Content of the upload by field.
    """

    def __init__(self, address: str, files: dict[str, bytes]) -> None:
        self._files = {name: (f"{name}.png", content) for name, content in files.items()}
        self._client = httpx.Client(base_url=address, timeout=60, trust_env=False)

    def submit(self, key: str | None = None) -> httpx.Response:
        """Submit a job; with a key, retry while the queue is full."""
        headers = {} if key is None else {"Idempotency-Key": key}
        while True:
            response = self._client.post(
                "/v1/jobs", files=self._files, data={"settings": _SETTINGS}, headers=headers
            )
            if key is None or response.status_code != 429:
                return response
            time.sleep(0.2)

    def picture(self, key: str) -> tuple[float, str]:
        """Return the seconds that a picture took, and its SHA-256."""
        start = time.perf_counter()
        job = self.submit(key).raise_for_status().json()["id"]
        while time.perf_counter() - start < _JOB_TIMEOUT_S:
            status = self._client.get(f"/v1/jobs/{job}").json()
            if status["state"] == "done":
                content = self._client.get(status["links"]["result"]).raise_for_status().content
                return time.perf_counter() - start, hashlib.sha256(content).hexdigest()
            if status["state"] in ("failed", "cancelled"):
                raise RuntimeError(str(status))
            time.sleep(0.02)
        raise TimeoutError(job)

    def counter(self, name: str) -> float:
        """Return a counter of the service, 0 if it does not exist."""
        for line in self._client.get("/metrics").text.splitlines():
            if line.rpartition(" ")[0] == name:
                return float(line.rpartition(" ")[2])
        return 0.0


@contextlib.contextmanager
def served(folder: Path, *options: str) -> Iterator[tuple[str, int]]:
    """Run ``bokehnet serve``; yield its address and process ID."""
    with socket.socket() as free_socket:
        free_socket.bind(("127.0.0.1", 0))
        port = free_socket.getsockname()[1]
    command = [
        sys.executable,
        "-m",
        "bokehnet",
        "serve",
        "--port",
        str(port),
        "--folder",
        str(folder),
        *options,
    ]
    with (folder.parent / "service.log").open("wb") as log:
        process = subprocess.Popen(command, stdout=log, stderr=log)
        try:
            _wait(f"http://127.0.0.1:{port}")
            yield f"http://127.0.0.1:{port}", process.pid
        finally:
            process.send_signal(signal.SIGTERM)
            process.wait(90)


@contextlib.contextmanager
def served_by_ray(folder: Path, replicas: int) -> Iterator[tuple[str, int]]:
    """Run the application behind Ray Serve on a local cluster; yield its address and process ID."""
    import ray
    from ray import serve

    from bokehnet.serve.ray_app import application
    from bokehnet.serve.service_settings import ServiceSettings

    ray.init(num_cpus=max(2, replicas), include_dashboard=False, log_to_driver=False)
    try:
        serve.start(http_options={"port": 8123})
        serve.run(application(ServiceSettings(folder=folder.absolute()), replicas=replicas))
        _wait("http://127.0.0.1:8123")
        yield "http://127.0.0.1:8123", os.getpid()
    finally:
        serve.shutdown()
        ray.shutdown()


def _wait(address: str) -> None:
    end = time.monotonic() + _START_TIMEOUT_S
    while time.monotonic() < end:
        with contextlib.suppress(httpx.HTTPError):
            if httpx.get(f"{address}/readyz", trust_env=False).status_code == 200:
                return
        time.sleep(0.1)
    raise TimeoutError(address)


def workers(pid: int) -> list[int]:
    """Return the worker processes of a service."""
    children = []
    for task in Path(f"/proc/{pid}/task").iterdir():
        children += [int(word) for word in (task / "children").read_text().split()]
    return [child for child in children if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes()]


def resident(pid: int) -> float:
    """Return the resident memory of a process, MiB."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20


def run_clients(
    address: str, files: dict[str, bytes], clients: int, jobs: int, name: str
) -> list[tuple[float, str]]:
    """Run ``clients`` clients that request ``jobs`` pictures in total."""
    local = threading.local()

    def one(number: int) -> tuple[float, str]:
        if not hasattr(local, "client"):
            local.client = Client(address, files)
        return local.client.picture(f"{name}-{number}")

    with ThreadPoolExecutor(clients) as pool:
        return list(pool.map(one, range(jobs)))


def summary(seconds: list[float], total: float) -> str:
    """Return throughput and percentiles as one line."""
    p50, p95, p99 = np.percentile(seconds, [50, 95, 99])
    return f"{len(seconds) / total:5.2f} pictures/s   p50 {p50:6.2f} s   p95 {p95:6.2f} s   p99 {p99:6.2f} s"


def main() -> int:
    """Print the figures; return 1 if a job was lost, duplicated, or gave other bytes."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--jobs", type=int, default=60, help="jobs for each number of clients")
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--steady", type=int, default=500, help="number of jobs of the memory measurement")
    parser.add_argument("--size", default="240x180")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--ray", type=int, default=0, metavar="N", help="use N replicas of Ray Serve instead")
    arguments = parser.parse_args()
    width, height = map(int, arguments.size.split("x"))
    bad = 0
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        rng = np.random.default_rng(0)
        write_image(folder / "image.png", rng.random((height, width, 3), dtype=np.float32))
        steps = np.repeat(np.linspace(0, 1, 8, dtype=np.float32), width // 8 + 1)[:width]
        write_map(folder / "disparity.png", np.tile(steps, (height, 1)))
        files = {name: (folder / f"{name}.png").read_bytes() for name in ("image", "disparity")}
        context = (
            served_by_ray(folder / "jobs", arguments.ray)
            if arguments.ray
            else served(folder / "jobs", "--workers", str(arguments.workers), "--queue", "64")
        )
        with context as (address, pid):
            client = Client(address, files)
            run_clients(address, files, 4, 4, "warm")
            expected = client.picture("first")[1]
            for clients in _CLIENTS:
                start = time.perf_counter()
                results = run_clients(address, files, clients, arguments.jobs, f"load-{clients}")
                seconds = time.perf_counter() - start
                print(f"{clients:3} clients: {summary([result[0] for result in results], seconds)}")
                bad += sum(result[1] != expected for result in results)
            if not arguments.ray:
                bad += _kill(address, files, pid, arguments.kills, expected)
                _fill(address, files)
                _watch(address, files, pid, arguments.steady)
        outcomes = len(list((folder / "jobs/jobs").glob("*/outcome.json")))
        accepted = len(list((folder / "jobs/jobs").iterdir()))
        print(f"jobs accepted {accepted}, with an outcome {outcomes}; results of other bytes: {bad}")
    return 1 if bad or accepted != outcomes else 0


def _kill(address: str, files: dict[str, bytes], pid: int, kills: int, expected: str) -> int:
    """Kill random workers under load; return the number of wrong or duplicated pictures."""
    client, over, killed = Client(address, files), threading.Event(), 0

    def killer() -> None:
        nonlocal killed
        rng, watch = random.Random(0), Client(address, files)
        while killed < kills and not over.is_set():
            time.sleep(rng.uniform(1, 3))
            if not watch.counter("bokehnet_jobs_running"):
                continue  # all workers are starting
            with contextlib.suppress(OSError, IndexError):
                os.kill(rng.choice(workers(pid)), signal.SIGKILL)
                killed += 1

    thread = threading.Thread(target=killer)
    thread.start()
    results: list[tuple[float, str]] = []
    start = time.perf_counter()
    while thread.is_alive():
        results += run_clients(address, files, 4, 8, f"kill-{len(results)}")
    over.set()
    thread.join()
    wrong = sum(result[1] != expected for result in results)
    deaths = client.counter("bokehnet_worker_deaths_total")
    doubled = int(client.counter("bokehnet_jobs_doubled_total"))
    print(
        f"{killed} kills, {deaths:.0f} of them with a job in hand, in {time.perf_counter() - start:.0f} s: "
        f"{len(results)} jobs asked for, {len(results) - wrong} right, 0 lost, {doubled} doubled"
    )
    return wrong + doubled


def _fill(address: str, files: dict[str, bytes]) -> None:
    """Submit more jobs than the queue accepts."""
    client = Client(address, files)
    codes = [client.submit().status_code for _ in range(100)]
    print(f"100 requests at once: {codes.count(202)} accepted, {codes.count(429)} answered with 429")


def _watch(address: str, files: dict[str, bytes], pid: int, jobs: int) -> None:
    """Print the memory of the service and its workers after each tenth of the jobs."""
    rows = []
    for tenth in range(10):
        run_clients(address, files, 4, jobs // 10, f"steady-{tenth}")
        rows.append((resident(pid), max(map(resident, workers(pid)))))
    service, worker = zip(*rows, strict=True)
    print(f"memory over {jobs} jobs, MiB: service {service[0]:.0f} .. {service[-1]:.0f}, ", end="")
    print(f"largest worker {worker[0]:.0f} .. {worker[-1]:.0f} (highest {max(worker):.0f})")


if __name__ == "__main__":
    sys.exit(main())
