"""The nodes inside the real ComfyUI, headless on the CPU, through its HTTP API.

``COMFYUI_ROOT`` is a checkout of Comfy-Org/ComfyUI, ``COMFYUI_PYTHON`` a Python that has its requirements and
this package (default: the one that runs the tests).
"""

import json
import os
import socket
import struct
import subprocess
import sys
import time
import urllib.error
import urllib.request
from pathlib import Path

import numpy as np
import pytest

from bokehnet.io.color.srgb import linear_to_srgb
from bokehnet.io.image import read_image, write_image
from tests.conftest import ROOT
from tests.hosts.archives import install
from tests.hosts.comfyui import web_socket

PACK = ROOT / "integrations/comfyui"
COMFYUI = os.environ.get("COMFYUI_ROOT")

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(400),
    pytest.mark.skipif(not COMFYUI, reason="needs COMFYUI_ROOT, a checkout of Comfy-Org/ComfyUI"),
]

HEIGHT, WIDTH = 90, 120


class Host:
    """A running ComfyUI."""

    def __init__(self, port: int, base: Path) -> None:
        self.port, self.base = port, base
        self.address = f"http://127.0.0.1:{port}"

    def ask(self, path: str, body: object = None) -> tuple[int, object]:
        """Ask its API; return status and answer."""
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(f"{self.address}{path}", data, {"Content-Type": "application/json"})
        try:
            with urllib.request.urlopen(request, timeout=30) as answer:
                code, text = answer.status, answer.read()
        except urllib.error.HTTPError as error:
            code, text = error.code, error.read()
        return code, json.loads(text or "{}")

    def begin(self, workflow: dict, client: str = "") -> str:
        """Queue a workflow."""
        code, response = self.ask("/prompt", {"prompt": workflow, "client_id": client})
        assert code == 200, response
        return response["prompt_id"]

    def end(self, name: str, seconds: float = 180) -> dict:
        """Wait for a workflow; return its history."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            history = self.ask(f"/history/{name}")[1]
            if name in history:
                return history[name]
            time.sleep(0.1)
        raise TimeoutError(name)

    def messages(self, history: dict) -> dict[str, dict]:
        return dict(history["status"]["messages"])


@pytest.fixture(scope="module")
def host(tmp_path_factory):
    base = tmp_path_factory.mktemp("comfyui")
    for name in ("custom_nodes", "input", "output", "temp", "user", "models"):
        (base / name).mkdir()
    install("comfyui", base / "custom_nodes", base / "downloads")
    rng = np.random.default_rng(3)
    coarse = rng.random((HEIGHT // 6, WIDTH // 6, 3), dtype=np.float32)
    write_image(base / "input/photo.png", np.kron(coarse, np.ones((6, 6, 1), np.float32)))
    steps = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    steps[:, 30:80], steps[40:, 60:] = 0.2, 1.0
    write_image(base / "input/disparity.png", steps)
    with socket.socket() as result:
        result.bind(("127.0.0.1", 0))
        port = result.getsockname()[1]
    command = [os.environ.get("COMFYUI_PYTHON", sys.executable), "main.py", "--cpu", "--port", str(port)]
    command += ["--base-directory", str(base), "--disable-api-nodes", "--database-url", "sqlite:///:memory:"]
    search = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    with (base / "log").open("wb") as log:
        process = subprocess.Popen(
            command, cwd=COMFYUI, stdout=log, stderr=log, env={**os.environ, "PYTHONPATH": search}
        )
        try:
            running = Host(port, base)
            end = time.monotonic() + 180
            while True:
                try:
                    running.ask("/system_stats")
                    break
                except OSError:
                    assert process.poll() is None, (base / "log").read_text()
                    assert time.monotonic() < end, (base / "log").read_text()
                    time.sleep(0.3)
            yield running
        finally:
            process.terminate()
            process.wait(30)


def workflow(name: str) -> dict:
    return json.loads((PACK / f"example_workflows/{name}.json").read_text())


def psnr(a: np.ndarray, b: np.ndarray) -> float:
    return float(-10 * np.log10(max(float(np.mean((a - b) ** 2)), 1e-20)))


def test_comfyui_lists_the_nodes(host):
    response = host.ask("/object_info")[1]
    names = {"Render", "FocusPicker", "Look", "DepthRepair", "ExpectedError", "Video", "Save"}
    assert {f"Bokeh{name}" for name in names} <= set(response)
    assert response["BokehLook"]["input"]["optional"]["cats_eye"][1]["max"] == 1.5


def test_a_workflow_gives_the_picture_of_the_command_line(host, cli, tmp_path, record_property):
    history = host.end(host.begin(workflow("still")))
    assert history["status"]["status_str"] == "success", history["status"]
    [file] = history["outputs"]["7"]["images"]
    assert history["outputs"]["6"]["images"]  # the preview
    own = read_image(host.base / "output" / file["subfolder"] / file["filename"])
    options = ("--disparity", host.base / "input/disparity.png", "--blur", "30", "--focus-at", "40,30")
    look = ("--blades", "6", "--cats-eye", "0.4", "-o", tmp_path / "out.exr")
    outcome = cli("render", host.base / "input/photo.png", *options, *look)
    assert outcome.code == 0, outcome.err
    record_property("dB to the command line", result := psnr(own, read_image(tmp_path / "out.exr")))
    assert result >= 60


def test_a_pull_gives_the_pictures_of_the_command_line(host, cli, tmp_path):
    """The command line renders each frame by itself, as the workflow repairs its one map by itself."""
    history = host.end(host.begin(workflow("focus_pull")))
    assert history["status"]["status_str"] == "success", history["status"]
    files = [host.base / "output" / item["filename"] for item in history["outputs"]["7"]["images"]]
    assert len(files) == 3 == len(history["outputs"]["6"]["images"])
    plain = ("--engine", "scatter", "--repair-disparity", "auto", "--bits", "16", "--dither", "off")
    for file, focus, blur in zip(files, ("0.2", "0.5", "0.8"), ("20", "25", "30"), strict=True):
        options = ("--disparity", host.base / "input/disparity.png", "--focus", focus, "--blur", blur)
        outcome = cli("render", host.base / "input/photo.png", *options, *plain, "-o", tmp_path / file.name)
        assert outcome.code == 0, outcome.err
        assert psnr(read_image(file), read_image(tmp_path / file.name)) >= 60


def test_maps_of_a_shot_are_steady_as_those_of_the_command_line(host, cli, tmp_path):
    shot = workflow("focus_pull")
    shot["3"]["inputs"]["amount"] = 5
    rng = np.random.default_rng(4)
    flat = read_image(host.base / "input/disparity.png")[..., :1].repeat(3, -1)
    flicker = [np.clip(flat + 0.2 * rng.random((HEIGHT, WIDTH, 1), np.float32), 0, 1) for _ in range(5)]
    batch = "20"
    for number, values in enumerate(flicker, start=1):
        write_image(host.base / f"input/d{number}.png", values)
        write_image(tmp_path / f"d.{number:04}.png", read_image(host.base / f"input/d{number}.png"), bits=16)
        write_image(tmp_path / f"in.{number:04}.png", read_image(host.base / "input/photo.png"), bits=16)
        shot[f"1{number}"] = {"class_type": "LoadImage", "inputs": {"image": f"d{number}.png"}}
        joined = {"image1": [batch, 0], "image2": [f"1{number}", 0]}
        if number > 1:
            batch = f"2{number}"
            shot[batch] = {"class_type": "ImageBatch", "inputs": joined}
        else:
            batch = f"1{number}"
    shot["5"]["inputs"] |= {"disparity": [batch, 0], "focus_to": 0.2, "blur_to": 20.0}
    shot["7"]["inputs"]["filename_prefix"] = "steady"
    history = host.end(host.begin(shot))
    assert history["status"]["status_str"] == "success", history["status"]
    files = [host.base / "output" / item["filename"] for item in history["outputs"]["7"]["images"]]
    options = ("--disparity", tmp_path / "d.####.png", "--engine", "scatter", "--repair-disparity", "off")
    plain = ("--blur", "20", "--focus", "0.2", "--bits", "16", "--dither", "off", "--frames", "1-5")
    outcome = cli("render", tmp_path / "in.####.png", "-o", tmp_path / "out.####.png", *options, *plain)
    assert outcome.code == 0, outcome.err
    for number, file in enumerate(files, start=1):
        assert psnr(read_image(file), read_image(tmp_path / f"out.{number:04}.png")) >= 60


def test_the_expected_error_is_that_of_the_command_line(host, cli, tmp_path):
    history = host.end(host.begin(workflow("expected_error")))
    assert history["status"]["status_str"] == "success", history["status"]
    [file] = history["outputs"]["5"]["images"]
    picture = linear_to_srgb(read_image(host.base / "output" / file["filename"]))[..., 0]
    options = ("--disparity", host.base / "input/disparity.png", "--blur", "30", "--focus", "0.5")
    folder = ("--save-maps", tmp_path / "maps", "-o", tmp_path / "out.png")
    assert cli("render", host.base / "input/photo.png", *options, *folder).code == 0
    expected = np.minimum(read_image(tmp_path / "maps/expected_error.exr")[..., 0] / 16, 1)
    assert expected.max() > 0.2
    assert np.abs(picture - expected).max() < 1 / 255  # ComfyUI cuts off when it rounds


def test_the_bar_moves_and_each_frame_is_shown(host):
    with web_socket.messages(host.port, "/ws?clientId=listener") as heard:
        name = host.begin(workflow("focus_pull"), "listener")
        shown, values = [], []
        for message in heard:
            if isinstance(message, bytes):
                kind, form = struct.unpack(">II", message[:8])
                assert (kind, form) == (1, 1)  # a preview, as JPEG
                shown.append(message[8:])
                continue
            summary = json.loads(message)
            data = summary["data"]
            if summary["type"] == "progress" and data["node"] == "5" and data["prompt_id"] == name:
                values.append((data["value"], data["max"]))
            if summary["type"] == "execution_success":
                break
    assert all(picture[:2] == b"\xff\xd8" for picture in shown)  # SOI marker of ISO/IEC 10918-1
    assert len(shown) == 1 + 3  # the repaired map and three frames
    assert values == sorted(values)
    assert values[-1] == (6000, 6000)
    assert len(values) > 6


def test_a_mask_is_a_map_and_a_matte(host):
    masked = workflow("still")
    masked["10"] = {"class_type": "ImageToMask", "inputs": {"image": ["2", 0], "channel": "red"}}
    masked["5"]["inputs"]["disparity"] = ["10", 0]
    files = []
    for original in (workflow("still"), masked, {**masked, "5": _with(masked["5"], matte=["10", 0])}):
        history = host.end(host.begin(original))
        assert history["status"]["status_str"] == "success", history["status"]
        files.append(read_image(host.base / "output" / history["outputs"]["7"]["images"][0]["filename"]))
    assert np.array_equal(files[0], files[1])
    assert psnr(files[1], files[2]) < 60  # where the map has its grey wall, half is covered


def _with(node: dict, **inputs: object) -> dict:
    return {**node, "inputs": {**node["inputs"], **inputs}}


def test_a_value_out_of_range_is_refused_before_it_runs(host):
    wrong = workflow("still")
    wrong["5"]["inputs"]["blur"] = -3.0
    code, response = host.ask("/prompt", {"prompt": wrong})
    assert code == 400
    assert "blur" in json.dumps(response["node_errors"]["5"])


@pytest.mark.parametrize(
    ("node", "inputs", "words"),
    [
        ("3", {"x": 999}, ["x, y", "a pixel of the map, below 120 and 90"]),
        ("3", {"by": "mask"}, ["mask: expected a mask"]),
        ("4", {"lens": "petzval", "blades": 2}, ["aperture.blades", "0 (disc) or 3 to 16"]),
        (
            "5",
            {"engine": "scatter", "settings_json": '{"lens": {"coma": 2}}'},
            ["lens.coma", "rays or hybrid"],
        ),
        ("5", {"settings_json": '{"camera": {"blurr": 2}}'}, ["unknown option 'camera.blurr'"]),
        ("5", {"settings_json": "{"}, ["settings_json: expected JSON"]),
    ],
)
def test_a_mistake_is_an_error_of_its_node_in_one_line(host, node, inputs, words):
    wrong = workflow("still")
    wrong[node]["inputs"] |= inputs
    history = host.end(host.begin(wrong))
    assert history["status"]["status_str"] == "error"
    error = host.messages(history)["execution_error"]
    assert error["node_id"] == node
    assert "\n" not in error["exception_message"].strip()
    for word in words:
        assert word in error["exception_message"]


def test_cancel_ends_a_rendering_and_the_next_one_runs(host):
    long = workflow("still")
    long["8"] = {
        "class_type": "ImageScale",
        "inputs": {
            "image": ["1", 0],
            "upscale_method": "bilinear",
            "width": 2400,
            "height": 1800,
            "crop": "disabled",
        },
    }
    long["9"] = {**long["8"], "inputs": {**long["8"]["inputs"], "image": ["2", 0]}}
    long["5"]["inputs"] |= {"image": ["8", 0], "disparity": ["9", 0], "blur": 200.0}
    name = host.begin(long)
    time.sleep(3)
    host.ask("/interrupt", {})
    begun = time.monotonic()
    history = host.end(name)
    assert "execution_interrupted" in host.messages(history)
    assert time.monotonic() - begun < 30
    assert host.end(host.begin(workflow("still")))["status"]["status_str"] == "success"
