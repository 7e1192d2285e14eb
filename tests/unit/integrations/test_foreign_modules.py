"""Modules in the current folder, which may come with a project from others, are not imported."""

import importlib.util
import os
import re
import subprocess
import sys
import types
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
NAMES = ("json", "struct", "pickle", "ast", "queue", "socket")


@pytest.fixture
def trap(tmp_path, monkeypatch):
    """A current folder with modules named like those of the standard library, which leave a mark."""
    for name in NAMES:
        text = f"open({str(tmp_path / 'ran')!r}, 'a').write({name!r})\nraise ImportError({name!r})\n"
        (tmp_path / f"{name}.py").write_text(text)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    return tmp_path / "ran"


@pytest.mark.slow
def test_the_process_of_blender_runs_no_module_of_the_folder(trap, monkeypatch):
    package, camera = types.ModuleType("plug_in"), types.ModuleType("plug_in.camera")
    package.__path__, camera.HostError = [], RuntimeError  # the module itself needs no Blender
    monkeypatch.setitem(sys.modules, "plug_in", package)
    monkeypatch.setitem(sys.modules, "plug_in.camera", camera)
    location = ROOT / "integrations/blender/process.py"
    spec = importlib.util.spec_from_file_location("plug_in.process", location)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    (kind,) = [one for one in vars(module).values() if isinstance(one, type) and hasattr(one, "render")]
    process = kind(sys.executable)
    process._start()
    process.stop()
    assert not trap.exists(), trap.read_text()


@pytest.mark.slow
def test_worker_processes_of_the_program_run_no_module_of_the_folder(trap, tmp_path):
    source = (
        "import multiprocessing, os, sys\n"
        "from bokehnet.cli import app\n"
        "app.run = lambda arguments: started()\n"
        "def started():\n"
        "    process = multiprocessing.get_context('spawn').Process(target=print)\n"
        "    process.start()\n"
        "    process.join()\n"
        "    return process.exitcode\n"
        "if __name__ == '__main__':\n"
        "    app.main()\n"
    )
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    (folder / "program.py").write_text(source)
    done = subprocess.run(
        [sys.executable, str(folder / "program.py")], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert not trap.exists(), trap.read_text()


def test_every_plug_in_starts_python_without_the_current_folder():
    """``-m`` follows ``-P``, and every other start passes PYTHONSAFEPATH."""
    for path in (ROOT / "integrations").rglob("*.*"):
        if path.suffix not in (".py", ".cpp"):
            continue
        text = path.read_text()
        for start in re.finditer(r'"-m"', text):
            assert re.search(r'"-[PI]",\s*$', text[: start.start()]), path
        runs = text.count("subprocess.run(")
        assert text.count("PYTHONSAFEPATH") == runs, path


def test_the_program_protects_its_processes_from_the_current_folder(monkeypatch):
    monkeypatch.setenv("PYTHONSAFEPATH", "")  # recorded, so that the variable does not stay after the test
    monkeypatch.delenv("PYTHONSAFEPATH")
    from bokehnet.cli import app

    monkeypatch.setattr(sys, "argv", ["bokehnet", "--version"])
    monkeypatch.setattr(app, "_leave", lambda code: None)
    app.main()
    assert os.environ["PYTHONSAFEPATH"] == "1"
