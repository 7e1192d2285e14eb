"""The Python plug-in in the real Krita, by its kritarunner under Xvfb. Authority: the command line."""

import json
import os
import shutil
import subprocess
import sys

import numpy as np
import pytest

from bokehnet.io.image import read_image, write_image
from tests.conftest import ROOT

pytestmark = [
    pytest.mark.host,
    pytest.mark.slow,
    pytest.mark.skipif(not shutil.which("kritarunner"), reason="needs Krita: apt-get install krita"),
    pytest.mark.skipif(not shutil.which("xvfb-run"), reason="needs xvfb-run: apt-get install xvfb"),
]


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    """Where Krita keeps what it makes when it is started for the first time, which takes long."""
    return str(tmp_path_factory.mktemp("home"))


@pytest.fixture
def krita(tmp_path, home):
    """Render a document of a picture and its depth; return what the plug-in told."""
    rng = np.random.default_rng(1)
    disparity = np.zeros((60, 80, 3), np.float32)
    disparity[:, 30:50] = 1
    picture = np.kron(rng.random((10, 10, 3), dtype=np.float32), np.ones((6, 8, 1), np.float32))
    write_image(tmp_path / "photo.png", picture)
    write_image(tmp_path / "disparity.png", disparity)
    program = tmp_path / "bokehnet"
    program.write_text(
        f'#!/bin/sh\nPYTHONPATH="{ROOT}" exec "{sys.executable}" -m bokehnet "$@"\n', encoding="utf-8"
    )
    program.chmod(0o755)

    def run(options="--blur 6 --focus 1 --repair-disparity off", depth="depth"):
        (tmp_path / "task.json").write_text(json.dumps([str(program), options, depth]), encoding="utf-8")
        # Its Python is the system's, wherever the first `python3` of the path leads.
        environment = dict(os.environ, HOME=home, XDG_RUNTIME_DIR=home, PATH=os.defpath)
        environment["PYTHONPATH"] = f"{ROOT}/integrations/krita:{ROOT}/tests/hosts"
        display = str(200 + os.getpid() % 1000)  # two that look for one at once would take the same
        words = [
            "xvfb-run",
            "-a",
            "-n",
            display,
            "kritarunner",
            "-s",
            "krita_child",
            "-f",
            "main",
            str(tmp_path),
        ]
        done = subprocess.run(words, env=environment, capture_output=True, text=True, timeout=180)
        assert (tmp_path / "told.json").exists(), done.stderr
        return json.loads((tmp_path / "told.json").read_text(encoding="utf-8"))

    return run


def test_the_result_is_a_layer_and_is_what_the_command_line_makes(krita, cli, tmp_path):
    told = krita()
    assert "error" not in told
    assert told["layers"][-2:] == ["depth", "bokeh"]
    assert all(told["visible"])
    lens = ["--blur", "6", "--focus", "1", "--repair-disparity", "off", "--dither", "off"]
    words = ["--disparity", tmp_path / "disparity.png", *lens, "-o", tmp_path / "command.png"]
    assert cli("render", tmp_path / "photo.png", *words).code == 0
    found, wanted = read_image(tmp_path / "krita.png"), read_image(tmp_path / "command.png")
    assert np.abs(found - wanted).max() < 0.02  # its own rounding to 8 bits, with dither
    assert np.abs(found - read_image(tmp_path / "photo.png")).max() > 0.1


@pytest.mark.parametrize(
    ("given", "message"),
    [({"depth": "far"}, "layers: expected one named depth, found"), ({"options": "--blur minus"}, "--blur")],
)
def test_what_is_wrong_is_one_line_and_the_document_stays(krita, given, message):
    told = krita(**given)
    assert message in told["error"]
    assert "\n" not in told["error"]
    assert "bokeh" not in told["layers"]
