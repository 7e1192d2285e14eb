"""The plug-in in the real GIMP 3, without a window. Authority: the command line.

``BOKEHNET_GIMP`` names GIMP's console program, where it is not on the path.
"""

import json
import os
import shutil
import stat
import subprocess
import sys

import numpy as np
import pytest

from bokehnet.io.image import read_image, write_image
from tests.conftest import ROOT

NAMES = ("gimp-console-3.0", "gimp-console-3.2")
GIMP = os.environ.get("BOKEHNET_GIMP") or next(filter(None, map(shutil.which, NAMES)), None)

pytestmark = [
    pytest.mark.host,
    pytest.mark.slow,
    pytest.mark.skipif(
        GIMP is None, reason="needs GIMP 3: apt-get install gimp python3-gi, from Debian 13 on"
    ),
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """GIMP's own folder, with the plug-in as a user puts it there."""
    made = tmp_path_factory.mktemp("gimp")
    shutil.copytree(ROOT / "integrations/gimp/bokehnet", made / "plug-ins/bokehnet")
    assert (made / "plug-ins/bokehnet/bokehnet.py").stat().st_mode & stat.S_IXUSR  # else GIMP passes over it
    return made


@pytest.fixture
def gimp(tmp_path, folder):
    """Render a picture by its depth layer; return what the plug-in told."""
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

    def run(options="--blur 6 --focus 1 --repair-disparity off", depth="depth", command=program):
        (tmp_path / "task.json").write_text(json.dumps([str(command), options, depth]), encoding="utf-8")
        environment = {"GIMP3_DIRECTORY": str(folder), "BOKEHNET_TASK": str(tmp_path)}
        code = f"exec(open({str(ROOT / 'tests/hosts/gimp_child.py')!r}).read())"
        words = [GIMP, "-i", "-d", "-f", "--batch-interpreter=python-fu-eval", "-b", code, "--quit"]
        done = subprocess.run(
            words, env={**os.environ, **environment}, capture_output=True, text=True, timeout=300
        )
        assert (tmp_path / "told.json").exists(), done.stdout + done.stderr
        return json.loads((tmp_path / "told.json").read_text(encoding="utf-8"))

    return run


def test_the_result_is_a_layer_and_is_what_the_command_line_makes(gimp, cli, tmp_path):
    told = gimp()
    assert told["status"] == "success", told
    assert told["layers"] == ["bokeh", "depth", "Background"]
    assert all(told["visible"])
    lens = ["--blur", "6", "--focus", "1", "--repair-disparity", "off", "--dither", "off"]
    words = ["--disparity", tmp_path / "disparity.png", *lens, "-o", tmp_path / "command.png"]
    assert cli("render", tmp_path / "photo.png", *words).code == 0
    found, wanted = read_image(tmp_path / "gimp.png"), read_image(tmp_path / "command.png")
    assert np.abs(found - wanted).max() < 0.02  # the plug-in's file has dither
    assert np.abs(found - read_image(tmp_path / "photo.png")).max() > 0.1


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"depth": "far"}, "layers: expected one named depth, found far, Background; name the depth so"),
        ({"options": "--blur minus"}, "--blur"),
        (
            {"command": "/nowhere/bokehnet"},
            "program: expected bokehnet and its options, found /nowhere/bokehnet",
        ),
    ],
)
def test_what_is_wrong_is_one_line_and_the_picture_stays(gimp, given, message):
    told = gimp(**given)
    assert told["status"] == "execution-error"
    assert message in told["error"]
    assert "\n" not in told["error"].strip()
    assert "bokeh" not in told["layers"]
