"""Outputs of the command line against those of another revision.

    pytest tests/golden --against REVISION

Authority: the pictures that ``benchmarks/golden.py write`` makes with the package of that revision.
"""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.conftest import ROOT

GOLDEN = ROOT / "benchmarks/golden.py"


@pytest.fixture
def earlier(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Path]:
    """A worktree of the revision of ``--against``."""
    revision = request.config.getoption("--against")
    if revision is None:
        pytest.skip("compares with another revision: pytest tests/golden --against REVISION")
    folder = tmp_path / "earlier"
    git = ["git", "-C", str(ROOT), "worktree"]
    added = subprocess.run(
        [*git, "add", "--detach", str(folder), revision], capture_output=True, text=True, check=False
    )
    assert added.returncode == 0, added.stderr
    yield folder
    subprocess.run([*git, "remove", "--force", str(folder)], check=True, capture_output=True)


def write(checkout: Path, folder: Path) -> None:
    """Write the golden set with the package of ``checkout``; both sets use the commands of this one."""
    words = [sys.executable, str(GOLDEN), "write", str(folder)]
    environment = {**os.environ, "PYTHONPATH": str(checkout)}
    done = subprocess.run(
        words, cwd=folder.parent, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(f"bokehnet of {checkout / 'bokehnet'}\n"), done.stdout


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_outputs_are_those_of_the_earlier_revision(earlier, tmp_path):
    pytest.importorskip("torch", reason="exports networks")
    pytest.importorskip("onnx", reason="exports networks")
    write(earlier, tmp_path / "before")
    write(ROOT, tmp_path / "now")
    words = [sys.executable, str(GOLDEN), "compare", str(tmp_path / "before"), str(tmp_path / "now")]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
