"""The warm renderer behind a pipe. Authority: the renderer itself, called with the same scene."""

import io
import json
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from bokehnet import BokehRenderer, DefocusMap, MetricDepth, RenderSettings, make_scene, read_image
from bokehnet.integrations.shared_pixels import SharedPixels
from bokehnet.integrations.warm import WarmRenderer
from bokehnet.io.channels import read_channels, write_channels
from bokehnet.io.image import write_map

ROOT = Path(__file__).parents[3]
HEIGHT, WIDTH = 40, 56
LENS = {"camera": {"focal_length": 50, "f_number": 0.8, "sensor_width": 36}, "focus": {"distance": 2.0}}


class Warm:
    """The process, asked line by line."""

    def __init__(self):
        command = [sys.executable, "-m", "bokehnet.integrations.warm"]
        pipe = subprocess.PIPE
        self.process = subprocess.Popen(command, cwd=ROOT, stdin=pipe, stdout=pipe, text=True)
        assert "ready" in self.answer()

    def say(self, text):
        self.process.stdin.write(text + "\n")
        self.process.stdin.flush()

    def answer(self):
        return json.loads(self.process.stdout.readline())

    def ask(self, **request):
        self.say(json.dumps(request))
        while "total" in (answer := self.answer()):
            assert 0 <= answer["done"] <= answer["total"]
        return answer


@pytest.fixture(scope="module")
def warm():
    started = Warm()
    yield started
    started.process.stdin.close()
    assert started.process.wait(timeout=20) == 0


@pytest.fixture
def picture():
    rng = np.random.default_rng(3)
    image = rng.random((HEIGHT, WIDTH, 3), dtype=np.float32)
    depth = np.full((HEIGHT, WIDTH), 6, np.float32)
    depth[8:30, 20:40] = 2
    return image, depth


def prepare_tables(path, image, depth, alpha=1.0):
    """Write pixels in the layout of a plug-in, and their description."""
    colors = np.concatenate([image, np.full((*depth.shape, 1), alpha, np.float32)], -1)
    path.write_bytes(colors.tobytes() + depth.tobytes() + bytes(colors.nbytes))
    sizes = {"width": depth.shape[1], "height": depth.shape[0]}
    return {
        "file": str(path),
        **sizes,
        "image": 0,
        "depth": colors.nbytes,
        "result": colors.nbytes + depth.nbytes,
    }


def result_in(path, response):
    stored = np.frombuffer(path.read_bytes(), np.float32, HEIGHT * WIDTH * 4, response["result"])
    return stored.reshape(HEIGHT, WIDTH, 4)


def test_shared_pixels_are_rendered_as_arrays_are(warm, picture, tmp_path):
    image, depth = picture
    message = prepare_tables(tmp_path / "shared", image, depth)
    answer = warm.ask(id=1, pixels=message, settings=LENS)
    expected = BokehRenderer().render(
        make_scene(image, MetricDepth(map=depth)), RenderSettings().updated(LENS)
    )
    result = result_in(tmp_path / "shared", message)
    assert np.array_equal(result[..., :3], expected.bokeh)
    assert (result[..., 3] == 1).all()
    assert answer["result"]["largest_blur"] == pytest.approx(expected.report.largest_blur)


def test_one_over_z_is_the_same_scene(warm, picture, tmp_path):
    image, depth = picture
    message = prepare_tables(tmp_path / "shared", image, 1 / depth)
    assert "result" in warm.ask(id=2, pixels={**message, "kind": "1/z"}, settings=LENS)
    plain = prepare_tables(tmp_path / "plain", image, depth)
    warm.ask(id=3, pixels=plain, settings=LENS)
    assert np.abs(result_in(tmp_path / "shared", message) - result_in(tmp_path / "plain", plain)).max() < 1e-4


def test_a_crop_has_its_stated_position(picture, tmp_path):
    image, depth = picture
    message = prepare_tables(tmp_path / "shared", image, depth)
    with SharedPixels.opened({**message, "kind": "defocus", "x": 7, "y": -3, "display_width": 99}) as pixels:
        scene = pixels.scene()
    assert (scene.window.x, scene.window.y, scene.window.display_width) == (7, -3, 99)
    assert np.array_equal(scene.depth.values, make_scene(image, DefocusMap(map=depth)).depth.values)


def test_files_are_rendered_and_an_exr_holds_the_picture_alone_if_requested(warm, picture, tmp_path):
    image, depth = picture
    write_channels(
        tmp_path / "in.exr", {**dict(zip("RGB", image.transpose(2, 0, 1), strict=True)), "id": depth}
    )
    write_map(tmp_path / "z.exr", depth)
    settings = {**LENS, "input": {"depth": str(tmp_path / "z.exr")}, "output": {"bits": "float"}}
    files = {"picture": str(tmp_path / "in.exr"), "output": str(tmp_path / "out.exr")}
    assert "result" in warm.ask(id=4, settings=settings, plain=True, **files)
    expected = BokehRenderer().render(
        make_scene(image, MetricDepth(map=depth)), RenderSettings().updated(LENS)
    )
    assert np.array_equal(read_image(tmp_path / "out.exr"), expected.bokeh)
    assert set(read_channels(tmp_path / "out.exr").channels) == set("RGB")


@pytest.mark.parametrize(
    ("change", "parameter"),
    [
        ({"settings": {"camera": {"f_number": -1}}}, "camera.f_number"),
        ({"settings": {"lense": {}}}, "lense"),
        ({"pixels": {"width": 0}}, "pixels.width"),
        ({"pixels": {"result": 1 << 30}}, "pixels.result"),
        ({"pixels": {"kind": "inches"}}, "pixels.kind"),
        ({"pixels": {"color": 1}}, "pixels"),
        ({"picture": 5, "pixels": None}, "picture"),
        ({"sky": 5}, "sky"),
    ],
)
def test_mistakes_are_reported_by_field_and_the_next_request_is_answered(
    warm, picture, tmp_path, change, parameter
):
    message = prepare_tables(tmp_path / "shared", *picture)
    request = {"id": 5, "pixels": message, "settings": LENS}
    if "pixels" in change:
        pixels = change["pixels"]
        change = {**change, "pixels": {**message, **pixels}} if pixels else change
    request |= change
    if request["pixels"] is None:
        del request["pixels"]
    error = warm.ask(**request)["error"]
    assert error["parameter"] == parameter
    assert error["expected"]
    assert "\n" not in error["message"]
    assert "result" in warm.ask(id=6, pixels=message, settings=LENS)


def test_an_invalid_request_line_is_reported(warm):
    warm.say("nonsense")
    assert "expected a JSON object" in warm.answer()["error"]["message"]


def test_a_cancel_that_comes_late_is_not_for_the_next_request(warm, picture, tmp_path):
    message = prepare_tables(tmp_path / "shared", *picture)
    assert "result" in warm.ask(id=10, pixels=message, settings=LENS)
    warm.say(json.dumps({"cancel": 10}))
    assert "result" in warm.ask(id=10, pixels=message, settings=LENS)


def test_lines_of_two_threads_are_whole():
    class Slow(io.StringIO):
        def write(self, text):
            for part in (text[: len(text) // 2], text[len(text) // 2 :]):
                super().write(part)
                time.sleep(0.001)

    answers = Slow()
    warm = WarmRenderer(answers)
    threads = [threading.Thread(target=warm._send, args=({"id": i, "x": "y" * 50},)) for i in range(20)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(json.loads(line)["id"] for line in answers.getvalue().splitlines()) == list(range(20))


def test_a_request_that_waits_is_cancelled(warm, picture, tmp_path):
    message = prepare_tables(tmp_path / "shared", *picture)
    warm.say(json.dumps({"id": 8, "pixels": message, "settings": LENS}))
    warm.say(json.dumps({"id": 9, "pixels": message, "settings": LENS}))
    warm.say(json.dumps({"cancel": 9}))
    ends = {}
    while 9 not in ends:
        answer = warm.answer()
        if "total" not in answer:
            ends[answer["id"]] = answer
    assert "result" in ends[8]
    assert ends[9]["error"]["message"] == "cancelled"
