"""The plug-in in the real GIMP 3, without a window. Authority: the command line.

``BOKEHNET_GIMP`` names GIMP's console program, where it is not on the path.
"""

import os
import shutil
import stat

import pytest

from tests.conftest import ROOT
from tests.hosts.archives import install
from tests.hosts.photo_editor import OPTIONS, Task

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
    result = tmp_path_factory.mktemp("gimp")
    install("gimp", result / "plug-ins", tmp_path_factory.mktemp("downloads"))
    assert (
        result / "plug-ins/bokehnet/bokehnet.py"
    ).stat().st_mode & stat.S_IXUSR  # else GIMP passes over it
    return result


@pytest.fixture
def task(tmp_path):
    return Task(tmp_path)


@pytest.fixture
def gimp(task, folder):
    """Render a picture by its depth layer; return the report of the plug-in."""

    def run(options=OPTIONS, depth="depth", command=None):
        environment = {"GIMP3_DIRECTORY": str(folder), "BOKEHNET_TASK": str(task.folder)}
        code = f"exec(open({str(ROOT / 'tests/hosts/gimp_child.py')!r}).read())"
        words = [GIMP, "-i", "-d", "-f", "--batch-interpreter=python-fu-eval", "-b", code, "--quit"]
        return task.run(words, {**os.environ, **environment}, options, depth, command)

    return run


def test_the_result_is_a_layer_and_is_what_the_command_line_makes(gimp, task, cli):
    response = gimp()
    assert response["status"] == "success", response
    assert response["layers"] == ["bokeh", "depth", "Background"]
    assert all(response["visible"])
    task.check(task.folder / "gimp.png", cli)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"depth": "far"}, "layers: expected one named depth, found far, Background; name the depth so"),
        ({"options": "--blur minus"}, "--blur"),
        (
            {"command": "/nowhere/bokehnet"},
            "program: expected bokehnet and its options, found /nowhere/bokehnet",
        ),
    ],
)
def test_what_is_wrong_is_one_line_and_the_picture_stays(gimp, arguments, message):
    text = gimp(**arguments)
    assert text["status"] == "execution-error"
    assert message in text["error"]
    assert "\n" not in text["error"].strip()
    assert "bokeh" not in text["layers"]
