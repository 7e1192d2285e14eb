"""The service as its clients have it: a process that listens, and pictures over HTTP.

What comes out is compared with what the command line writes, byte for byte.
"""

import json
import os
import signal
import socket
import time

import pytest

httpx = pytest.importorskip("httpx", reason="asks the service")
for module in ("fastapi", "uvicorn", "prometheus_client"):
    pytest.importorskip(module, reason="needs the extra serve")

from tests.unit.serve.running import COMMAND, SETTINGS, service, write_scene  # noqa: E402

pytestmark = pytest.mark.timeout(180)

TOKEN = {"Authorization": "Bearer 0123456789abcdef"}
OTHER = {"Authorization": "Bearer fedcba9876543210"}


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scene")
    write_scene(folder)
    (folder / "large").mkdir()
    write_scene(folder / "large", 600, 800)
    return folder


@pytest.fixture(scope="module")
def running(tmp_path_factory):
    folder = tmp_path_factory.mktemp("service")
    options = ("--max-pixels", "600000", "--max-upload", "3M", "--queue", "6", "--patience", "1")
    with service(folder / "jobs", *options) as result:
        yield result


def problem(answer):
    assert answer.headers["content-type"] == "application/problem+json"
    response = answer.json()
    assert response["status"] == answer.status_code
    assert "\n" not in response.get("detail", "")
    return response


def test_the_result_is_that_of_the_command_line(running, scene, cli, tmp_path):
    answer = running.post(scene)
    assert answer.status_code == 202
    response = running.wait(answer.json()["id"])
    assert (response["state"], response["attempts"]) == ("done", 1)
    assert response["report"]["largest_blur_px"] == pytest.approx(6, abs=0.1)
    result = running.client.get(response["links"]["result"])
    assert result.headers["content-type"] == "image/png"
    options = ("--disparity", scene / "disparity.png", *COMMAND, "-o", tmp_path / "out.png")
    assert cli("render", scene / "image.png", *options).code == 0
    assert result.content == (tmp_path / "out.png").read_bytes()


def test_a_picture_without_depth_alone_is_refused_at_submission(running, scene):
    files = {"image": ("image.png", (scene / "image.png").read_bytes())}
    response = problem(running.client.post("/v1/jobs", files=files))
    assert (response["status"], response["parameter"]) == (422, "image")
    assert "`disparity`, `depth` and `defocus`" in response["detail"]
    network = {"settings": json.dumps({"input": {"depth_model": "depth-pro"}})}
    response = problem(running.client.post("/v1/jobs", files=files, data=network))
    assert (response["parameter"], "not pinned" in response["detail"]) == ("input.depth_model", True)
    files |= {"disparity": ("disparity.png", b"")}
    response = problem(running.client.post("/v1/jobs", files=files))
    assert (response["status"], response["parameter"]) == (422, "disparity")


def test_the_page_of_the_interface_loads_nothing(running):
    answer = running.client.get("/docs")
    assert answer.status_code == 200
    assert answer.headers["content-security-policy"].startswith("default-src 'none'")
    for word in ("POST /v1/jobs", "aperture_image", "f_number", "0.1 to 10", "petzval", "/openapi.json"):
        assert word in answer.text
    for word in ("<script", "src=", "@import", "url("):
        assert word not in answer.text


def test_progress_is_reported_and_ends_with_the_outcome(running, scene):
    job = running.post(scene / "large").json()["id"]
    events = []
    with running.client.stream("GET", f"/v1/jobs/{job}/events") as answer:
        assert answer.headers["content-type"].startswith("text/event-stream")
        for line in answer.iter_lines():
            if line.startswith("event: "):
                events.append(line.removeprefix("event: "))
            elif line.startswith("data: "):
                last = json.loads(line.removeprefix("data: "))
    assert events[-1] == "done"
    assert set(events[:-1]) == {"progress"}
    assert last["links"]["result"]


def test_a_key_brings_the_same_job_and_another_request_with_it_is_refused(running, scene):
    key = {"Idempotency-Key": "one"}
    first, again = running.post(scene, key), running.post(scene, key)
    assert first.json()["id"] == again.json()["id"]
    running.wait(first.json()["id"])
    assert running.post(scene, key).status_code == 200
    response = problem(running.post(scene, key, format="jpg"))
    assert (response["status"], response["type"]) == (422, "urn:bokehnet:problem:idempotency")


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"settings": json.dumps({"camera": {"blur": -1}})}, ["camera.blur", "at least 0", "-1"]),
        (
            {"settings": json.dumps({"camera": {"blurr": 1}})},
            ["camera.blurr", "unknown option", "did you mean camera.blur?"],
        ),
        ({"settings": "{"}, ["settings: expected a JSON object"]),
        ({"settings": "[" * 100_000}, ["settings: expected a JSON object"]),
        ({"settings": "7"}, ["settings: expected a JSON object, found int"]),
        (
            {"settings": json.dumps({"input": {"depth": "/etc/passwd"}})},
            ["input.depth", "send it as the file"],
        ),
        ({"settings": json.dumps({"aperture": {"image": "a.png"}})}, ["aperture.image", "`aperture_image`"]),
        ({"settings": json.dumps({"engine": {"weights": "/tmp"}})}, ["engine.weights", "leave it out"]),
        ({"settings": json.dumps({"output": {"save_maps": "/tmp"}})}, ["output.save_maps", "leave it out"]),
        (
            {"settings": json.dumps({"lens": {"name": "/etc/lens.toml"}})},
            ["lens.name", "comes with the package"],
        ),
        ({"settings": json.dumps({"input": {"depth_model": "x.onnx"}})}, ["input.depth_model"]),
        ({"settings": json.dumps({"lens": {"name": "double_gaus"}})}, ["did you mean double_gauss?"]),
        ({"preset": "../../x.toml"}, ["preset", "anamorphic"]),
        ({"format": "exe"}, ["format", "png"]),
        ({"image_url": "https://example.org/a.png"}, ["image", "one of `image` and `image_url`, got both"]),
    ],
)
def test_a_mistake_is_a_problem_document_and_no_job(running, scene, fields, words):
    before = sorted(os.listdir(running.folder / "jobs"))
    answer = running.post(scene, **fields)
    assert answer.status_code == 422
    response = problem(answer)
    for word in words:
        assert word in response["detail"]
    assert sorted(os.listdir(running.folder / "jobs")) == before
    assert os.listdir(running.folder / "incoming") == []


def test_an_address_that_was_not_allowed_is_not_fetched(running):
    answer = running.client.post("/v1/jobs", data={"image_url": "http://127.0.0.1/a.png"})
    assert "none in this service" in problem(answer)["detail"]


def test_a_file_that_is_no_picture_fails_as_a_job(running, scene):
    files = {
        "image": ("a.png", b"no picture"),
        "disparity": ("d.png", (scene / "disparity.png").read_bytes()),
    }
    answer = running.client.post("/v1/jobs", files=files, data={"settings": json.dumps(SETTINGS)})
    response = running.wait(answer.json()["id"])
    assert (response["state"], response["problem"]["type"]) == ("failed", "urn:bokehnet:problem:input")
    assert str(running.folder) not in response["problem"]["detail"]
    result = running.client.get(f"/v1/jobs/{response['id']}/result")
    assert problem(result) == response["problem"]


def test_too_many_pixels_fail_and_too_many_bytes_are_refused(running, scene, tmp_path):
    write_scene(tmp_path, 700, 1000)
    response = running.wait(running.post(tmp_path).json()["id"])
    assert response["problem"]["type"] == "urn:bokehnet:problem:too-many-pixels"
    assert "1000x700" in response["problem"]["detail"]
    answer = running.client.post("/v1/jobs", files={"image": ("a.png", bytes(4 * 2**20))})
    assert (answer.status_code, problem(answer)["title"]) == (413, "The request is too large")


def test_a_stalled_client_gets_an_error(running):
    host, port = running.address.removeprefix("http://").split(":")
    with socket.create_connection((host, int(port)), timeout=20) as connection:
        head = "POST /v1/jobs HTTP/1.1\r\nHost: x\r\nContent-Type: multipart/form-data; boundary=b\r\n"
        connection.sendall(f"{head}Content-Length: 1000\r\n\r\n--b\r\n".encode())
        answer = b"".join(iter(lambda: connection.recv(4096), b"")).decode()
    assert answer.startswith("HTTP/1.1 408")
    assert "urn:bokehnet:problem:too-slow" in answer


def test_a_job_can_be_cancelled_and_removed(running, scene):
    job = running.post(scene / "large").json()["id"]
    assert running.client.delete(f"/v1/jobs/{job}").status_code == 204
    assert running.wait(job)["state"] == "cancelled"
    assert running.client.get(f"/v1/jobs/{job}/result").status_code == 410
    assert running.client.delete(f"/v1/jobs/{job}").status_code == 204
    assert problem(running.client.get(f"/v1/jobs/{job}"))["status"] == 404
    assert running.wait(running.post(scene).json()["id"])["state"] == "done"


def test_the_queue_is_bounded(running, scene):
    answers = [running.post(scene / "large") for _ in range(8)]
    full = [answer for answer in answers if answer.status_code == 429]
    assert full
    assert problem(full[0])["type"] == "urn:bokehnet:problem:queue-full"
    assert int(full[0].headers["retry-after"]) > 0
    for answer in answers:
        if answer.status_code == 202:
            running.client.delete(f"/v1/jobs/{answer.json()['id']}")


def test_a_killed_worker_loses_and_doubles_no_job(running, scene):
    deaths, doubled = (running.metric(f"bokehnet_{name}_total") for name in ("worker_deaths", "jobs_doubled"))
    job = running.post(scene / "large").json()["id"]
    running.wait(job, states=("running",))
    for pid in running.workers():
        os.kill(pid, signal.SIGKILL)
    response = running.wait(job)
    assert (response["state"], response["attempts"]) == ("done", 2)
    assert running.metric("bokehnet_worker_deaths_total") == deaths + 1
    assert running.metric("bokehnet_jobs_doubled_total") == doubled


def test_the_api_describes_itself(running):
    response = running.client.get("/openapi.json").json()
    assert set(response["paths"]) >= {
        "/v1/jobs",
        "/v1/jobs/{job}",
        "/v1/jobs/{job}/result",
        "/v1/jobs/{job}/events",
    }
    assert running.client.get("/healthz").json()["status"] == "ok"


@pytest.mark.slow
def test_a_service_that_is_killed_does_its_jobs_after_a_restart(scene, tmp_path, monkeypatch):
    with service(tmp_path / "jobs", stop=signal.SIGKILL) as first:
        jobs = [first.post(scene / "large").json()["id"] for _ in range(2)]
        first.wait(jobs[0], states=("running",))
    with service(tmp_path / "jobs") as second:
        reports = [second.wait(job) for job in jobs]
    assert [one["state"] for one in reports] == ["done", "done"]
    assert len(list((tmp_path / "jobs/jobs").glob("*/outcome.json"))) == 2


def test_sigterm_ends_what_runs_and_keeps_what_waits(scene, tmp_path):
    with service(tmp_path / "jobs") as running:
        jobs = [running.post(scene / "large").json()["id"] for _ in range(3)]
        running.wait(jobs[0], states=("running",))
        running.process.send_signal(signal.SIGTERM)
        time.sleep(0.1)
        refused = running.post(scene)
        assert (refused.status_code, running.client.get("/readyz").status_code) == (503, 503)
    ended = {path.parent.name for path in (tmp_path / "jobs/jobs").glob("*/outcome.json")}
    assert jobs[0] in ended
    assert jobs[2] not in ended
    assert jobs[2] in os.listdir(tmp_path / "jobs/queue")


def test_tokens_part_the_clients(scene, tmp_path):
    (tmp_path / "tokens").write_text("me: 0123456789abcdef  # mine\nyou: fedcba9876543210\n")
    with service(tmp_path / "jobs", "--tokens", str(tmp_path / "tokens")) as running:
        for headers in (None, {"Authorization": "Bearer wrong-wrong-wrong"}, {"Authorization": "Basic x"}):
            answer = running.post(scene, headers)
            assert (answer.status_code, answer.headers["www-authenticate"]) == (401, "Bearer")
            problem(answer)
        assert running.client.get("/metrics").status_code == 401
        job = running.post(scene, TOKEN).json()["id"]
        assert running.wait(job, headers=TOKEN)["state"] == "done"
        assert running.client.get(f"/v1/jobs/{job}", headers=OTHER).status_code == 404


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--host", "0.0.0.0"], ["--tokens", "open to other machines"]),
        (["--workers", "-1"], ["--workers", "0 to 256"]),
        (["--max-upload", "much"], ["--max-upload"]),
        (["--tokens", "none"], ["none"]),
    ],
)
def test_an_impossible_service_reports_the_reason(cli, tmp_path, monkeypatch, options, words):
    monkeypatch.chdir(tmp_path)
    outcome = cli("serve", *options)
    assert (outcome.code, outcome.err.count("\n")) == (1, 1)
    for word in words:
        assert word in outcome.err


def test_the_program_names_missing_options(python_process):
    source = (
        "import sys; sys.modules['fastapi'] = None\n"
        "from bokehnet.cli.app import run; sys.exit(run(['serve']))"
    )
    outcome = python_process(source)
    assert (outcome.code, "pip install 'bokehnet[serve]'" in outcome.err) == (1, True)
