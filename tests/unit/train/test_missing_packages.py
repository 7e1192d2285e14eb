"""Scripts whose package lacks an extra end in one line, in a process of their own."""

import os
import subprocess
import sys

import pytest

from tests.conftest import ROOT


@pytest.fixture
def without_torch(tmp_path):
    """Return the environment of a process in which torch cannot be imported."""
    (tmp_path / "sitecustomize.py").write_text("import sys\nsys.modules['torch'] = None\n")
    return {**os.environ, "PYTHONPATH": str(tmp_path)}


@pytest.mark.parametrize(
    "script", ["train.recipe", "train.export", "train.train_arnet", "benchmarks.experiments.theses.marsicano"]
)
def test_a_script_without_torch_names_the_extra(without_torch, script):
    words = [sys.executable, "-m", script, "--help"]
    done = subprocess.run(
        words, cwd=ROOT, env=without_torch, capture_output=True, text=True, timeout=300, check=False
    )
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == "error: this needs torch: pip install 'bokehnet[train]'\n"
