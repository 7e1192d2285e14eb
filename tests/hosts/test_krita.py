"""The Python plug-in in the real Krita, by its kritarunner under Xvfb. Authority: the command line."""

import os
import shutil

import pytest

from tests.conftest import ROOT
from tests.hosts.archives import install
from tests.hosts.photo_editor import OPTIONS, Task

pytestmark = [
    pytest.mark.host,
    pytest.mark.slow,
    pytest.mark.skipif(not shutil.which("kritarunner"), reason="needs Krita: apt-get install krita"),
    pytest.mark.skipif(not shutil.which("xvfb-run"), reason="needs xvfb-run: apt-get install xvfb"),
]


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    """Home with the plug-in, where Krita keeps what it makes at its first start, which takes long."""
    folder = tmp_path_factory.mktemp("home")
    install("krita", folder / ".local/share/krita/pykrita", tmp_path_factory.mktemp("downloads"))
    return str(folder)


@pytest.fixture
def task(tmp_path):
    return Task(tmp_path)


@pytest.fixture
def krita(task, home):
    """Render a document of a picture and its depth; return the report of the plug-in."""

    def run(options=OPTIONS, depth="depth"):
        # Its Python is the system's, wherever the first `python3` of the path leads.
        environment = dict(os.environ, HOME=home, XDG_RUNTIME_DIR=home, PATH=os.defpath)
        environment["PYTHONPATH"] = f"{home}/.local/share/krita/pykrita:{ROOT}/tests/hosts"
        display = str(200 + os.getpid() % 1000)  # two that look for one at once would take the same
        script = ["kritarunner", "-s", "krita_child", "-f", "main", str(task.folder)]
        return task.run(
            ["xvfb-run", "-a", "-w", "10", "-n", display, *script], environment, options, depth, None
        )

    return run


def test_the_result_is_a_layer_and_is_what_the_command_line_makes(krita, task, cli):
    response = krita()
    assert "error" not in response
    assert response["layers"][-2:] == ["depth", "bokeh"]
    assert all(response["visible"])
    task.check(task.folder / "krita.png", cli)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [({"depth": "far"}, "layers: expected one named depth, found"), ({"options": "--blur minus"}, "--blur")],
)
def test_what_is_wrong_is_one_line_and_the_document_stays(krita, arguments, message):
    text = krita(**arguments)
    assert message in text["error"]
    assert "\n" not in text["error"]
    assert "bokeh" not in text["layers"]
