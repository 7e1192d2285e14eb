"""A service under attack renders, and loses or doubles nothing. Authority: its counters and files."""

import asyncio
import contextlib
import http.client
import json
import os
import resource
import signal
import socket
import time
from collections import Counter
from urllib.parse import urlsplit

import pytest

pytest.importorskip("fastapi", reason="needs the extra serve")

from tests.unit.serve.running import SETTINGS, service, write_scene

pytestmark = pytest.mark.slow

HALF_OPEN = 1100


@pytest.fixture
def attacked(tmp_path):
    write_scene(tmp_path)
    with service(tmp_path / "jobs", "--workers", "1") as running:
        yield running


@pytest.fixture
def many_files():
    """Room for the sockets of the attacker."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard != resource.RLIM_INFINITY and hard < HALF_OPEN + 200:
        pytest.skip(f"needs {HALF_OPEN + 200} open files, the limit is {hard}")
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, HALF_OPEN + 200), hard))
    yield
    resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


@pytest.mark.parametrize("sent", [b"", b"POST /v1/jobs HTTP/1.1\r\nHost: a\r\n", b"GET / HTTP/1.1\r\nX: "])
def test_half_open_connections_do_not_stop_it(attacked, many_files, tmp_path, sent):
    place = urlsplit(attacked.address)
    with contextlib.ExitStack() as stack:
        for _ in range(HALF_OPEN):
            one = stack.enter_context(socket.create_connection((place.hostname, place.port), timeout=20))
            if sent:
                with contextlib.suppress(OSError):  # already closed for a newer one
                    one.sendall(sent)
        answer = attacked.post(tmp_path)
        assert answer.status_code == 202
        assert attacked.wait(answer.json()["id"])["state"] == "done"
        files = len(os.listdir(f"/proc/{attacked.process.pid}/fd"))
        assert files < HALF_OPEN


def test_kills_of_workers_lose_and_double_nothing(attacked, tmp_path):
    jobs = [attacked.post(tmp_path).json()["id"] for _ in range(8)]
    for _ in range(20):
        end = time.monotonic() + 20
        while not (workers := attacked.workers()) and time.monotonic() < end:
            time.sleep(0.05)
        with contextlib.suppress(ProcessLookupError):
            os.kill(workers[0], signal.SIGKILL)
        time.sleep(0.2)
    assert Counter(attacked.wait(job, 180)["state"] for job in jobs) == {"done": 8}
    folder = tmp_path / "jobs" / "jobs"
    assert {job: len(list((folder / job).glob("outcome.json"))) for job in jobs} == dict.fromkeys(jobs, 1)
    assert attacked.metric("bokehnet_jobs_doubled_total") == 0


def test_damaged_jobs_are_reported_and_others_rendered(attacked, tmp_path):
    done = attacked.post(tmp_path).json()["id"]
    attacked.wait(done)
    folder = tmp_path / "jobs" / "jobs"
    (folder / done / "outcome.json").write_bytes(b"\0" * 40)
    stray = attacked.post(tmp_path).json()["id"]
    with contextlib.suppress(FileNotFoundError):
        (folder / stray / "claim-x").touch()
    answer = attacked.client.get(f"/v1/jobs/{done}")
    assert (answer.status_code, answer.json()["type"]) == (500, "urn:bokehnet:problem:damaged")
    assert attacked.wait(stray)["state"] == "done"
    last = attacked.post(tmp_path).json()["id"]
    assert attacked.wait(last)["state"] == "done"
    assert attacked.client.get("/readyz").status_code == 200


@pytest.mark.parametrize("damage", ["cut", "zeros", "missing"])
def test_a_damaged_result_is_never_delivered(attacked, tmp_path, damage):
    """Authority: the bytes that were rendered; anything else is reported as damage."""
    job = attacked.post(tmp_path).json()["id"]
    attacked.wait(job)
    whole = attacked.client.get(f"/v1/jobs/{job}/result").content
    (path,) = (tmp_path / "jobs" / "jobs" / job).glob("result-*")
    assert path.read_bytes() == whole
    path.unlink()
    if damage != "missing":
        path.write_bytes(whole[: len(whole) // 2] if damage == "cut" else bytes(len(whole)))
    answer = attacked.client.get(f"/v1/jobs/{job}/result")
    assert (answer.status_code, answer.json()["type"]) == (500, "urn:bokehnet:problem:damaged")
    assert attacked.wait(attacked.post(tmp_path).json()["id"])["state"] == "done"


def damage(path, kind):
    """Damage an uploaded file: one bit, its end, its place, or another intact picture instead."""
    data = path.read_bytes()
    path.unlink()
    if kind == "folder":
        path.mkdir()
    elif kind != "missing":
        other = path.with_name("disparity.png" if path.name == "image.png" else "image.png")
        bit = data[:60] + bytes([data[60] ^ 1]) + data[61:]
        path.write_bytes({"bit": bit, "cut": data[: len(data) // 2], "other": other.read_bytes()}[kind])


def test_damaged_inputs_are_never_rendered(tmp_path):
    """Authority: the uploaded bytes. Jobs with others are reported and set aside, the rest is done."""
    write_scene(tmp_path)
    jobs = {}
    with service(tmp_path / "jobs", "--workers", "0") as accepting:
        for name in ("image.png", "disparity.png"):
            for kind in ("bit", "cut", "missing", "folder", "other"):
                jobs[accepting.post(tmp_path).json()["id"]] = name, kind
        intact = accepting.post(tmp_path).json()["id"]
    for job, (name, kind) in jobs.items():
        damage(tmp_path / "jobs" / "jobs" / job / name, kind)
    with service(tmp_path / "jobs", "--workers", "1") as rendering:
        assert rendering.wait(intact)["state"] == "done"
        for job, kind in jobs.items():
            answer = rendering.client.get(f"/v1/jobs/{job}")
            assert (answer.status_code, answer.json()["type"]) == (500, "urn:bokehnet:problem:damaged"), kind
        assert sorted(os.listdir(tmp_path / "jobs" / "damaged")) == sorted(jobs)
        assert rendering.metric('bokehnet_jobs_finished_total{state="damaged"}') == len(jobs)


def test_events_of_a_damaged_job_end_with_its_failure():
    """Authority: the stream ends with one final event, as that of every job."""
    from bokehnet.serve.app import _events
    from bokehnet.serve.jobs.store import DamagedJob

    def read():
        raise DamagedJob("job")

    async def collect():
        return [event async for event in _events(read)]

    (event,) = asyncio.run(collect())
    assert event.startswith("event: failed\n")
    assert json.loads(event.partition("data: ")[2])["problem"]["type"] == "urn:bokehnet:problem:damaged"


def test_odd_names_and_texts_get_problem_documents(attacked, tmp_path):
    answer = attacked.client.get(f"/v1/jobs/{'a' * 300}")
    assert (answer.status_code, answer.headers["content-type"]) == (404, "application/problem+json")
    odd = json.dumps(SETTINGS | {"\ud800": 1})
    answer = attacked.post(tmp_path, settings=odd)
    assert (answer.status_code, answer.headers["content-type"]) == (422, "application/problem+json")
    answer = attacked.post(tmp_path, settings=json.dumps({"focus": {"value": "\udfff" * 5000}}))
    assert answer.status_code == 422
    assert len(answer.content) < 10_000
    place = urlsplit(attacked.address)
    plain = http.client.HTTPConnection(place.hostname, place.port, timeout=10)
    plain.request("GET", "/v1/jobs/%ED%A0%80")  # a lone surrogate
    assert plain.getresponse().status == 404


def test_files_of_jobs_are_private(attacked, tmp_path):
    job = attacked.post(tmp_path).json()["id"]
    attacked.wait(job)
    folder = tmp_path / "jobs" / "jobs" / job
    assert folder.stat().st_mode & 0o777 == 0o700
    assert {path.name: path.stat().st_mode & 0o077 for path in folder.iterdir()} == {
        path.name: 0 for path in folder.iterdir()
    }


def test_a_full_queue_is_reported_before_the_upload(tmp_path):
    write_scene(tmp_path)
    with service(tmp_path / "jobs", "--workers", "0", "--queue", "1") as running:
        assert running.post(tmp_path).status_code == 202
        place = urlsplit(running.address)
        with socket.create_connection((place.hostname, place.port), timeout=10) as one:
            head = "POST /v1/jobs HTTP/1.1\r\nHost: a\r\nContent-Type: multipart/form-data; boundary=b\r\n"
            one.sendall(f"{head}Content-Length: 100000000\r\n\r\n".encode())
            assert one.recv(200).startswith(b"HTTP/1.1 429")
