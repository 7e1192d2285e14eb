"""The application behind Ray Serve, on a cluster of this machine: replicas share a folder, one is killed."""

import hashlib
import json
import os
import signal
import time
from pathlib import Path

import pytest

from bokehnet.errors import ParameterError
from bokehnet.serve.ray_app import application, settings_from_environment
from bokehnet.serve.service_settings import ServiceSettings

httpx = pytest.importorskip("httpx", reason="asks the service")

from tests.unit.serve.running import ENDED, SETTINGS, command_line, write_scene  # noqa: E402

JOBS, PORT = 8, 8133


def test_environment_variables_identify_a_replica():
    message = settings_from_environment(
        {"BOKEHNET_SERVE_WORKERS": "2", "BOKEHNET_SERVE_MAX_UPLOAD": "2M", "HOME": "x"}
    )
    assert message == ServiceSettings(workers=2, max_upload=2 * 2**20)
    with pytest.raises(ParameterError, match="workers"):
        settings_from_environment({"BOKEHNET_SERVE_WORKERS": "many"})


def replicas() -> list[int]:
    """Processes of replicas, as Ray names them."""
    results = [int(path.name) for path in Path("/proc").iterdir() if path.name.isdigit()]
    return [pid for pid in results if b"ServeReplica" in command_line(pid)]


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_two_replicas_share_the_work_and_a_killed_one_loses_nothing(tmp_path):
    ray = pytest.importorskip("ray", reason="needs the extra cluster")
    serve = pytest.importorskip(
        "ray.serve", reason="needs Ray Serve: pip install 'bokehnet[serve-cluster]'", exc_type=ImportError
    )
    write_scene(tmp_path, 240, 320)
    files = {
        name: (f"{name}.png", (tmp_path / f"{name}.png").read_bytes()) for name in ("image", "disparity")
    }
    ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False)
    try:
        serve.start(http_options={"port": PORT})
        serve.run(application(ServiceSettings(folder=tmp_path / "jobs"), replicas=2))
        with httpx.Client(base_url=f"http://127.0.0.1:{PORT}", timeout=60, trust_env=False) as client:
            fields = {"settings": json.dumps(SETTINGS)}
            jobs = [
                client.post("/v1/jobs", files=files, data=fields, headers={"Idempotency-Key": str(number)})
                .raise_for_status()
                .json()["id"]
                for number in range(JOBS)
            ]
            assert len(set(jobs)) == JOBS
            before = replicas()
            assert len(before) == 2
            os.kill(before[0], signal.SIGKILL)
            contents, end = {}, time.monotonic() + 150
            while len(contents) < JOBS and time.monotonic() < end:
                for job in jobs:
                    answer = client.get(f"/v1/jobs/{job}")
                    if answer.status_code == 200 and answer.json()["state"] in ENDED and job not in contents:
                        result = client.get(f"/v1/jobs/{job}/result").raise_for_status()
                        contents[job] = hashlib.sha256(result.content).hexdigest()
                time.sleep(0.2)
    finally:
        serve.shutdown()
        ray.shutdown()
    assert set(contents) == set(jobs)
    assert len(set(contents.values())) == 1
    for job in jobs:
        assert len(list((tmp_path / "jobs/jobs" / job).glob("result-*"))) == 1
