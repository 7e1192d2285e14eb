"""Hostile files end in a picture or in one line, within 5 s of processor time and 1 GiB.

Authority: the bounds of SECURITY.md, measured from outside by ``python -m tests.fuzz``.
"""

import gzip
import subprocess
import sys

import pytest

from tests.conftest import ROOT

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="needs forks and resource limits")


def fuzz(*words):
    """Run the fuzz; return its exit code and its lines."""
    command = [sys.executable, "-m", "tests.fuzz", *map(str, words)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=1800, check=False)
    return done.returncode, done.stdout + done.stderr


def test_every_hostile_file_ends_in_a_line(shared, tmp_path):
    source = shared("cases/hostile")
    for path in source.iterdir():
        if path.suffix not in (".py", ".md", ".gz"):
            (tmp_path / path.name).write_bytes(path.read_bytes())
        elif path.suffix == ".gz":
            (tmp_path / path.stem).write_bytes(gzip.decompress(path.read_bytes()))
    code, lines = fuzz("--files", tmp_path, "--seconds", 5)
    assert code == 0, "\n".join(line for line in lines.splitlines() if "FINDING" in line)


def test_mutated_files_end_in_a_line(tmp_path):
    """A quarter of a minute; ``python -m tests.fuzz --minutes 480`` is a night."""
    code, lines = fuzz("--minutes", 0.25, "--found", tmp_path / "found")
    assert code == 0, lines[-4000:]
